# SPDX-License-Identifier: Apache-2.0
"""The world of :mod:`simulation` with nodes: planning system, action interfaces, and a clock that runs fast.

The domains of all cases are one: an operator's name begins with the number of its case.
"""

import contextlib
import re
import subprocess
import tempfile
import threading
import time
from pathlib import Path
from typing import Any, Callable, Dict, Iterator, List, Sequence
from unittest import mock

import rospy
from cases import FACTS, Case, plan_of, sections
from merlin_msgs.msg import DispatchStatus
from merlin_msgs.srv import ListExecutions
from pddl21 import Model, State
from rosgraph_msgs.msg import Clock
from rosplan_dispatch_msgs.msg import ActionDispatch
from rosplan_dispatch_msgs.srv import DispatchService, ParsingService
from rosplan_knowledge_msgs.msg import DomainFormula
from semantics import Event

from merlin_actions import action_interface
from merlin_actions.action_interface import ActionInterface
from merlin_actions.core.ending import Closing, Ending
from merlin_actions.effects import effects_of
from merlin_pddl.plan_text import OUTDATED
from merlin_planning.knowledge_client import ADD, REMOVE, Update, fact, function_value, knowledge_client
from merlin_ros.ros_alarm import RosAlarm
from merlin_test import LONG
from merlin_test.node_path import node_path
from merlin_test.topic_links import patient_service, wait_for_publishers

KB = "/rosplan_knowledge_base"
TICK = 0.01  # s of wall time
KINDS = ("simple", "esterel")
APART = 300.0  # s of ROS time between two runs: every timed change of the one before has come


class FastClock:
    """Publishes /clock, `factor` times as fast as the wall's."""

    def __init__(self) -> None:
        self.factor = 1.0
        self._lock = threading.Lock()  # guards the field below
        self._now = 1000.0
        self._stopped = threading.Event()
        self._publisher = rospy.Publisher("/clock", Clock, queue_size=1)
        threading.Thread(target=self._run, name="clock", daemon=True).start()

    def jump(self, seconds: float) -> None:
        """Skips some time."""
        with self._lock:
            self._now += seconds

    def stop(self) -> None:
        """Ends it."""
        self._stopped.set()

    def _run(self) -> None:
        last = time.monotonic()
        while not self._stopped.wait(TICK):
            now = time.monotonic()
            with self._lock:
                self._now += min(now - last, 2 * TICK) * self.factor  # a process that starves misses nothing
                self._publisher.publish(Clock(rospy.Time.from_sec(self._now)))
            last = now


def named(case: Case, number: int) -> Case:
    """A case whose operators have names of their own."""
    name = f"c{number}_"
    domain = re.sub(r"\((:action|:durative-action) ", rf"(\1 {name}", case.domain)
    plan = re.sub(r"(^|\|)(\S+) ", rf"\1\2 {name}", case.plan)
    return case._replace(domain=domain, plan=plan)


class Recorded:
    """The effects of an interface; writes down when they came true, in the order of their transactions."""

    lock = threading.Lock()  # held during a transaction
    of_run: "Run"

    def __init__(self, effects: Any) -> None:
        self._effects = effects

    def open(self, opening: Any) -> None:
        with self.lock:
            self._effects.open(opening)
            number = int(opening.token.split("/")[1])
            if self.of_run.changes_at_start(number):
                self.of_run.note("start", number)

    def close(self, opening: Any, closing: Closing, *on_gone: Callable[[], None]) -> None:
        with self.lock:
            self._effects.close(opening, closing, *on_gone)
            if closing is Closing.END:
                self.of_run.note("end", int(opening.token.split("/")[1]))


class Interface(ActionInterface):
    """Lasts as long as its run says."""

    concurrent = True
    of_run: "Run"

    def __init__(self, *names: str) -> None:
        def record(*given: Any) -> Recorded:
            self.recorded = Recorded(effects_of(*given))
            return self.recorded

        with mock.patch.object(action_interface, "effects_of", record):
            super().__init__(*names)

    def start(self) -> None:
        """Serves, notes the begin of actions, and keeps its publishers."""
        self.publishers: List[rospy.Publisher] = []
        publisher, subscriber = rospy.Publisher, rospy.Subscriber

        def advertise(*args: Any, **options: Any) -> rospy.Publisher:
            self.publishers.append(publisher(*args, **options))
            return self.publishers[-1]

        def subscribe(name: str, kind: type, callback: Callable[[Any], None], **options: Any) -> Any:
            def receive(message: Any) -> None:
                if kind is ActionDispatch:
                    self.note(message)
                callback(message)

            return subscriber(name, kind, receive, **options)

        with mock.patch.object(rospy, "Publisher", advertise), mock.patch.object(
            rospy, "Subscriber", subscribe
        ):
            super().start()

    def run(self, execution: Any) -> Ending:
        over = threading.Event()
        alarm = RosAlarm(over.set, execution.text)
        execution.interruptible(over.set)
        alarm.set(rospy.get_time() + self.of_run.durations[execution.dispatch.action_id])
        over.wait()
        alarm.shutdown()
        return Ending(not execution.cancelled.is_set(), "cancelled" if execution.cancelled.is_set() else "")

    def serve(self, run: "Run") -> None:
        """Belongs to a run from now on."""
        self.of_run = self.recorded.of_run = run

    def note(self, dispatch: ActionDispatch) -> None:
        """Notes that an action begins, where nothing but its conditions begins."""
        # All that the start of some actions is, are conditions: they were checked just now. What made
        # them true may be a transaction whose answer is still under way.
        if dispatch.name == self.operator and not self.of_run.changes_at_start(dispatch.action_id):
            with Recorded.lock:
                self.of_run.note("start", dispatch.action_id)


class Run:
    """One dispatch of a case.

    :param model: of the case.
    :param durations: s of each action, by number.
    """

    def __init__(self, case: Case, model: Model, durations: Sequence[float]) -> None:
        self.steps = plan_of(case)
        self.actions = [model.ground(step.name, step.arguments) for step in self.steps]
        self.durations = durations
        self.began = rospy.get_time()
        self.success = False
        self.reason = ""
        self.state = State()
        self.open: List[Any] = []
        self._events: List[Event] = []
        self._model = model

    def changes_at_start(self, number: int) -> bool:
        """Whether an action has start effects."""
        return self.actions[number].durative and bool(self.actions[number].effects["start"])

    def note(self, kind: str, number: int) -> None:
        """A start or an end has come true."""
        self._events.append(Event(rospy.get_time() - self.began, kind, number))

    @property
    def events(self) -> List[Event]:
        """What happened, with the timed changes that came before the last of it."""
        last = max((event.time for event in self._events), default=0.0)
        timed = [Event(t.time, "timed", n) for n, t in enumerate(self._model.timed) if t.time <= last]
        return sorted([*timed, *self._events], key=lambda event: event.time)


class NodeWorld:
    """A planning system in a process of its own, with both parsers and dispatchers.

    :param cases: the domains that it has to know.
    """

    def __init__(self, cases: Sequence[Case]) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="merlin_conformance_")
        folder = Path(self._folder.name)
        domain = f"(define (domain d) (:requirements :adl :durative-actions) {sections('')}"
        (folder / "domain.pddl").write_text(domain + "".join(case.domain for case in cases) + ")")
        (folder / "problem.pddl").write_text("(define (problem p) (:domain d) (:init) (:goal (and)))")
        rospy.set_param(f"{KB}/domain_path", str(folder / "domain.pddl"))
        rospy.set_param(f"{KB}/problem_path", str(folder / "problem.pddl"))
        components, remaps = {"rosplan_knowledge_base": "knowledge_base"}, []
        for kind in KINDS:
            components[f"{kind}_parser"] = f"{kind}_plan_parser"
            components[f"{kind}_dispatcher"] = f"{kind}_plan_dispatcher"
            remaps.append(f"{kind}_dispatcher/complete_plan:={kind}_parser/complete_plan")
        rospy.set_param("/planning_system/components", components)
        command = node_path("merlin_rosplan", "planning_system")
        self._process = subprocess.Popen([command, "__name:=planning_system", *remaps])
        self.clock = FastClock()
        self._changed = threading.Condition()  # guards the fields below
        self._announced: Dict[str, int] = {}
        self._reasons: Dict[int, str] = {}
        self._statuses: List[DispatchStatus] = []
        topic = f"{KB}/pddl_action_parameters"
        announcements = rospy.Subscriber(topic, DomainFormula, self._hear)
        statuses = [
            rospy.Subscriber(f"/{kind}_dispatcher/dispatch_status", DispatchStatus, self._tell)
            for kind in KINDS
        ]
        self._subscribers = [announcements, *statuses]
        self._knowledge = knowledge_client(KB)
        self._parse = {k: patient_service(f"/{k}_parser/parse_plan_from_file", ParsingService) for k in KINDS}
        self._dispatch = {
            k: patient_service(f"/{k}_dispatcher/dispatch_plan", DispatchService) for k in KINDS
        }
        self._executions = patient_service(f"{KB}/executions", ListExecutions)
        waiting = [self._knowledge, *self._parse.values(), *self._dispatch.values()]
        assert all(each.wait(LONG) for each in waiting), "the planning system does not come up"
        wait_for_publishers(*statuses)  # else the first dispatch may begin and end unheard

    def close(self) -> None:
        """Ends it."""
        self.clock.stop()
        self._process.terminate()
        self._process.wait(LONG)
        self._folder.cleanup()

    def _hear(self, formula: DomainFormula) -> None:
        with self._changed:
            self._announced[formula.name] = self._announced.get(formula.name, 0) + 1
            self._changed.notify_all()

    def _tell(self, status: DispatchStatus) -> None:
        with self._changed:
            self._statuses.append(status)
            self._changed.notify_all()

    @contextlib.contextmanager
    def interfaces(self, case: Case, kind: str) -> Iterator[List[Interface]]:
        """Interfaces of a case's operators."""
        names = sorted({step.name for step in plan_of(case)})
        with self._changed:
            for name in names:
                self._announced.pop(name, None)
        topics = f"/{kind}_dispatcher/action_dispatch", f"/{kind}_dispatcher/action_feedback"
        found = [Interface(name, KB, *topics) for name in names]
        try:
            for interface in found:
                interface.start()
            with self._changed:  # an announced bridge takes what comes
                there = self._changed.wait_for(lambda: all(name in self._announced for name in names), LONG)
            assert there, f"{names}: {self._announced}"
            yield found
        finally:
            for interface in found:
                interface.shutdown()
                for publisher in interface.publishers:
                    publisher.unregister()

    def run(
        self, case: Case, model: Model, kind: str, interfaces: Sequence[Interface], durations: Sequence[float]
    ) -> Run:
        """Has a case dispatched."""
        self.clock.jump(APART)
        moved = rospy.get_time() + APART / 2
        while rospy.get_time() < moved:
            rospy.rostime.wallsleep(TICK)
        run = Run(case, model, durations)
        for interface in interfaces:
            interface.serve(run)
        self._bring_about(model, run.began)
        plan = Path(self._folder.name) / "plan"
        plan.write_text("".join(f"{s.time:.3f}: {s} [{s.duration:.3f}]\n" for s in run.steps) or "; empty\n")
        assert self._parse[kind](plan_path=str(plan)).plan_parsed, plan.read_text()
        with self._changed:
            self._statuses.clear()
        run.success = self._dispatch[kind]().success
        with self._changed:
            assert self._changed.wait_for(self._has_ended, LONG), self._statuses
            run.reason = self._statuses[-1].reason
        run.open = self._executions("").executions
        run.state = self._state()
        return run

    def _has_ended(self) -> bool:
        """Whether the statuses of a whole dispatch have come; one of the dispatch before may come late.

        A plan that does not fit the world from the beginning is never RUNNING.
        """
        states = [status.state for status in self._statuses]
        began = DispatchStatus.RUNNING in states or any(OUTDATED in s.reason for s in self._statuses)
        return began and states[-1] == DispatchStatus.IDLE

    def _bring_about(self, model: Model, now: float) -> None:
        updates = [Update(REMOVE, fact(name)) for name in FACTS]
        updates += [Update(ADD, fact(*key)) for key in model.initial.facts]
        for name in ("x", "y"):
            updates.append(Update(ADD, function_value(name, [], model.initial.values.get((name,), 0.0))))
        for time_, effect in model.timed:
            if effect[0] == "=":
                item = function_value(effect[1][0], [], float(effect[2]))
            else:
                item = fact(effect[-1][0] if effect[0] == "not" else effect[0])
                item.is_negative = effect[0] == "not"
            item.initial_time = rospy.Time.from_sec(now + time_)
            updates.append(Update(ADD, item))
        self._knowledge.update(updates)

    def _state(self) -> State:
        now = rospy.Time.now()
        facts = {
            (item.attribute_name,)
            for item in self._knowledge.propositions()
            if item.initial_time <= now and not item.is_negative
        }
        values = {(item.attribute_name,): item.function_value for item in self._knowledge.functions()}
        return State(facts, values)
