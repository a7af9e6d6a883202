"""How long deadlines are."""

import math
import threading
from types import SimpleNamespace

import pytest
from merlin_msgs.msg import SimStatus

from merlin_ros import deadline
from merlin_ros.deadline import Deadline, limit


@pytest.mark.parametrize("seconds", [0.0, -1.0])
def test_zero_has_passed(seconds):
    assert Deadline(seconds).expired
    assert not Deadline(seconds).wait_event(threading.Event())
    with threading.Condition() as condition:
        assert not Deadline(seconds).wait(condition, lambda: False)


def test_none_never_passes():
    assert Deadline(None).remaining() == math.inf


def test_what_holds_already_is_no_matter_of_time():
    happened = threading.Event()
    happened.set()
    assert Deadline(0.0).wait_event(happened)


def test_a_parameter_of_zero_is_no_limit():
    assert [limit(seconds) for seconds in (2.0, 0.0, -1.0)] == [2.0, None, None]


class Clock:
    """The monotonic clock, set by a test."""

    now = 100.0

    def monotonic(self):
        return self.now


@pytest.fixture
def watch(monkeypatch):
    """A watch of a simulator to which the connection is open, and the clock."""
    clock = Clock()
    monkeypatch.setattr(deadline, "time", clock)
    made = deadline._PauseWatch()
    made._started = True
    connection = SimpleNamespace(socket=object())
    made._subscriber = SimpleNamespace(impl=SimpleNamespace(connections=[connection]))
    return made, connection, clock


def test_time_stands_still_while_the_simulator_is_paused(watch):
    paused, _, clock = watch
    paused._update(SimStatus(paused=True))
    clock.now += 5.0
    assert paused.paused_time() == 5.0
    paused._update(SimStatus(paused=False))
    clock.now += 5.0
    assert paused.paused_time() == 5.0


def test_time_goes_on_when_a_paused_simulator_has_ended(watch):
    paused, connection, clock = watch
    paused._update(SimStatus(paused=True))
    clock.now += 5.0
    connection.socket = None
    assert paused.paused_time() == 5.0
    clock.now += 7.0
    assert paused.paused_time() == 5.0
    connection.socket = object()
    paused._update(SimStatus(paused=True))  # of the next one
    clock.now += 1.0
    assert paused.paused_time() == 6.0
