"""A dispatch while another client's plan is carried out: that plan is left alone, and the wait has an end."""

import threading
import time
from typing import Any, Callable, List, Optional

import pytest
import rospy
from merlin_msgs.msg import DispatchStatus, Lease

from merlin_ros import deadline
from merlin_sm import dispatch_client
from merlin_sm.dispatch_client import INTERRUPTED, DispatchClient
from merlin_sm.dispatching.kinds import ReportingDispatcher
from merlin_sm.dispatching.owners import DispatchOwners
from merlin_sm.dispatching.progress import DispatchResult

LONG = 60.0


class Client(DispatchClient):
    """Hears of a plan that another client, which lives, has dispatched."""

    def __init__(self) -> None:
        self.name, self.cancel_deadline = "/dispatcher", LONG
        self._changed = threading.Condition()
        self._active = self._requested = False
        self._kind = ReportingDispatcher(DispatchStatus(state=DispatchStatus.RUNNING))
        self._owners = DispatchOwners("/me")
        self.calls: List[str] = []
        self.looks = 0
        self.owned = self.there = self.takes_cancel = True

    def available(self) -> bool:
        return True

    def _abandoned(self) -> bool:
        return not self.owned

    def _there(self) -> bool:
        self.looks += 1
        return self.there

    def _call_cancel(self) -> bool:
        self.calls.append("cancel")
        return self.takes_cancel

    def _dispatch_once(self, *_: Any) -> Any:
        self.calls.append("dispatch")


def test_nothing_is_dispatched_and_nothing_cancelled(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dispatch_client, "running_time", lambda: 0.0)
    monkeypatch.setattr(rospy, "is_shutdown", lambda: False)

    def interruptible(interrupt: Optional[Callable[[], None]]) -> None:
        if interrupt is not None:  # the preempt comes as soon as the wait begins
            interrupt()

    client = Client()
    result = client.dispatch(interruptible)
    assert client.calls == []
    assert result.cancelled and not result.gone and result.reason == INTERRUPTED


@pytest.fixture
def unlimited(monkeypatch: pytest.MonkeyPatch) -> Client:
    """A client whose cancels have no limit; a wait for a living owner is short here."""
    monkeypatch.setattr(deadline, "running_time", time.monotonic)
    monkeypatch.setattr(dispatch_client, "running_time", time.monotonic)
    monkeypatch.setattr(dispatch_client, "FOREIGN_WAIT", 0.05)
    monkeypatch.setattr(dispatch_client, "OWNER_LOOK", 0.001)
    monkeypatch.setattr(rospy, "is_shutdown", lambda: False)
    monkeypatch.setattr(rospy, "logwarn", lambda _: None)
    client = Client()
    client.cancel_deadline = 0.0
    return client


def test_the_plan_of_an_owner_that_lives_is_waited_for_with_an_end(unlimited: Client) -> None:
    unlimited._owners.heard(Lease(owner="/other", held=["its dispatch"]))
    reason = unlimited.free(lambda interrupt: None)
    assert reason == "the planning system's plan dispatcher /dispatcher carries out a plan of /other"
    assert unlimited.calls == []


def test_a_plan_without_owner_gets_all_the_time_to_stop(unlimited: Client) -> None:
    unlimited.owned = False

    def stops_late() -> bool:
        threading.Event().wait(0.2)  # well beyond the wait for an owner
        unlimited._receive_status(DispatchStatus(state=DispatchStatus.IDLE))
        return True

    unlimited._there = stops_late  # type: ignore[method-assign]
    unlimited._on_change = lambda: None
    assert unlimited.free(lambda interrupt: None) == ""
    assert unlimited.calls == ["cancel"]


def test_a_dispatcher_that_is_gone_is_not_waited_for(unlimited: Client) -> None:
    unlimited.owned = unlimited.there = False
    assert unlimited.free(lambda interrupt: None).endswith("/dispatcher is gone")


def test_a_dispatcher_that_takes_no_cancel_is_not_waited_for_without_end(unlimited: Client) -> None:
    unlimited.owned = unlimited.takes_cancel = False
    assert unlimited.free(lambda interrupt: None).endswith("carries out an earlier plan and does not stop")


def test_an_executor_that_starts_does_not_wait_without_end(unlimited: Client) -> None:
    unlimited.owned = False
    assert unlimited.free(lambda interrupt: None, 0.05).endswith("does not stop")


class OvertakenClient(Client):
    """Finds the dispatcher free, and then another client has been faster, again and again."""

    def __init__(self, clock: List[float]) -> None:
        super().__init__()
        self._clock = clock
        self._kind = ReportingDispatcher(DispatchStatus(state=DispatchStatus.IDLE))
        self._on_change = lambda: None
        self._owners.heard(Lease(owner="/other", held=["its dispatch"]))

    def _dispatch_once(self, *_: Any) -> DispatchResult:
        self.calls.append("dispatch")
        self._receive_status(DispatchStatus(state=DispatchStatus.RUNNING))
        self._clock[0] += 2 * LONG
        return DispatchResult(False, reason="the plan is being dispatched already")

    def _abandoned(self) -> bool:  # it waits for the other plan: that ends now
        self._receive_status(DispatchStatus(state=DispatchStatus.IDLE))
        return False


def test_plans_of_others_are_waited_for_once_in_all(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [0.0]
    for module in (deadline, dispatch_client):
        monkeypatch.setattr(module, "running_time", lambda: clock[0])
    monkeypatch.setattr(rospy, "is_shutdown", lambda: False)
    client = OvertakenClient(clock)
    result = client.dispatch(lambda interrupt: None)
    assert client.calls == ["dispatch"]
    assert result.reason.endswith("carries out a plan of /other")
