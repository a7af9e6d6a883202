# SPDX-License-Identifier: Apache-2.0
"""How long a node of the planning system takes from the start of its process to its first answer."""

import os
import signal
import subprocess
import sys
import tempfile
import time
import xmlrpc.client
from pathlib import Path
from typing import Any, Dict, List, Tuple

import rospy
from measuring.figures import figure
from measuring.load import load
from measuring.ros_process import RosMaster
from planning.bench_knowledge import BATCH, DOMAIN, KB, Shelves
from rosplan_dispatch_msgs.srv import ParsingService, PlanningService, ProblemService
from rosplan_knowledge_msgs.srv import GetAttributeService, GetDomainNameService
from std_srvs.srv import Empty

DEVEL = Path(__file__).resolve().parents[2] / "devel" / "lib"
HOME = Path(__file__).resolve().parents[2] / "pddl" / "home"
REPEATS = 10
LOAD = 8  # processes beside which the nodes are started once more
LIMIT = 60.0  # s
FACTS = 100_000
KNOWLEDGE, PROBLEM, PLANNER = KB, "rosplan_problem_interface", "rosplan_planner_interface"
PARSER, DISPATCHER = "rosplan_parsing_interface", "rosplan_plan_dispatcher"

#: executable -> (package, node, service, its class)
NODES: Dict[str, Tuple[str, str, str, Any]] = {
    "knowledgeBase": ("rosplan_knowledge_base", KNOWLEDGE, "domain/name", GetDomainNameService),
    "problemInterface": (
        "rosplan_planning_system",
        PROBLEM,
        "problem_generation_server_params",
        ProblemService,
    ),
    "popf_planner_interface": (
        "rosplan_planning_system",
        PLANNER,
        "planning_server_params",
        PlanningService,
    ),
    "pddl_esterel_plan_parser": ("rosplan_planning_system", PARSER, "parse_plan_from_file", ParsingService),
    "pddl_esterel_plan_dispatcher": ("rosplan_planning_system", DISPATCHER, "cancel_dispatch", Empty),
    "planning_system": (
        "merlin_rosplan",
        "planning_system",
        f"/{KNOWLEDGE}/domain/name",
        GetDomainNameService,
    ),
}


def start(
    executable: str, service: str, kind: Any, *args: str
) -> "Tuple[float, float, subprocess.Popen[bytes]]":
    """Seconds of wall time and of the process's own time until a service answers, whatever it answers."""
    package, node = NODES[executable][:2]
    command = [sys.executable, str(DEVEL / package / executable), f"__name:={node}", *args]
    master: Any = xmlrpc.client.ServerProxy(os.environ["ROS_MASTER_URI"])
    name = service if service.startswith("/") else f"/{node}/{service}"
    begin = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    while time.perf_counter() - begin < LIMIT and process.poll() is None:
        if master.lookupService("/bench", name)[0] == 1 and answers(name, kind):
            return time.perf_counter() - begin, own_time(process.pid), process
        time.sleep(0.002)
    raise RuntimeError(f"{executable} has not answered (exit code {process.poll()})")


def starts(executable: str) -> Tuple[List[float], List[float]]:
    """Repeated starts: seconds of wall time, and of the process's own time."""
    _, _, service, kind = NODES[executable]
    wall, own = [], []
    for _ in range(REPEATS):
        seconds, spent, process = start(executable, service, kind)
        wall.append(seconds)
        own.append(spent)
        end(process)
    return wall, own


def answers(service: str, kind: Any) -> bool:
    """Whether a service answers; after SIGKILL the master still names the dead one."""
    try:
        rospy.ServiceProxy(service, kind)()
    except rospy.ServiceException as error:
        return not str(error).startswith("unable to connect") and "unavailable" not in str(error)
    return True


def own_time(pid: int) -> float:
    """Seconds of user and system time of a process."""
    return time.clock_gettime((~pid << 3) | 2)  # Linux's clock of another process; /proc counts in 10 ms


def end(process: "subprocess.Popen[bytes]", number: int = signal.SIGINT) -> None:
    process.send_signal(number)
    try:
        process.wait(10.0)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def all_services(results: Dict[str, Any]) -> None:
    """Of `planning_system` the last of its services too."""
    last = f"/{DISPATCHER}/cancel_dispatch"
    samples: List[float] = []
    for _ in range(REPEATS):
        seconds, _, process = start("planning_system", last, Empty)
        samples.append(seconds)
        end(process)
    results["node_start_s"]["planning_system, all services"] = figure(samples)


def restart(results: Dict[str, Any], folder: Path) -> None:
    """A knowledge base that has kept 100 000 facts, after a clean end and after SIGKILL."""
    domain = folder / "shelves.pddl"
    domain.write_text(DOMAIN)
    args = (f"_domain_path:={domain}", f"_state_file:={folder / 'state.sqlite'}")
    _, _, process = start("knowledgeBase", "clear", Empty, *args)
    shelves = Shelves()
    shelves.start()
    shelves.grow(FACTS)
    for how, number in (("clean end", signal.SIGINT), ("SIGKILL", signal.SIGKILL)):
        end(process, number)
        seconds, _, process = start("knowledgeBase", "state/goals", GetAttributeService, *args)
        results[f"kb_restart_{FACTS}_s, {how}"] = round(seconds, 2)
    end(process)


def measure() -> Dict[str, Any]:
    assert BATCH <= FACTS
    results: Dict[str, Any] = {"node_start_s": {}, "node_start_loaded_s": {}, "node_start_processor_ms": {}}
    with tempfile.TemporaryDirectory() as folder, RosMaster() as master:
        for node in (KNOWLEDGE, PLANNER):
            master.set_params({f"/{node}/domain_path": str(HOME / "domain.pddl")})
        master.set_params({f"/{KNOWLEDGE}/problem_path": str(HOME / "problem.pddl")})
        rospy.init_node("bench_start", disable_signals=True)
        for executable in NODES:
            wall, own = starts(executable)
            results["node_start_s"][executable] = figure(wall)
            results["node_start_processor_ms"][executable] = figure([1000.0 * seconds for seconds in own])
            with load(LOAD):
                results["node_start_loaded_s"][executable] = figure(starts(executable)[0])
        all_services(results)
        master.set_params({f"/{KNOWLEDGE}/problem_path": ""})
        restart(results, Path(folder))
    return results
