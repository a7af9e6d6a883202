"""A dispatch whose dispatcher hangs: the wait for its end ends, also when no action answers any more."""

import threading
import time
from typing import List
from unittest import mock

import pytest
from merlin_msgs.msg import DispatchStatus

from merlin_ros import deadline
from merlin_ros.actions.lease import LeaseChange, LeaseState
from merlin_sm import dispatch_client
from merlin_sm.dispatch_client import DispatchClient
from merlin_sm.dispatching.kinds import ReportingDispatcher
from merlin_sm.dispatching.progress import DispatchProgress

LONG = 60.0
LOST = LeaseChange("7/plan", LeaseState.LOST, "its client /planning_system has been silent for 3.1 s")


class Client(DispatchClient):
    """Has dispatched a plan; its dispatcher takes no cancel."""

    def __init__(self) -> None:
        self.name, self.cancel_deadline = "/dispatcher", 0.02
        self._changed = threading.Condition()
        self._progress = DispatchProgress()
        self._kind = ReportingDispatcher(DispatchStatus(state=DispatchStatus.RUNNING))
        self._active = True
        self.held: List[str] = []
        self._watch = mock.Mock(goals_of=lambda owner: self.held)
        self._ended = self._cancelling = self._cancel_sent = self._requested = self._silent = False
        self._takers, self._stuck_after, self._goal = set(), 0.0, None
        self.calls: List[str] = []

    def _call_cancel(self) -> bool:
        self.calls.append("cancel")
        return False


@pytest.fixture
def client(monkeypatch: pytest.MonkeyPatch) -> Client:
    monkeypatch.setattr(deadline, "running_time", time.monotonic)
    monkeypatch.setattr(dispatch_client, "SLACK", 0.02)
    return Client()


def test_a_dispatcher_that_is_silent_is_cancelled_and_given_up(client: Client) -> None:
    ends: List[bool] = []
    waiting = threading.Thread(target=lambda: ends.append(client._wait_for_end()), daemon=True)
    waiting.start()
    client._dispatcher_changed(LOST)
    waiting.join(LONG)
    assert (ends, client.calls) == ([False], ["cancel"])


@pytest.mark.parametrize(
    "change", [LOST._replace(let_go=True), LOST._replace(state=LeaseState.SUSPENDED)], ids=["let go", "late"]
)
def test_one_that_lives_is_not(client: Client, change: LeaseChange) -> None:
    client._dispatcher_changed(change)
    client._ended = True
    assert client._wait_for_end() and client.calls == []


def test_the_lease_of_an_earlier_plan_does_not_count(client: Client) -> None:
    client._active = False
    client._dispatcher_changed(LOST)
    assert not client._silent


def test_one_that_was_restarted_and_carries_out_this_plan_is_not_silent(client: Client) -> None:
    client.held = ["1/plan"]
    client._dispatcher_changed(LOST)
    assert not client._silent
