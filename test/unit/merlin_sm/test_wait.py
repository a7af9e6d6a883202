"""The state that waits: it ends with its time, or at once when it is preempted."""

import threading
from typing import Any, Callable

import pytest
import rospy

from merlin_sm.states.merlin_state import PREEMPTED, SUCCEEDED
from merlin_sm.states.wait import WaitState
from smach import UserData


class Timer:
    """Stands in for rospy's timer: it fires when the test says so."""

    def __init__(self, period: rospy.Duration, callback: Callable[[Any], None], oneshot: bool) -> None:
        made.append((self, period.to_sec(), callback))
        begun.set()

    def shutdown(self) -> None:
        """Like that of rospy."""


made: list = []
begun = threading.Event()


@pytest.fixture(autouse=True)
def timers(monkeypatch: pytest.MonkeyPatch) -> None:
    made.clear()
    begun.clear()
    monkeypatch.setattr(rospy, "Timer", Timer)


@pytest.mark.parametrize("preempted", [False, True])
def test_a_wait_ends_with_its_time_or_a_preempt(preempted: bool) -> None:
    state, ends = WaitState(2.5), []
    runner = threading.Thread(target=lambda: ends.append(state.execute(UserData())))
    runner.start()
    begun.wait()
    ((_, seconds, fire),) = made
    assert seconds == 2.5
    if preempted:
        state.request_preempt()
    else:
        fire(None)
    runner.join()
    assert ends == [PREEMPTED if preempted else SUCCEEDED]


@pytest.mark.parametrize("seconds", [-1.0, float("nan")])
def test_a_time_that_cannot_be_waited_is_refused(seconds: float) -> None:
    with pytest.raises(ValueError, match="0 s or more"):
        WaitState(seconds)
