# SPDX-License-Identifier: Apache-2.0
"""An alarm rings again after a callback that failed, and in time when the clock is set."""

import logging
import queue
import threading
import time
from logging.handlers import QueueHandler
from types import SimpleNamespace

import pytest
import rospy

from merlin_ros import ros_alarm
from merlin_ros.ros_alarm import RosAlarm, call_after
from merlin_test import LONG


def test_a_callback_that_fails_does_not_end_the_alarm(monkeypatch):
    monkeypatch.setattr(rospy.rostime, "_rostime_initialized", True)
    rospy.rostime.switch_to_wallclock()
    reported, rung = queue.Queue(), queue.Queue()
    log, handler = logging.getLogger("rosout"), QueueHandler(reported)
    log.addHandler(handler)

    def ring():
        rung.put(True)
        raise RuntimeError("broken bell")

    alarm = RosAlarm(ring, "alarm of a test")
    try:
        for moment in (1.0, 2.0):  # long past
            alarm.set(moment)
            assert rung.get(timeout=LONG)
            assert "broken bell" in reported.get(timeout=LONG).getMessage()
    finally:
        alarm.shutdown()
        log.removeHandler(handler)


def test_what_is_due_after_some_time_comes_once_and_leaves_no_thread(clock):
    rung = queue.Queue()
    call_after(2.0, lambda: rung.put(True), "call of a test")
    (thread,) = [each for each in threading.enumerate() if each.name == "call of a test"]
    for tick in range(10, 100):  # below 100: which of them it sees is the scheduler's business
        clock.set(float(tick))
        thread.join(0.3)
    assert rung.get(timeout=LONG)
    thread.join(LONG)
    assert not thread.is_alive() and rung.empty()


def test_what_is_due_after_some_time_does_not_come_with_the_first_tick(monkeypatch, clock):
    clock.set(0.0)
    rung, looks, get_time = queue.Queue(), queue.Queue(), rospy.get_time

    def look():
        looks.put(get_time())
        return get_time()

    monkeypatch.setattr(rospy, "get_time", look)
    alarm = call_after(5.0, lambda: rung.put(True), "call of a test")
    try:
        for tick in (1000.0, 1004.0):
            clock.set(tick)
            while looks.get(timeout=LONG) != tick:
                pass
            while looks.get(timeout=LONG) != tick:  # it has decided about the first look
                pass
            assert rung.empty()
        clock.set(1006.0)
        assert rung.get(timeout=LONG)
    finally:
        alarm.shutdown()


def test_what_is_not_wanted_any_more_does_not_come(clock):
    rung = queue.Queue()
    alarm = call_after(2.0, lambda: rung.put(True), "call of a test")
    (thread,) = [each for each in threading.enumerate() if each.name == "call of a test"]
    alarm.shutdown()
    thread.join(LONG)
    clock.set(200.0)
    assert rung.empty()


class WallClock:
    """Wall time, ROS time in front of the monotonic one; it is looked at again and again."""

    def __init__(self, monkeypatch):
        monkeypatch.setattr(rospy.rostime, "_rostime_initialized", True)
        rospy.rostime.switch_to_wallclock()
        self.looks, self.times = queue.Queue(), (1000.0, 50.0)
        monkeypatch.setattr(ros_alarm, "LONGEST", 0.02)
        monkeypatch.setattr(ros_alarm, "time", SimpleNamespace(monotonic=self.monotonic))
        monkeypatch.setattr(rospy, "get_time", lambda: self.times[0])

    def monotonic(self):
        self.looks.put(self.times)
        return self.times[1]

    def set(self, *times):
        """Sets both, and waits until what was decided about them is done."""
        self.times = times
        for _ in range(2):
            while self.looks.get(timeout=LONG) != times:
                pass


@pytest.mark.parametrize("step", [-500.0, 500.0])
def test_a_wall_clock_that_is_set_neither_shortens_nor_prolongs_a_time(monkeypatch, step):
    rung, wall = queue.Queue(), WallClock(monkeypatch)
    alarm = call_after(3.0, lambda: rung.put(True), "call of a test")
    try:
        for times in ((1001.0, 51.0), (1002.0 + step, 52.0), (1002.9 + step, 52.9)):
            wall.set(*times)
            assert rung.empty()
        wall.times = (1003.1 + step, 53.1)
        assert rung.get(timeout=LONG)
    finally:
        alarm.shutdown()


def test_a_moment_comes_with_the_wall_clock_that_is_set_forward(monkeypatch):
    rung, wall = queue.Queue(), WallClock(monkeypatch)
    alarm = RosAlarm(lambda: rung.put(True), "alarm of a test")
    try:
        alarm.set(1500.0)
        wall.set(1499.0, 51.0)
        assert rung.empty()
        wall.times = (1501.0, 51.0)
        assert rung.get(timeout=LONG)
    finally:
        alarm.shutdown()


def test_a_moment_is_due_when_a_clock_begins_behind_it(clock):
    clock.set(0.0)
    rung = queue.Queue()
    alarm = RosAlarm(lambda: rung.put(True), "alarm of a test")
    try:
        alarm.set(50.0)
        clock.set(1000.0)
        assert rung.get(timeout=LONG)
    finally:
        alarm.shutdown()


@pytest.mark.parametrize("moment", [1e11, float("inf"), float("nan")])
def test_a_time_beyond_measure_does_not_end_the_alarm(monkeypatch, moment):
    monkeypatch.setattr(rospy.rostime, "_rostime_initialized", True)
    rospy.rostime.switch_to_wallclock()
    rung = queue.Queue()
    alarm = RosAlarm(lambda: rung.put(True), "alarm of a test")
    try:
        alarm.set(moment)
        time.sleep(0.05)  # the thread waits for it
        alarm.set(1.0)  # long past
        assert rung.get(timeout=LONG)
    finally:
        alarm.shutdown()
