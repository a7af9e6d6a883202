# SPDX-License-Identifier: Apache-2.0
"""From a question to its answer: of what happens, over a growing history of 100 000 events and 10 000 facts;
of plans, with 10 000 facts and a plan of 100 steps, and in the restaurant.
"""

import tempfile
import threading
import time
from pathlib import Path
from typing import Any, Callable, Dict

import rospy
from diagnostic_msgs.msg import KeyValue
from measuring.figures import time_ms
from measuring.ros_process import RosMaster
from merlin_msgs.msg import DispatchStatus, ExecutorStatus
from merlin_msgs.srv import Explain, ExplainRequest
from planning.bench_dispatch import OPERATORS, PLACES, chain, chain_domain, chain_problem
from planning.bench_rest import STEPS, facts
from rosplan_dispatch_msgs.msg import ActionDispatch, ActionFeedback
from rosplan_knowledge_msgs.msg import KnowledgeItem
from std_msgs.msg import String

from merlin_monitor.bag.bag_import import RecordedModel
from merlin_monitor.state.history_events import Event
from merlin_monitor.state.knowledge_section import Contents
from merlin_monitor.state.plan_steps import ShownStep
from merlin_planning.knowledge_client import fact
from merlin_ros.service_proxy import ServiceProxy

RESTAURANT = Path(__file__).resolve().parents[2] / "pddl" / "restaurant"
EVENTS = 100_000
MINUTES = 60
LOOKS = 4  # frames per s of the past
LIMIT = 120.0  # s
REPEATS = 40
PLANNED = 10  # questions that plan
RUN = "bench"
KB = "rosplan_knowledge_base"


class Monitor:
    """Keeps a history, of an hour that has passed and then of now.

    :param file: of the history.
    """

    def __init__(self, file: Path) -> None:
        self.file = file
        self._begin, self._ahead = time.monotonic(), -60.0 * MINUTES
        self._wall = time.time() - self._begin
        self.model = RecordedModel(file, self.wall, self._fail, session=f"{RUN} /merlin_monitor")
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._go_on, name="monitor", daemon=True)

    @staticmethod
    def _fail(line: str) -> None:
        raise RuntimeError(line)

    def wall(self) -> float:
        """s since 1970."""
        passed = self._begin if self._ahead else time.monotonic()
        return round(self._wall + passed + self._ahead, 3)

    def write(self) -> None:
        """Records the past, whose last minute has a plan, and a request that failed."""
        model, history = self.model, self.model.history
        assert history is not None
        model.start()
        model.tree.set("why", "clock", self._wall)
        objects = {f"p{number}": "place" for number in range(PLACES)}
        known = [_item(text) for text in facts().split(") (")]
        known += [_item("powered"), *(_item(f"at {place}") for place in objects)]
        model.knowledge.replace(Contents(objects, known, [], []), "", self.wall(), True)
        looks = MINUTES * 60 * LOOKS
        for look in range(looks):
            self._ahead = (look - looks) / LOOKS
            for number in range(EVENTS // looks + 1):
                text = f"(step{number} p{look % PLACES} p{number}) succeeded after 3.1 s"
                history.add(Event("action", text, self.wall(), {"label": text.split(" succ")[0]}))
            self._record()
            if look == looks - 60 * LOOKS:
                self._fail_once()
            if look % 200 == 0:
                model.settle()
        self._plan()
        self._ahead = 0.0
        model.settle()
        self._thread.start()

    def _record(self) -> None:
        self.model.tree.set("meta", "time", self.wall())
        self.model.record()

    def _plan(self) -> None:
        steps = []
        for number in range(STEPS):
            pairs = [("a", f"p{number % PLACES}"), ("b", f"p{(number + 1) % PLACES}")]
            steps.append(ShownStep(number, f"step{number % OPERATORS}", pairs, float(number), 1.0))
        self.model.planned(steps, [(number, number + 1) for number in range(STEPS - 1)], self.wall())
        self.model.now.executor(
            ExecutorStatus(state=ExecutorStatus.RUNNING, request="/m-1", goals=["(at p1)"]), self.wall()
        )
        first = ActionDispatch(action_id=0, plan_id=1, name="step0")
        first.parameters = [KeyValue("a", "p0"), KeyValue("b", "p1")]
        self.model.plan.dispatched(first, self.wall())
        self.model.plan.feedback(ActionFeedback(action_id=0, plan_id=1, status=1), self.wall())
        self._record()

    def _fail_once(self) -> None:
        self._plan()
        reason = "(blocked p1) holds, but (step0 p0 p1) needs it not to"
        message = DispatchStatus(plan_id=1, failed_action="(step0 p0 p1)", reason=reason)
        self.model.plan.dispatcher(message, self.wall())
        self.model.plan.feedback(ActionFeedback(action_id=0, plan_id=1, status=10), self.wall())
        self._record()

    def _go_on(self) -> None:
        while not self._stopped.wait(0.2):
            self._record()

    def close(self) -> None:
        self._stopped.set()
        self._thread.join()
        self.model.stop()


def _item(text: str) -> KnowledgeItem:
    name, *objects = text.strip("() ").split()
    return fact(name, *objects)


def asking(space: str, question: str, about: str = "", **fields: Any) -> Callable[[], None]:
    """Asks once, and fails where it is not answered.

    :param space: namespace.
    """
    service = ServiceProxy(f"{space}/merlin/explain", Explain, timeout=LIMIT)

    def ask() -> None:
        answer = service(ExplainRequest(question=question, about=about, **fields))
        if not answer.ok:
            raise RuntimeError(f"{question} {about}: {answer.sentence}")

    return ask


def history(master: RosMaster, monitor: Monitor, folder: Path) -> Dict[str, Any]:
    """Questions about what happens, and why a step of a plan is there."""
    domain = chain_domain().replace("(powered))", "(powered) (near ?a ?b ?c - place))", 1)
    problem = chain_problem().replace("(:init", f"(:init {facts()}", 1)
    problem = problem.replace("(:goal (and))", f"(:goal (at p{STEPS % PLACES}))")
    (folder / "domain.pddl").write_text(domain)
    master.set_params(
        {
            "/run_id": RUN,
            "/merlin_monitor/history": str(monitor.file),
            f"/{KB}/domain_path": str(folder / "domain.pddl"),
        }
    )
    master.node("merlin_explain", "explain", "merlin_explain")
    master.wait_for_service("/merlin/explain")
    topics = ("/rosplan_problem_interface/problem_instance", "/rosplan_planner_interface/planner_output")
    latched = [rospy.Publisher(name, String, queue_size=1, latch=True) for name in topics]
    for publisher, text in zip(latched, (problem, chain(STEPS))):
        publisher.publish(String(text))
    questions = {
        "why": ("why", "(step7 p7 p8)"),
        "waiting": ("waiting", "(step3 p3 p4)"),
        "failed": ("failed", ""),
        "so, holds": ("so", "(at p1)"),
        "so, does not hold": ("so", "(blocked p2)"),
        "doing": ("doing", ""),
    }
    return {name: time_ms(asking("", *asked), REPEATS) for name, asked in questions.items()}


def restaurant(master: RosMaster) -> Dict[str, Any]:
    """Questions that plan."""
    space, goals = "/restaurant", [f"(checked table_{number})" for number in range(1, 5)]
    components = {KB: "knowledge_base", "rosplan_planner_interface": "planner_interface"}
    master.set_params(
        {
            f"{space}/{KB}/domain_path": str(RESTAURANT / "domain.pddl"),
            f"{space}/{KB}/problem_path": str(RESTAURANT / "problem.pddl"),
            f"{space}/rosplan_planner_interface/domain_path": str(RESTAURANT / "domain.pddl"),
            f"{space}/planning_system/components": components,
        }
    )
    master.node("merlin_rosplan", "planning_system", "planning_system", {}, f"__ns:={space}")
    master.node("merlin_explain", "explain", "merlin_explain", {}, f"__ns:={space}")
    for service in (f"{KB}/apply_effects", "rosplan_planner_interface/preview_plan", "merlin/explain"):
        master.wait_for_service(f"{space}/{service}")
    questions: Dict[str, Dict[str, Any]] = {
        "why not": {"question": "why_not", "first": goals[2:3], "goals": goals},
        "no plan": {"question": "no_plan", "goals": ["(robot_at anywhere)", *goals]},
        "what if": {"question": "what_if", "facts": goals[:1], "goals": goals},
    }
    return {name: time_ms(asking(space, **asked), PLANNED, warm_up=1) for name, asked in questions.items()}


def measure() -> Dict[str, Any]:
    """The figures."""
    with tempfile.TemporaryDirectory(prefix="merlin_bench_") as name:
        monitor = Monitor(Path(name) / "history.sqlite")
        monitor.write()
        with RosMaster() as master:
            rospy.init_node("bench_explain", anonymous=True, disable_signals=True)
            try:
                return {
                    "explain_ms": history(master, monitor, Path(name)),
                    "explain_planned_ms": restaurant(master),
                }
            finally:
                monitor.close()
