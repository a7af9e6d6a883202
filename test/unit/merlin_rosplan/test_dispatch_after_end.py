"""Who hears of the end of a dispatch may have the next one dispatched at once."""

import threading
from types import SimpleNamespace
from typing import Any, List, Optional

import pytest

from merlin_rosplan.dispatch.dispatch import DispatchReport, DispatchState
from merlin_rosplan.dispatcher import plan_dispatcher
from merlin_rosplan.dispatcher.plan_dispatcher import PlanDispatcher

LONG = 60.0


class State(threading.Condition):
    """Tells that a thread waits."""

    def __init__(self) -> None:
        super().__init__()
        self.looked = threading.Event()

    def wait(self, timeout: Optional[float] = None) -> bool:
        self.looked.set()
        return super().wait(timeout)


class Dispatcher(PlanDispatcher):
    """Dispatches nothing; calls `on_told` when it tells the end."""

    def __init__(self) -> None:
        self.scope, self._state = "/dispatcher", State()
        self._busy, self._ending = True, False
        self._limits = SimpleNamespace(cancel=LONG)
        self._owner = SimpleNamespace(end=lambda: None)
        self._topics = SimpleNamespace(tell_status=lambda report: self.on_told())

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


def test_one_that_runs_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    dispatcher: Any = Dispatcher()
    assert dispatcher._occupy(None) is False
