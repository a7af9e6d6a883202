# SPDX-License-Identifier: Apache-2.0
"""The parts of a robot that a mission talks to, without ROS: knowledge, Executor, action servers, topics."""

import itertools
import math
import threading
import time
from typing import Any, Callable, Dict, List, Optional, Sequence, Tuple

import pytest
import rospy
from actionlib_msgs.msg import GoalStatus
from merlin_msgs.msg import (
    ExecuteResult,
    ExecutorStatus,
    GoalQueue,
    KnowledgeChanges,
    MissionStatus,
    RobotWay,
)
from rosplan_knowledge_msgs.msg import KnowledgeItem

from merlin_actions import robot_places
from merlin_executor.mission import goal_dispatcher, mission_node
from merlin_planning.knowledge_text import to_pddl
from merlin_sm.rosplan_assistant import MerlinROSPlanAssistant
from merlin_sm.states import action_state, wait

SUCCEEDED = ExecuteResult(outcome=ExecuteResult.SUCCEEDED)


class Unheard:
    """Where health would be published."""

    def __init__(self, checks: Any) -> None:
        self._checks = checks

    def start(self) -> None:
        for check in self._checks.values():
            check()


_NUMBERS = itertools.count()


class Ended:
    """A request or goal; it ends when it has a result."""

    def __init__(
        self, on_done: Optional[Callable[[Any], None]], on_cancel: Callable[["Ended"], None]
    ) -> None:
        self.result: Any = None
        self.status = GoalStatus.ACTIVE
        self.text = self.said = ""
        self.ended_at = math.nan
        self.id = str(next(_NUMBERS))
        self._on_done = on_done
        self._on_cancel = on_cancel
        self._ended = threading.Event()
        self._own = False

    @property
    def taken_back(self) -> bool:
        return getattr(self.result, "outcome", None) == ExecuteResult.CANCELLED and not self._own

    def end(self, result: Any, status: int = GoalStatus.SUCCEEDED) -> None:
        if not self._ended.is_set():
            self.result, self.status = result, status
            self._ended.set()
            if self._on_done is not None:
                self._on_done(self)

    def wait(self, timeout: Optional[float] = None) -> bool:
        # A timeout of the mission is over at once.
        return self._ended.is_set() if timeout is not None else self._ended.wait()

    def cancel(self) -> None:
        self._own = True
        self._on_cancel(self)

    leave = cancel


class FakeServer:
    """A client of an action server that ends each goal with the next of `results`, and then none any more."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.results: List[Any] = []

    def wait_for_server(self, *_: Any) -> bool:
        return True

    def send(self, goal: Any, on_done: Callable[[Any], None], owner: Optional[str]) -> Ended:
        sent = Ended(on_done, lambda it: it.end(None, GoalStatus.PREEMPTED))
        if self.results:
            sent.end(self.results.pop(0))
        return sent


class FakeRobot:
    """Facts, and an Executor that makes a goal true at once."""

    name = "/merlin/execute"
    reason = ""

    def __init__(self) -> None:
        self.known: List[str] = []
        self.things: Dict[str, List[str]] = {}
        self.sent: List[Tuple[str, int]] = []
        self._requests: List[Ended] = []
        self.results: Dict[str, ExecuteResult] = {}
        self.never: Sequence[str] = ()
        self.on_goal: Callable[[str], None] = lambda goal: None
        self.servers: Dict[str, FakeServer] = {}
        self.parameters: Dict[str, Any] = {}
        self.waited: List[Any] = []
        self.missing: Optional[Exception] = None
        self.absent = False  # whether there is no Executor
        self.awaited = threading.Event()  # set while it is waited for
        self.published: List[MissionStatus] = []
        self.services: Dict[str, Callable[[Any], Any]] = {}
        self.at_shutdown: List[Callable[[], None]] = []
        self.down = False
        self.on_change: List[Callable[[Any], None]] = []
        self.on_way: List[Callable[[Any], None]] = []
        self.on_status: List[Callable[[Any], None]] = []
        self.on_queue: List[Callable[[Any], None]] = []
        self._lock = threading.Lock()  # keeps a change whole: branches of a mission change facts at once

    # --- the knowledge ----------------------------------------------------------------------------------

    def facts(self, predicate: str) -> List[str]:
        return sorted(fact for fact in self.known if fact.strip("()").split()[0] == predicate)

    def change(self, add: Any = (), remove: Any = ()) -> None:
        listed = [[texts] if isinstance(texts, str) else list(texts) for texts in (add, remove)]
        with self._lock:
            self.known = [fact for fact in self.known if fact not in listed[1]] + listed[0]
        for callback in self.on_change:
            callback(KnowledgeChanges())

    def add_objects(self, kind: str, *names: str) -> None:
        self.things[kind] = [*self.things.get(kind, []), *names]

    # --- the Executor -----------------------------------------------------------------------------------

    def wait_for_executor(self, timeout: float, unless: Callable[[], bool] = lambda: False) -> bool:
        while self.absent and not unless():
            self.awaited.set()
            time.sleep(0.01)
        return not self.absent

    def send(
        self, goals: Any, priority: int = 0, on_interrupt: int = 0, on_done: Any = None, **_: Any
    ) -> Ended:
        request = Ended(on_done, self._cancel)
        self._requests.append(request)
        listed = [goals] if isinstance(goals, (str, KnowledgeItem)) else goals
        for goal in [to_pddl(goal) if isinstance(goal, KnowledgeItem) else goal for goal in listed]:
            self.sent.append((goal, priority))
            self.on_goal(goal)
            if goal in self.never:
                return request
            if goal in self.results:
                request.end(self.results[goal])
                return request
            self.change(add=goal)
        request.end(SUCCEEDED)
        return request

    def operator_cancels(self) -> None:
        """Ends the requests as another node does that cancels them."""
        for request in self._requests:
            self._cancel(request)

    def held(self, waits: str, state: int = ExecutorStatus.IDLE) -> None:
        """The Executor waits for a release, or no longer.

        :param state: of what was sent last.
        """
        request = "" if state == ExecutorStatus.IDLE else self._requests[-1].id
        for callback in self.on_status:
            callback(ExecutorStatus(waits=waits, state=state, request=request))

    def cancel_all(self) -> None:
        for request in self._requests:
            request.cancel()

    @property
    def goals(self) -> List[str]:
        """The goals that were sent."""
        return [goal for goal, _ in self.sent]

    def _cancel(self, request: Ended) -> None:
        request.end(ExecuteResult(outcome=ExecuteResult.CANCELLED, reason="cancelled"))

    # --- the node ---------------------------------------------------------------------------------------

    def shut_down(self) -> None:
        """What SIGINT does."""
        self.down = True
        for hook in self.at_shutdown:
            hook()

    def wait_for_robot(self, *arguments: Any) -> None:
        self.waited.append(arguments)
        if self.missing is not None:
            raise self.missing


def put_in_place(robot: FakeRobot, monkeypatch: pytest.MonkeyPatch) -> None:
    """Has missions talk to this robot."""

    class Publisher:
        def __init__(self, _: str, kind: type, **__: Any) -> None:
            # A machine that is a mission says in a thread of its own where it may be held.
            self.publish = robot.published.append if kind is MissionStatus else lambda _: None

    class Alarm:
        def __init__(self, _: float, call: Callable[[], None], name: str) -> None:
            call()  # a patience of the mission is over at once

        def shutdown(self) -> None:
            pass

    class Service:
        def __init__(self, name: str, _: Any, handler: Callable[[Any], Any]) -> None:
            robot.services[name] = handler

        def shutdown(self, reason: str) -> None:
            pass

    class Shown:
        def stop(self) -> None:
            pass

    class Subscription:
        def unregister(self) -> None:
            pass

    def subscribe(topic: str, kind: type, callback: Callable[[Any], None], *_: Any, **__: Any) -> Any:
        if kind is ExecutorStatus:
            robot.on_status.append(callback)
        if kind is GoalQueue:
            robot.on_queue.append(callback)
        if kind is KnowledgeChanges:
            robot.on_change.append(callback)
        if kind is RobotWay:
            robot.on_way.append(callback)
        return Subscription()

    def server(name: str, *_: Any) -> FakeServer:
        return robot.servers.setdefault(name, FakeServer(name))

    assistant = MerlinROSPlanAssistant
    monkeypatch.setattr(assistant, "facts", lambda self, predicate: robot.facts(predicate))
    monkeypatch.setattr(assistant, "holds", lambda self, fact: fact in robot.known)
    monkeypatch.setattr(assistant, "objects", lambda self, kind: robot.things.get(kind, []))
    monkeypatch.setattr(assistant, "add_objects", lambda self, kind, *names: robot.add_objects(kind, *names))
    monkeypatch.setattr(assistant, "change_facts", lambda self, add=(), remove=(): robot.change(add, remove))
    monkeypatch.setattr(assistant, "knowledge", "the knowledge base")
    monkeypatch.setattr(action_state, "shared_client", server)
    monkeypatch.setattr(goal_dispatcher, "MerlinExecutorClient", lambda **_: robot)
    monkeypatch.setattr(goal_dispatcher, "start_introspection", lambda *_: Shown())
    monkeypatch.setattr(robot_places, "get_param", lambda name, default: robot.parameters.get(name, default))
    monkeypatch.setattr(mission_node, "wait_for_robot", robot.wait_for_robot)
    monkeypatch.setattr(mission_node, "is_shutdown_requested", lambda: robot.down)
    monkeypatch.setattr(mission_node, "HealthReporter", Unheard)
    monkeypatch.setattr(rospy, "Publisher", Publisher)
    monkeypatch.setattr(rospy, "Service", Service)
    for module in (goal_dispatcher, wait):
        monkeypatch.setattr(module, "call_after", Alarm)
    monkeypatch.setattr(rospy, "Subscriber", subscribe)
    monkeypatch.setattr(rospy.Time, "now", rospy.Time)
    monkeypatch.setattr(rospy, "get_time", lambda: 0.0)
    monkeypatch.setattr(rospy, "on_shutdown", robot.at_shutdown.append)
    monkeypatch.setattr(rospy, "get_param", lambda name, default=None: robot.parameters.get(name, default))
