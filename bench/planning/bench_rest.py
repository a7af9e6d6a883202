# SPDX-License-Identifier: Apache-2.0
"""How soon a plan is given up whose rest no longer fits: from a fact's update to the cancel of what runs."""

import tempfile
import threading
import time
from pathlib import Path
from typing import Any, Dict, List

import rospy
from measuring.figures import figure
from measuring.ros_process import RosMaster
from rosplan_dispatch_msgs.msg import ActionDispatch

from merlin_planning.knowledge_client import ADD, REMOVE, KnowledgeClient, Update, fact
from planning.bench_dispatch import KB, PLACES, START_LIMIT, Dispatcher, chain, chain_domain, chain_problem

FACTS = 10_000
STEPS = 100
SAMPLES = 100
AFFECTED = f"p{PLACES - 1}"  # the last place that the plan comes to before its first round ends


def facts() -> str:
    """Facts that no step of the plan needs."""
    numbers = (
        (first, second, third) for first in range(PLACES) for second in range(PLACES) for third in range(3)
    )
    return " ".join(f"(near p{a} p{b} p{c})" for (a, b, c), _ in zip(numbers, range(FACTS)))


class Cancels:
    """When the dispatcher cancelled an action."""

    def __init__(self, dispatcher: str) -> None:
        self.at = 0.0
        self.came = threading.Event()
        self._subscriber = rospy.Subscriber(
            f"{dispatcher}/action_dispatch", ActionDispatch, self._receive, tcp_nodelay=True
        )

    def _receive(self, action: ActionDispatch) -> None:
        if action.name == "cancel_action" and not self.came.is_set():
            self.at = time.perf_counter()
            self.came.set()


def decision(dispatcher: Dispatcher, path: str, knowledge: KnowledgeClient, cancels: Cancels) -> float:
    """ms from the update to the cancel."""
    dispatcher.parse(path)
    dispatcher.interfaces.begin()
    thread = threading.Thread(target=dispatcher.dispatch_parsed, daemon=True)
    thread.start()
    if not dispatcher.interfaces.taken.wait(START_LIMIT):
        raise RuntimeError("no action was dispatched")
    cancels.came.clear()
    start = time.perf_counter()
    knowledge.update([Update(ADD, fact("blocked", AFFECTED))])
    if not cancels.came.wait(START_LIMIT):
        raise RuntimeError("the plan was not given up")
    thread.join(START_LIMIT)
    knowledge.update([Update(REMOVE, fact("blocked", AFFECTED))])
    return (cancels.at - start) * 1000.0


def measure() -> Dict[str, Any]:
    """The figure, over a knowledge base of 10 000 facts and a plan of 100 steps."""
    with tempfile.TemporaryDirectory(prefix="merlin_bench_") as name, RosMaster() as master:
        folder = Path(name)
        domain = chain_domain().replace("(powered))", "(powered) (near ?a ?b ?c - place))", 1)
        problem = chain_problem().replace("(:init", f"(:init {facts()}", 1)
        (folder / "domain.pddl").write_text(domain)
        (folder / "problem.pddl").write_text(problem)
        (folder / "plan").write_text(chain(STEPS))
        master.set_params(
            {
                f"{KB}/domain_path": str(folder / "domain.pddl"),
                f"{KB}/problem_path": str(folder / "problem.pddl"),
            }
        )
        components = {
            "rosplan_knowledge_base": "knowledge_base",
            "esterel_parser": "esterel_plan_parser",
            "esterel_dispatcher": "esterel_plan_dispatcher",
        }
        remap = "esterel_dispatcher/complete_plan:=esterel_parser/complete_plan"
        master.node("merlin_rosplan", "planning_system", "planning_system", {"components": components}, remap)
        master.wait_for_service("/esterel_dispatcher/cancel_dispatch")
        rospy.init_node("bench_rest", anonymous=True, disable_signals=True)
        dispatcher, cancels = Dispatcher("esterel"), Cancels("/esterel_dispatcher")
        dispatcher.interfaces.hold.set()
        knowledge = KnowledgeClient(KB)
        try:
            samples: List[float] = [
                decision(dispatcher, str(folder / "plan"), knowledge, cancels) for _ in range(SAMPLES + 3)
            ]
        finally:
            dispatcher.close()
        return {"fact_to_decision_ms": figure(samples[3:])}
