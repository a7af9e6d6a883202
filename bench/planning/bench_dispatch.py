# SPDX-License-Identifier: Apache-2.0
"""What planning, parsing and dispatching cost an ordinary rospy client, over ROS, and how they grow."""

import subprocess
import tempfile
import threading
import time
from pathlib import Path
from typing import Any, Callable, Dict, List, Optional

import rospy
from measuring.figures import figure, time_ms
from measuring.ros_process import RosMaster
from rosplan_dispatch_msgs.msg import ActionDispatch, ActionFeedback
from rosplan_dispatch_msgs.srv import DispatchService, ParsingService, PlanningService
from rosplan_knowledge_msgs.msg import DomainFormula
from std_srvs.srv import Empty

HOME = Path(__file__).resolve().parents[2] / "pddl" / "home"
KB = "/rosplan_knowledge_base"
KNOWN_PLAN = "0.000: (navigate anywhere kitchen)  [28.200]\n28.200: (ask kitchen)  [5.000]\n"
KINDS = ("simple", "esterel")
OPERATORS = 50
PLACES = 60
LONG_PLAN = 2_000
START_LIMIT = 30.0  # s
ENABLED, SUCCEEDED, FAILED = 1, 2, 10


def chain_domain() -> str:
    """50 operators that each move from place to place while the power is on."""
    operators = "\n".join(
        f"""(:durative-action step{number} :parameters (?a ?b - place) :duration (= ?duration 1)
          :condition (and (at start (at ?a)) (at start (not (blocked ?b))) (over all (powered)))
          :effect (and (at end (at ?b))))"""
        for number in range(OPERATORS)
    )
    return f"""(define (domain chain)
      (:requirements :strips :typing :negative-preconditions :durative-actions)
      (:types place) (:predicates (at ?p - place) (blocked ?p - place) (powered))
      {operators})"""


def chain_problem() -> str:
    """Every place is reached already: the conditions of a chain hold although no effects are applied."""
    places = [f"p{number}" for number in range(PLACES)]
    return f"""(define (problem chained) (:domain chain) (:objects {" ".join(places)} - place)
      (:init (powered) {" ".join(f"(at {place})" for place in places)}) (:goal (and)))"""


def chain(length: int) -> str:
    """A plan whose every action needs the one before it."""
    return "".join(
        f"{number}.0: (step{number % OPERATORS} p{number % PLACES} p{(number + 1) % PLACES})  [1.0]\n"
        for number in range(length)
    )


def proxy(name: str, service_class: Any) -> rospy.ServiceProxy:
    return rospy.ServiceProxy(name, service_class, persistent=True)


class Interfaces:
    """50 action interfaces that answer at once, in one process as MERLIN's bridges are."""

    def __init__(self, dispatcher: str) -> None:
        self.samples: List[float] = []
        self._answered: Optional[float] = None
        self.hold = threading.Event()  # set: actions are taken and not ended
        self.taken = threading.Event()
        self._stopped = threading.Event()
        self._feedback = rospy.Publisher(
            f"{dispatcher}/action_feedback", ActionFeedback, queue_size=10, latch=True
        )
        self._announcements = rospy.Publisher(f"{KB}/pddl_action_parameters", DomainFormula, queue_size=100)
        self._subscriber = rospy.Subscriber(
            f"{dispatcher}/action_dispatch", ActionDispatch, self._receive, tcp_nodelay=True
        )
        end = time.monotonic() + START_LIMIT
        while not (self._feedback.get_num_connections() and self._subscriber.get_num_connections()):
            if time.monotonic() > end:
                raise RuntimeError(f"{dispatcher} does not connect")
            time.sleep(0.02)
        threading.Thread(target=self._announce, daemon=True).start()

    def close(self) -> None:
        self._stopped.set()
        for handle in (self._subscriber, self._feedback, self._announcements):
            handle.unregister()

    def _announce(self) -> None:
        while not self._stopped.wait(1.0):
            for number in range(OPERATORS):
                self._announcements.publish(DomainFormula(name=f"step{number}"))

    def _answer(self, action: ActionDispatch, status: int) -> None:
        self._feedback.publish(
            ActionFeedback(action_id=action.action_id, plan_id=action.plan_id, status=status)
        )

    def _receive(self, action: ActionDispatch) -> None:
        now = time.perf_counter()
        if action.name == "cancel_action":
            if self.hold.is_set():
                self._answer(action, FAILED)
            return
        if self._answered is not None:
            self.samples.append((now - self._answered) * 1000.0)
        self._answer(action, ENABLED)
        self.taken.set()
        if self.hold.is_set():
            return
        self._answered = time.perf_counter()
        self._answer(action, SUCCEEDED)

    def begin(self) -> None:
        self._answered = None
        self.taken.clear()


class Dispatcher:
    """A parser and a dispatcher of one kind."""

    def __init__(self, kind: str) -> None:
        self._dispatch = rospy.ServiceProxy(
            f"/{kind}_dispatcher/dispatch_plan", DispatchService, persistent=True
        )
        self._cancel = rospy.ServiceProxy(f"/{kind}_dispatcher/cancel_dispatch", Empty, persistent=True)
        self._parse = rospy.ServiceProxy(
            f"/{kind}_parser/parse_plan_from_file", ParsingService, persistent=True
        )
        self.interfaces = Interfaces(f"/{kind}_dispatcher")

    def parse(self, path: str) -> None:
        if not self._parse(path).plan_parsed:
            raise RuntimeError(f"{path} was not parsed")

    def dispatch_parsed(self) -> bool:
        """Dispatches what was parsed; whether that succeeded."""
        return bool(self._dispatch().success)

    def dispatch(self, path: str) -> float:
        """Seconds to run a whole plan."""
        self.parse(path)
        self.interfaces.begin()
        start = time.perf_counter()
        if not self.dispatch_parsed():
            raise RuntimeError("the dispatch failed")
        return time.perf_counter() - start

    def cancel(self, path: str) -> float:
        """ms from the cancel of a running action to the end of the dispatch."""
        self.parse(path)
        self.interfaces.begin()
        ended: List[float] = []

        def run() -> None:
            self._dispatch()
            ended.append(time.perf_counter())

        thread = threading.Thread(target=run, daemon=True)
        thread.start()
        if not self.interfaces.taken.wait(START_LIMIT):
            raise RuntimeError("no action was dispatched")
        start = time.perf_counter()
        self._cancel()
        thread.join(START_LIMIT)
        return (ended[0] - start) * 1000.0

    def close(self) -> None:
        self.interfaces.close()


def plan_figures(folder: Path) -> Dict[str, Dict[str, float]]:
    """The planning service on the home domain with one goal, by kairos and by an external planner."""
    problem = folder / "problem.pddl"
    text = (HOME / "problem.pddl").read_text()
    problem.write_text(text.replace("(:goal (in_service))", "(:goal (and (checked kitchen)))"))
    plan = proxy("/planner/planning_server_params", PlanningService)

    def call(command: str = "") -> None:
        if not plan(str(HOME / "domain.pddl"), str(problem), "", command, False).plan_found:
            raise RuntimeError("no plan was found")

    # A planner of our own, that costs nothing but its start: what is above it is ours.
    planner = folder / "planner"
    planner.write_text(f"#!/bin/sh\ncat {folder}/known_plan\n")
    planner.chmod(0o755)
    (folder / "known_plan").write_text(KNOWN_PLAN)
    alone = ["/bin/sh", "-c", f"{planner} {HOME / 'domain.pddl'} {problem}"]
    return {
        "plan_ms": time_ms(call, 100),
        "plan_external_ms": time_ms(lambda: call(f"{planner} DOMAIN PROBLEM"), 100),
        "plan_external_alone_ms": time_ms(lambda: subprocess.run(alone, stdout=subprocess.DEVNULL), 100),
    }


def dispatching(folder: Path, kind: str) -> Dict[str, Any]:
    """Figures of one kind of dispatcher."""
    dispatcher = Dispatcher(kind)
    try:
        paths: Dict[int, str] = {}
        for length in (1, 6, 200, LONG_PLAN):
            paths[length] = str(folder / f"plan{length}")
            Path(paths[length]).write_text(chain(length))
        parse: Callable[[], None] = lambda: dispatcher.parse(paths[6])  # noqa: E731
        figures: Dict[str, Any] = {"parse_ms": time_ms(parse, 200)}
        dispatcher.dispatch(paths[200])
        dispatcher.interfaces.samples.clear()
        for _ in range(3):
            dispatcher.dispatch(paths[200])
        figures["succeeded_to_dispatch_ms"] = figure(dispatcher.interfaces.samples)
        dispatcher.interfaces.hold.set()
        for _ in range(3):
            dispatcher.cancel(paths[1])
        figures["cancel_dispatch_ms"] = figure([dispatcher.cancel(paths[1]) for _ in range(100)])
        dispatcher.interfaces.hold.clear()
        dispatcher.interfaces.samples.clear()
        start = time.perf_counter()
        dispatcher.parse(paths[LONG_PLAN])
        figures["long_plan"] = {
            "actions": LONG_PLAN,
            "interfaces": OPERATORS,
            "parse_s": round(time.perf_counter() - start, 3),
            "dispatch_s": round(dispatcher.dispatch(paths[LONG_PLAN]), 3),
            "succeeded_to_dispatch_ms": figure(dispatcher.interfaces.samples),
        }
        return figures
    finally:
        dispatcher.close()


def measure() -> Dict[str, Any]:
    """All figures; the planning system runs as one process, as in MERLIN's launch files."""
    with tempfile.TemporaryDirectory(prefix="merlin_bench_") as name, RosMaster() as master:
        folder = Path(name)
        (folder / "domain.pddl").write_text(chain_domain())
        (folder / "chain_problem.pddl").write_text(chain_problem())
        components = {"rosplan_knowledge_base": "knowledge_base", "planner": "planner_interface"}
        remaps = []
        for kind in KINDS:
            components[f"{kind}_parser"] = f"{kind}_plan_parser"
            components[f"{kind}_dispatcher"] = f"{kind}_plan_dispatcher"
            remaps.append(f"{kind}_dispatcher/complete_plan:={kind}_parser/complete_plan")
        master.set_params(
            {
                f"{KB}/domain_path": str(folder / "domain.pddl"),
                f"{KB}/problem_path": str(folder / "chain_problem.pddl"),
            }
        )
        master.node(
            "merlin_rosplan", "planning_system", "planning_system", {"components": components}, *remaps
        )
        for kind in KINDS:
            master.wait_for_service(f"/{kind}_dispatcher/cancel_dispatch")
        rospy.init_node("bench_dispatch", anonymous=True, disable_signals=True)
        figures = {kind: dispatching(folder, kind) for kind in KINDS}
        result: Dict[str, Any] = dict(plan_figures(folder))
        for key in ("parse_ms", "succeeded_to_dispatch_ms", "cancel_dispatch_ms"):
            result[key] = figures["esterel"][key]  # the default
        result["dispatchers"] = figures
        return result
