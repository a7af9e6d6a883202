# SPDX-License-Identifier: Apache-2.0
"""The state that waits: it ends with its time, or at once when it is preempted, whatever the clock does."""

import threading
from typing import Any, List

import pytest
import rospy

from merlin_sm.states.merlin_state import ABORTED, PREEMPTED, SUCCEEDED
from merlin_sm.states.wait import WaitState
from merlin_test import LONG
from smach import UserData


class Runner:
    """Runs a state in a thread of its own, up to its wait."""

    def __init__(self, state: WaitState, monkeypatch: pytest.MonkeyPatch) -> None:
        waits = threading.Event()
        interruptible = state.interruptible
        monkeypatch.setattr(state, "interruptible", lambda end: (interruptible(end), waits.set()))
        self.ends: List[str] = []
        self.thread = threading.Thread(
            target=lambda: self.ends.append(state.execute(UserData())), daemon=True
        )
        self.thread.start()
        assert waits.wait(LONG)

    def ended(self) -> List[str]:
        self.thread.join(LONG)
        return self.ends


def test_a_wait_ends_with_its_time(clock: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    runner = Runner(WaitState(2.5), monkeypatch)
    clock.set(102.4)
    assert runner.thread.is_alive()
    clock.set(102.5)
    assert runner.ended() == [SUCCEEDED]


def test_a_wait_ends_with_its_time_after_the_clock_has_jumped_back(
    clock: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    runner = Runner(WaitState(2.5), monkeypatch)
    clock.set(101.0)
    for tick in range(10, 100):  # below 100: which of them it sees is the scheduler's business
        clock.set(float(tick))
        runner.thread.join(0.3)
    assert runner.ended() == [SUCCEEDED]


def test_a_preempted_wait_ends_at_once_and_leaves_no_thread(
    clock: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    state = WaitState(3600.0)
    runner = Runner(state, monkeypatch)
    (alarm,) = [thread for thread in threading.enumerate() if thread.name == "wait of 3600 s"]
    state.request_preempt()
    assert runner.ended() == [PREEMPTED]
    alarm.join(LONG)
    assert not alarm.is_alive()


@pytest.mark.usefixtures("clock")
def test_a_wait_that_the_end_of_the_node_cuts_short_has_not_succeeded(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    state = WaitState(3600.0)
    runner = Runner(state, monkeypatch)
    monkeypatch.setattr(rospy, "is_shutdown", lambda: True)
    assert runner.ended() == [ABORTED] and "the node ended" in state.reason


@pytest.mark.parametrize("seconds", [-1.0, float("nan"), "3"])
def test_a_time_that_cannot_be_waited_is_refused(seconds: Any) -> None:
    with pytest.raises(ValueError, match="a number of seconds, 0 or more"):
        WaitState(seconds)
