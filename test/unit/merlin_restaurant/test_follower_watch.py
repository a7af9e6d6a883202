# SPDX-License-Identifier: Apache-2.0
"""A robot that guides a client notices that the client is gone, also without lidar."""

import math
import threading
from types import SimpleNamespace
from typing import Callable, List

import numpy as np
import pytest
from fakes.topics import Topics
from nav_msgs.msg import Odometry
from sensor_msgs.msg import LaserScan

from merlin_restaurant import follower_watch
from merlin_restaurant.follower_watch import GONE, LOST, SILENT, UNSEEN, FollowerWatch, WatchState
from merlin_ros import ros_alarm
from merlin_test import LONG
from smach import UserData


class Clock:
    """ROS time that the test moves, simulated, and the topics of that robot."""

    now = 100.0
    topics: Topics


@pytest.fixture()
def watch(monkeypatch: pytest.MonkeyPatch) -> FollowerWatch:
    Clock.now = 100.0
    monkeypatch.setattr(follower_watch.rospy, "get_time", lambda: Clock.now)
    monkeypatch.setattr(follower_watch.rospy.rostime, "is_wallclock", lambda: False)
    Clock.topics = Topics(monkeypatch)
    watching = FollowerWatch()
    watching.begin()
    Clock.topics.send("/odom", Odometry())
    return watching


def see(distance: float) -> None:
    """A scan of a person ahead; 0: of an empty room."""
    ranges: List[float] = []
    for angle in np.radians(np.arange(360)):
        off = distance * abs(math.sin(angle))
        there = distance and math.cos(angle) > 0 and off < 0.2
        ranges.append(distance * math.cos(angle) - math.sqrt(0.04 - off**2) if there else math.inf)
    scan = LaserScan(
        angle_min=0.0, angle_increment=math.radians(1.0), range_min=0.05, range_max=10.0, ranges=ranges
    )
    scan.header.stamp = follower_watch.rospy.Time.from_sec(Clock.now)
    Clock.topics.send("/scan", scan)


class Waiting(threading.Thread):
    """A state that has begun to wait."""

    def __init__(self, watch: FollowerWatch, until: Callable[[], bool], limit: float = 0.0) -> None:
        self._looked = threading.Event()
        self.outcomes: List[str] = []
        state = WatchState(watch, lambda: self._looked.set() or until(), limit)
        super().__init__(target=lambda: self.outcomes.append(state.execute(UserData())), daemon=True)
        self.start()
        assert self._looked.wait(LONG)

    def looks(self, then: Callable[[], None]) -> None:
        """Does something, and waits until the state has looked afterwards."""
        self._looked.clear()
        then()
        assert self._looked.wait(LONG)

    def outcome(self) -> str:
        """What the wait ends with."""
        self.join(LONG)
        (ended,) = self.outcomes
        return ended


def test_who_is_seen_is_not_lost_and_who_is_not_seen_any_more_is(watch: FollowerWatch) -> None:
    see(1.5)
    assert abs(watch.distance - 1.5) < 0.1
    assert not watch.lost
    Clock.now += UNSEEN + 0.1
    see(0.0)
    assert watch.lost


def test_a_scan_that_comes_before_the_new_place_of_the_robot_is_not_taken_for_one_at_the_old_place(
    watch: FollowerWatch,
) -> None:
    see(1.5)
    watch.begin()
    see(1.5)  # the robot is 5 m away by now, but its odometry has not come yet
    there = Odometry()
    there.pose.pose.position.x, there.pose.pose.orientation.w = 5.0, 1.0
    Clock.topics.send("/odom", there)
    for _ in range(5):
        Clock.now += 0.1
        see(1.5)
    assert abs(watch.distance - 1.5) < 0.1 and not watch.lost
    assert watch._tracker.place is not None and abs(watch._tracker.place[0] - 6.5) < 0.1


def test_odometry_that_is_no_number_loses_no_client(watch: FollowerWatch) -> None:
    watch.begin()
    for x in (math.nan, 0.0, 0.0, 0.0):
        robot = Odometry()
        robot.pose.pose.position.x, robot.pose.pose.orientation.w = x, 1.0
        Clock.topics.send("/odom", robot)
        Clock.now += UNSEEN / 2
        see(1.2)
    assert watch.close


def test_who_is_too_far_away_is_lost(watch: FollowerWatch) -> None:
    for distance in np.arange(1.5, GONE - 0.05, 0.1):
        Clock.now += 0.1
        see(float(distance))
        assert not watch.lost
    Clock.now += 0.1
    see(GONE + 0.1)
    assert watch.lost


@pytest.mark.parametrize("seen_before", (True, False))
def test_a_robot_whose_lidar_falls_silent_does_not_lead_on_for_ever(
    watch: FollowerWatch, seen_before: bool
) -> None:
    if seen_before:
        see(1.5)
    leads = Waiting(watch, lambda: watch.behind)
    Clock.now += SILENT + 0.1
    assert leads.outcome() == "succeeded"


def test_a_robot_waits_for_who_is_not_seen_and_goes_on_when_they_come(watch: FollowerWatch) -> None:
    see(1.5)
    waits = Waiting(watch, lambda: watch.close, 20.0)
    for _ in range(5):
        Clock.now += UNSEEN
        waits.looks(lambda: see(0.0))
    assert watch.lost and not waits.outcomes
    see(1.2)
    assert waits.outcome() == "succeeded"


def test_a_clock_that_is_set_back_makes_no_wait_longer(watch: FollowerWatch) -> None:
    see(1.5)
    waits = Waiting(watch, lambda: watch.close, 20.0)

    def go_back() -> None:
        Clock.now -= 50.0
        see(0.0)

    waits.looks(go_back)
    Clock.now += 20.1
    assert waits.outcome() == LOST


def test_a_clock_that_is_set_back_lets_no_lost_client_count_as_there(watch: FollowerWatch) -> None:
    see(1.5)
    Clock.now -= 50.0
    for _ in range(4):
        see(0.0)
        assert not watch.lost
        Clock.now += UNSEEN / 3
    see(0.0)
    assert watch.lost


def test_a_wall_clock_that_is_set_forward_makes_no_wait_shorter(
    watch: FollowerWatch, monkeypatch: pytest.MonkeyPatch
) -> None:
    passed = [7.0]
    monkeypatch.setattr(follower_watch.rospy.rostime, "is_wallclock", lambda: True)
    monkeypatch.setattr(ros_alarm, "time", SimpleNamespace(monotonic=lambda: passed[0]))
    see(1.5)
    waits = Waiting(watch, lambda: watch.close, 20.0)

    def go_on(seconds: float, step: float) -> None:
        passed[0] += seconds
        Clock.now += seconds + step
        see(0.0)

    for step in (50.0, 0.0):
        waits.looks(lambda step=step: go_on(9.9, step))  # type: ignore[misc]
        assert not waits.outcomes
    go_on(0.3, 0.0)
    assert waits.outcome() == LOST


def test_a_lidar_that_is_silent_since_the_clock_was_set_back_is_noticed(watch: FollowerWatch) -> None:
    see(1.5)
    Clock.now -= 50.0
    assert watch.lost


def test_a_robot_does_not_wait_for_ever_for_who_is_gone(watch: FollowerWatch) -> None:
    see(1.5)
    waits = Waiting(watch, lambda: watch.close, 20.0)
    Clock.now += 20.1
    see(0.0)
    assert waits.outcome() == LOST


def test_a_scan_that_comes_late_is_none_that_never_comes(watch: FollowerWatch) -> None:
    see(1.5)
    Clock.now += UNSEEN + 1.0
    assert not watch.lost
