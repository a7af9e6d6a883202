# SPDX-License-Identifier: Apache-2.0
"""How long deadlines are."""

import math
import threading
import time
from types import SimpleNamespace

import pytest
from merlin_msgs.msg import SimStatus

from merlin_ros import deadline
from merlin_ros.alarms import LONGEST_TICK
from merlin_ros.deadline import Deadline, LookedAt, limit


@pytest.mark.parametrize("seconds", [0.0, -1.0])
def test_zero_has_passed(seconds):
    assert Deadline(seconds).expired
    assert not Deadline(seconds).wait_event(threading.Event())
    condition = threading.Condition()
    with condition:
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
    """The monotonic clock and that of ROS, set by a test."""

    now = 100.0
    ros = 7.0

    def monotonic(self):
        return self.now


class Simulator:
    """What this thread subscribes of a simulator, and the connection to it."""

    def __init__(self, monkeypatch, simulated=True):
        self.topics, self.connection = [], SimpleNamespace(socket=object())
        self._callbacks, self._thread = [], threading.current_thread()
        monkeypatch.setattr(deadline.rospy, "Subscriber", self._subscribe)
        monkeypatch.setattr(deadline.rospy.core, "is_initialized", lambda: True)
        monkeypatch.setattr(deadline.rospy.rostime, "is_rostime_initialized", lambda: True)
        monkeypatch.setattr(deadline.rospy.rostime, "is_wallclock", lambda: not simulated)

    def says(self, paused):
        for callback in self._callbacks:
            callback(SimStatus(paused=paused))

    def _subscribe(self, topic, _, callback, **__):
        if threading.current_thread() is self._thread:  # others may read the watch of the process
            self.topics.append(topic)
            self._callbacks.append(callback)
        return SimpleNamespace(impl=SimpleNamespace(connections=[self.connection]))


@pytest.fixture
def watch(monkeypatch):
    """A watch of a simulator, the simulator, and the clock."""
    clock = Clock()
    monkeypatch.setattr(deadline, "time", clock)
    monkeypatch.setattr(deadline.rospy, "get_time", lambda: clock.ros)
    made, simulator = deadline.PauseWatch(), Simulator(monkeypatch)
    assert made.paused_time() == 0.0  # it begins with its first reader
    return made, simulator, clock


def test_time_stands_still_while_the_simulator_is_paused(watch):
    paused, simulator, clock = watch
    simulator.says(paused=True)
    clock.now += 5.0
    assert paused.paused_time() == 5.0
    simulator.says(paused=False)
    clock.now += 5.0
    assert paused.paused_time() == 5.0


def test_time_goes_on_when_a_paused_simulator_has_ended(watch):
    paused, simulator, clock = watch
    simulator.says(paused=True)
    clock.now += 5.0
    simulator.connection.socket = None
    assert paused.paused_time() == 5.0
    clock.now += 7.0
    assert paused.paused_time() == 5.0
    simulator.connection.socket = object()
    simulator.says(paused=True)  # of the next one
    clock.now += 1.0
    assert paused.paused_time() == 6.0


@pytest.mark.parametrize("rate", [0.2, 1.0, 5.0])
def test_a_pause_is_not_believed_while_the_clock_goes_on(watch, rate):
    paused, simulator, clock = watch
    for _ in range(10):
        simulator.says(paused=True)
        clock.now += 1.0
        clock.ros += rate
    assert paused.paused_time() == pytest.approx(max(0.0, 10.0 - 10.0 * rate))
    clock.ros -= 30.0  # a step back is not progress
    clock.now += 1.0
    assert paused.paused_time() == pytest.approx(max(0.0, 10.0 - 10.0 * rate) + 1.0)


@pytest.mark.parametrize("rate", [0.0, 0.2, 1.0, 5.0])
def test_below_a_simulator_that_says_nothing_time_is_as_slow_as_the_clock(watch, rate):
    paused, simulator, clock = watch
    for step in range(1000):
        clock.now += 0.01
        if step % 10 == 9:  # the clock comes in steps
            clock.ros += 0.1 * rate
        paused.paused_time()
    assert 10.0 - paused.paused_time() == pytest.approx(10.0 * min(1.0, max(0.1, rate)), abs=0.2)
    simulator.says(paused=False)  # it is MERLIN's
    before = paused.paused_time()
    clock.now += 5.0
    assert paused.paused_time() == before


@pytest.mark.parametrize("simulated", [True, False])
def test_a_robot_does_not_listen_to_a_simulator(monkeypatch, simulated):
    monkeypatch.setattr(deadline.rospy, "get_time", lambda: 7.0)
    simulator = Simulator(monkeypatch, simulated)
    deadline.PauseWatch().paused_time()
    assert simulator.topics == ([deadline.SIM_STATUS_TOPIC] if simulated else [])


class Wait:
    """A condition, or an event, of a thread that may be stalled while it waits."""

    def __init__(self, monkeypatch):
        self.now = 100.0
        self.stalls = [10.0]  # s by which the next waits overrun
        monkeypatch.setattr(deadline, "running_time", lambda: self.now)
        monkeypatch.setattr(deadline.rospy, "is_shutdown", lambda: False)

    def wait(self, seconds):
        self.now += seconds + (self.stalls.pop() if self.stalls else 0.0)

    def is_set(self):
        return self.now > 111.0


@pytest.fixture
def stalled(monkeypatch):
    return Wait(monkeypatch)


def test_a_stall_of_the_thread_that_waits_is_no_part_of_the_wait(stalled):
    assert Deadline(2.0).wait(stalled, stalled.is_set)


def test_neither_is_one_of_a_thread_that_waits_for_an_event(stalled):
    assert Deadline(2.0).wait_event(stalled)


def test_what_was_missed_in_one_wait_is_there_in_the_next(stalled):
    end = Deadline(2.0)
    assert end.wait(stalled, lambda: stalled.now > 100.5)
    assert end.remaining() > 1.0


@pytest.mark.parametrize("stalls", [[], [10.0]])
def test_a_wait_ends_after_enough_ticks(stalled, stalls):
    stalled.stalls = list(stalls)
    assert not Deadline(2.0).wait(stalled, lambda: False)
    assert stalled.now == pytest.approx(102.0 + sum(stalls), abs=LONGEST_TICK)


def test_a_stall_is_no_part_of_the_time_at_which_one_looks_now_and_then(monkeypatch):
    missed = [0.0]
    clock = SimpleNamespace(monotonic=lambda: time.monotonic() + missed[0])
    monkeypatch.setattr(deadline, "time", clock)
    end = LookedAt(60.0)
    missed[0] = 1000.0
    assert 0.0 < end.remaining() <= 60.0


def test_one_that_is_looked_at_passes():
    assert LookedAt(0.0).expired and LookedAt(None).remaining() == math.inf
    end, never = LookedAt(0.01), threading.Event()
    assert any(end.expired for _ in range(600) if not never.wait(end.remaining()))
