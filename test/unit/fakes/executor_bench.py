# SPDX-License-Identifier: Apache-2.0
"""An Executor over stages of the test's, without ROS around it."""

import tempfile
import threading
from types import SimpleNamespace
from typing import Any, Callable, Dict, List, Optional

import pytest
import rospy
from actionlib_msgs.msg import GoalStatus
from diagnostic_msgs.msg import KeyValue
from merlin_msgs.msg import ExecuteGoal, ExecuteResult

from merlin_executor.core.course import DISPATCH_PLAN
from merlin_executor.core.outcome import Outcome, Verdict, outcome_name
from merlin_executor.node import executor as executor_module
from merlin_executor.node.executor import Executor
from merlin_planning.dispatcher_kind import Hold
from merlin_ros.actions.lease import LeaseState
from merlin_ros.service_proxy import ServiceUnavailable
from merlin_test import LONG


class Goal:
    """A goal of the action server."""

    def __init__(self, *texts: str, **fields: Any) -> None:
        self.id = f"goal of {texts}"
        self.sender = "/client"
        self.goal = ExecuteGoal(goals=list(texts), **fields)
        self.status = GoalStatus.PENDING
        self.cancel_requested = False
        self.ends: List[tuple] = []
        self.reported: List[str] = []
        self.ended = threading.Event()

    def accept(self) -> None:
        self.status = GoalStatus.ACTIVE

    def feedback(self, feedback: Any) -> None:
        self.reported.append(feedback.reason)

    def _end(self, status: int, result: ExecuteResult) -> bool:
        self.ends.append((status, outcome_name(result.outcome), result.reason))
        self.ended.set()
        return True

    def succeed(self, result: ExecuteResult, text: str) -> bool:
        return self._end(GoalStatus.SUCCEEDED, result)

    def abort(self, result: ExecuteResult, text: str) -> bool:
        return self._end(GoalStatus.ABORTED, result)

    def cancelled(self, result: ExecuteResult, text: str) -> bool:
        return self._end(GoalStatus.PREEMPTED, result)

    def reject(self, result: ExecuteResult, text: str) -> bool:
        return self._end(GoalStatus.REJECTED, result)

    def end(self) -> tuple:
        assert self.ended.wait(LONG), "never answered"
        assert len(self.ends) == 1, self.ends
        return self.ends[0]


class Machine:
    """The stages: a run ends when the test says so, or with a cancel."""

    def __init__(self) -> None:
        self.begun: threading.Semaphore = threading.Semaphore(0)
        self.go_on = threading.Event()
        self.verdict: Any = Verdict(Outcome.SUCCEEDED)
        self.stopped = Verdict(Outcome.CANCELLED, "cancelled")
        self.unstoppable = self.revises = False
        self.running: List[Any] = []
        self.goals_removed = 0
        self.left = False
        self._cancelled = False

    def dispatch_changed(self) -> None:
        """The dispatch under way has changed."""

    def prepare(self) -> None:
        self._cancelled = False
        self.go_on.clear()

    def cancel(self) -> None:
        self._cancelled = True
        self.go_on.set()

    def revise(self) -> bool:
        return self.revises

    def run_requests(self, requests: Any) -> Verdict:
        assert not self.running, "two run"
        self.running += requests
        requests[0].course.enter(DISPATCH_PLAN, 0.0)
        self.begun.release()
        try:
            assert self.go_on.wait(LONG)
            if self._cancelled:
                if self.unstoppable:
                    return Verdict(Outcome.CANCEL_TIMEOUT, "(drive) did not stop")
                return self.stopped
            if isinstance(self.verdict, BaseException):
                raise self.verdict
            return self.verdict
        finally:
            self.running.clear()

    def clean_up(self) -> None:
        self.goals_removed += 1

    def end(self, verdict: Any) -> None:
        self.verdict = verdict
        self.go_on.set()


class Knowledge:
    """A knowledge base with one predicate."""

    name = "/kb"

    def __init__(self) -> None:
        self.error: Optional[BaseException] = None
        self.on_check: Callable[[], Any] = lambda: None

    def predicates(self) -> Dict[str, Any]:
        self.on_check()
        if self.error is not None:
            raise self.error
        return {"checked": SimpleNamespace(typed_parameters=[KeyValue(key="p", value="poi")])}

    def function_signatures(self) -> Dict[str, Any]:
        return {"battery": SimpleNamespace(typed_parameters=[])}

    def instances(self, type_name: str = "") -> List[str]:
        return ["kitchen", "hall"]


class Bench:
    """An Executor without ROS around it."""

    lost = LeaseState.LOST

    def __init__(self, monkeypatch: pytest.MonkeyPatch, goals_file: str = "") -> None:
        self.left: List[tuple] = []
        self.machine = Machine()
        self.knowledge = Knowledge()
        self.callbacks: Dict[str, Callable] = {}
        self.statuses: List[Any] = []
        if not goals_file:
            folder = tempfile.TemporaryDirectory()
            self._folder = folder  # as long as this lives
            goals_file = f"{folder.name}/goals"
        self.guard = SimpleNamespace(hold="", follow=self.follow_holds)

        def server(name: str, spec: type, *callbacks: Callable) -> Any:
            self.callbacks = dict(zip(("goal", "cancel", "owner", "own result"), callbacks))
            return SimpleNamespace(start=lambda left: self.left.extend(left), shutdown=lambda: None)

        self.dispatcher = SimpleNamespace(
            wait_status=lambda timeout: True, running=[], steps_done=0, succeeded=frozenset(), hold=Hold()
        )
        recovery = SimpleNamespace(rest=lambda *_: "")
        own = SimpleNamespace(remove_left=lambda: [])
        for name, made in (
            ("ActionServer", server),
            ("DispatchClient", self.make_dispatcher),
            ("Recovery", lambda *_: recovery),
            ("GuardClient", lambda *_, **__: self.guard),
            ("OwnGoals", lambda *_: own),
            ("LeaseHolder", lambda topic: None),
            ("offer_pause", self.serve_pause),
            ("BreakpointService", lambda *_: SimpleNamespace(offer=lambda name: None)),
            ("ExecutorSM", self.make_machine),
            ("start_introspection", lambda *_: SimpleNamespace(stop=lambda: None)),
            ("publish", lambda publisher, message: self.statuses.append(message)),
        ):
            monkeypatch.setattr(executor_module, name, made)
        monkeypatch.setattr(rospy, "Publisher", lambda *_, **__: None)
        self.now = 1.0
        monkeypatch.setattr(rospy.Time, "now", lambda: rospy.Time.from_sec(self.now))
        for level in ("loginfo", "logwarn", "logerr", "logwarn_throttle_identical"):
            monkeypatch.setattr(rospy, level, lambda *_: None)
        planning = SimpleNamespace(preview=self.preview)
        self.executor = Executor(self.knowledge, planning, goals_file=goals_file)  # type: ignore[arg-type]
        self.executor.start()

    def preview(self, **fields: Any) -> Any:
        raise ServiceUnavailable("there is no such service")

    def follow_holds(self, on_hold: Callable[[], None]) -> None:
        self.on_hold = on_hold

    def make_dispatcher(self, *arguments: Any) -> Any:
        self.on_dispatch = arguments[3]
        return self.dispatcher

    def dispatch(self, *actions: Any) -> None:
        """These actions are under way now."""
        self.dispatcher.running = list(actions)
        self.on_dispatch()

    def make_machine(self, *arguments: Any) -> Machine:
        self.engine = arguments[3]
        return self.machine

    def serve_pause(self, switch: Callable[[bool], None]) -> None:
        self.pause = switch

    def queue(self) -> List[Any]:
        """The requests of the last message on the queue."""
        return next(message.requests for message in reversed(self.statuses) if hasattr(message, "requests"))

    def status(self) -> Any:
        return next(message for message in reversed(self.statuses) if hasattr(message, "steps_total"))

    def send(self, goal: Goal) -> Goal:
        self.callbacks["goal"](goal)
        return goal

    def run(self, goal: Goal) -> Goal:
        self.send(goal)
        assert self.machine.begun.acquire(timeout=LONG)
        return goal

    def cancel(self, goal: Goal) -> None:
        goal.cancel_requested = True
        self.callbacks["cancel"](goal)
