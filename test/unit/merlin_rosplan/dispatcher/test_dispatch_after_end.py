# SPDX-License-Identifier: Apache-2.0
"""Between two plans: a client that gets the end of one can start the next at once, and cancel it."""

import threading
from types import SimpleNamespace
from typing import Any, List, Optional

import pytest
from diagnostic_msgs.msg import KeyValue
from rosplan_dispatch_msgs.msg import ActionFeedback

from merlin_rosplan.dispatch.dispatch import DispatchReport, DispatchState
from merlin_rosplan.dispatcher import plan_dispatcher
from merlin_rosplan.dispatcher.plan_dispatcher import PlanDispatcher

LONG = 60.0


class State(threading.Condition):
    """Sets an event when a thread waits."""

    def __init__(self) -> None:
        super().__init__()
        self.looked = threading.Event()

    def wait(self, timeout: Optional[float] = None) -> bool:
        self.looked.set()
        return super().wait(timeout)


class Dispatcher(PlanDispatcher):
    """Dispatches nothing; calls `on_told` when it publishes the end."""

    def __init__(self) -> None:
        self.scope, self._state = "/dispatcher", State()
        self._busy, self._ending = True, False
        self._limits = SimpleNamespace(cancel=LONG)
        self._begun = 0
        self._topics = SimpleNamespace(report_status=lambda report: self.on_told())

    closed = False

    def _run_plan(self) -> DispatchReport:
        return DispatchReport(DispatchState.SUCCEEDED, "")

    def _judged(self, report: DispatchReport) -> DispatchReport:
        return report

    def on_told(self) -> None:
        """To be replaced."""


def test_one_that_has_told_its_end_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plan_dispatcher.rospy, "loginfo", lambda *text: None)
    dispatcher = Dispatcher()
    taken: List[bool] = []

    def dispatch() -> None:
        taken.append(dispatcher._occupy(None))
        dispatcher._state.looked.set()

    caller = threading.Thread(target=dispatch, daemon=True)

    def told() -> None:
        caller.start()
        assert dispatcher._state.looked.wait(LONG)

    dispatcher.on_told = told  # type: ignore[method-assign]
    dispatcher._run()
    caller.join(LONG)
    assert taken == [True]


class Dispatch:
    """One run of a plan."""

    plan_id = 1

    def __init__(self, *_: Any, **__: Any) -> None:
        self.reason = ""

    def cancel(self, reason: str) -> None:
        self.reason = reason

    def run(self) -> DispatchReport:
        return DispatchReport(
            DispatchState.CANCELLED if self.reason else DispatchState.SUCCEEDED, self.reason
        )


class Beginning(Dispatcher):
    """Is told to cancel while it takes the plan."""

    _run_plan = PlanDispatcher._run_plan  # type: ignore[assignment]

    def __init__(self) -> None:
        super().__init__()
        self._busy, self._unwanted, self._dispatch, self._goal = False, False, None, None
        self._breakpoints = self._plan = None  # type: ignore[assignment]
        self._missed, self._watches_rest = frozenset(), False
        self._settler = SimpleNamespace(settle=lambda plan_id, actions: None)
        self._topics = SimpleNamespace(
            report_status=lambda report: None, begin=lambda owner: 1, unanswered=lambda: []
        )
        self.cancels = 0

    def _take_plan(self) -> Any:
        if self.cancels:
            self.cancels -= 1
            self._serve_cancel(None)  # type: ignore[arg-type]
        return None

    def make_schedule(self, plan: Any) -> Any:
        return None


def test_a_cancel_while_the_plan_is_taken_is_not_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plan_dispatcher.rospy, "loginfo", lambda *text: None)
    monkeypatch.setattr("merlin_rosplan.dispatch.dispatch.PlanDispatch", Dispatch)
    dispatcher = Beginning()
    dispatcher._serve_cancel(None)  # type: ignore[arg-type]  # a stray one, with nothing to cancel
    dispatcher.cancels = 1
    assert dispatcher._occupy(None)
    assert dispatcher._run().state is DispatchState.CANCELLED
    assert dispatcher._occupy(None)
    assert dispatcher._run().state is DispatchState.SUCCEEDED


def test_one_that_runs_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    dispatcher: Any = Dispatcher()
    assert dispatcher._occupy(None) is False


def test_an_interface_that_says_that_its_action_did_not_stop_is_heard() -> None:
    dispatcher, heard = Dispatcher(), []  # type: Any, List[Any]
    dispatcher._dispatch, dispatcher._goal = SimpleNamespace(plan_id=1, put=heard.append), None
    dispatcher._topics = SimpleNamespace(answered=lambda number: None)
    for stopped in ("no", ""):
        said = [KeyValue("reason", "why"), KeyValue("stopped", stopped)]
        dispatcher._receive_feedback(ActionFeedback(3, 1, ActionFeedback.ACTION_FAILED, said))
    assert [event.unstopped for event in heard] == [True, False]
