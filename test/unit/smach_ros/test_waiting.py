# SPDX-License-Identifier: Apache-2.0
"""Deadlines of the robot's world run by its clock, whatever that does."""

import threading

import pytest
import rospy

from smach_ros import waiting
from smach_ros.waiting import RosDeadline, WallDeadline, wait


@pytest.fixture
def clock(monkeypatch):
    """A simulated clock to be set by hand."""
    times = [100.0]
    monkeypatch.setattr(rospy, "get_time", lambda: times[0])
    monkeypatch.setattr(rospy.rostime, "is_wallclock", lambda: False)
    return times


def test_deadline_stands_still_with_the_clock_and_survives_its_reset(clock):
    deadline = RosDeadline(rospy.Duration(2.0))
    assert deadline.remaining() == 2.0
    clock[0] = 101.5
    assert deadline.remaining() == 0.5
    clock[0] = 3.0  # the simulator was restarted
    assert deadline.remaining() == 0.5
    clock[0] = 3.5
    assert deadline.remaining() == 0.0


def test_wait_notices_that_simulated_time_has_passed(clock):
    condition = threading.Condition()
    passes = threading.Timer(0.05, lambda: clock.__setitem__(0, 200.0))
    passes.start()
    with condition:
        assert wait(condition, lambda: False, RosDeadline(60.0)) is False
    passes.join()


def test_wait_ends_with_what_it_waits_for_and_at_a_shutdown(monkeypatch):
    condition, came = threading.Condition(), []

    def come():
        with condition:
            came.append(1)
            condition.notify_all()

    threading.Timer(0.01, come).start()
    with condition:
        assert wait(condition, lambda: bool(came), WallDeadline(None)) is True
        assert wait(condition, lambda: False, WallDeadline(0.01)) is False
        monkeypatch.setattr(rospy, "is_shutdown", lambda: True)
        assert wait(condition, lambda: False, WallDeadline(None)) is False


def test_durations_are_ros_durations_or_seconds():
    assert waiting.seconds(rospy.Duration(1, 500000000)) == 1.5
    assert waiting.seconds(2) == 2.0
    assert RosDeadline(None).remaining() == float("inf")
