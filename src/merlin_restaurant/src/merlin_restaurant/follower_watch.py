# SPDX-License-Identifier: Apache-2.0
"""Watches by lidar whether the guided person still follows, and a state that waits for the person."""

import math
import threading
from typing import Any, Callable, List, Optional, Tuple

import numpy as np
import rospy
from nav_msgs.msg import Odometry
from sensor_msgs.msg import LaserScan

from merlin_restaurant.person_tracker import PersonTracker
from merlin_ros.ros_alarm import RosStopwatch
from merlin_ros.work.passed_time import PassedTime
from merlin_sm.states.merlin_state import PREEMPTED, SUCCEEDED, MerlinState

BEHIND = 1.9  # m of distance at which the robot waits
CLOSE = 1.4  # m at which it continues
GONE = 3.6  # m: a follower is never that far away
UNSEEN = 3.0  # s of scans without the person after which the person counts as lost
SILENT = 10.0  # s without a scan after which the same holds; more, because a busy computer's scans come late
LOST = "lost"


class FollowerWatch:
    """Tracks one person on ``scan`` and ``odom`` between :meth:`begin` and :meth:`end`."""

    def __init__(self) -> None:
        self.changed = threading.Condition()  # guards all below
        self._tracker = PersonTracker()
        self._pose: Optional[Tuple[float, float, float]] = None
        self._time = PassedTime(0.0)  # that passes from scan to scan, of those that were used
        self._begun = 0.0  # s of it
        self._subscribers: List[rospy.Subscriber] = []

    def begin(self, *_: Any) -> None:
        """Forgets the last person and looks for one in front of the robot."""
        self.end()
        with self.changed:
            self._tracker = PersonTracker()
            self._pose = None  # where the robot was when it ended is not where it begins
            self._begun = rospy.get_time()
            self._time = PassedTime(self._begun)
        self._subscribers = [
            rospy.Subscriber("odom", Odometry, self._move, tcp_nodelay=True, queue_size=1),
            rospy.Subscriber("scan", LaserScan, self._see, tcp_nodelay=True, queue_size=1),
        ]

    def end(self, *_: Any) -> None:
        """Stops watching."""
        for subscriber in self._subscribers:
            subscriber.unregister()
        self._subscribers = []

    @property
    def lost(self) -> bool:
        """Whether the person is gone: not seen for a while, by a lidar that works or not, or too far away."""
        unseen = self._time.line - max(self._begun, self._tracker.seen)
        silent = rospy.get_time() - self._time.now
        return unseen > UNSEEN or abs(silent) > SILENT or self._tracker.distance > GONE

    @property
    def distance(self) -> float:
        """From the robot, m."""
        return self._tracker.distance

    @property
    def behind(self) -> bool:
        """Whether the robot should wait for the person: too far behind, or not seen any more."""
        return self.lost or self.distance > BEHIND

    @property
    def close(self) -> bool:
        """Whether the person is so near that the robot can continue."""
        return not self.lost and self.distance < CLOSE

    def _move(self, odometry: Odometry) -> None:
        pose = odometry.pose.pose
        yaw = 2 * math.atan2(pose.orientation.z, pose.orientation.w)
        place = (pose.position.x, pose.position.y, yaw)
        with self.changed:
            if all(map(math.isfinite, place)):  # the tracker would look for the person nowhere from then on
                self._pose = place

    def _see(self, scan: LaserScan) -> None:
        ranges = np.asarray(scan.ranges)
        angles = scan.angle_min + scan.angle_increment * np.arange(len(ranges))
        valid = (ranges >= scan.range_min) & (ranges <= scan.range_max)
        ranges, angles = ranges[valid], angles[valid]
        points = np.stack([ranges * np.cos(angles), ranges * np.sin(angles)], axis=1)
        with self.changed:
            if self._pose is not None:
                passed = self._time.look(scan.header.stamp.to_sec())
                self._tracker.update(passed, self._pose, points)
                self.changed.notify_all()


class WatchState(MerlinState):
    """Waits until something holds of the follower; further outcome with a limit: lost.

    :param watch: notices when the person is too far behind.
    :param until: returns True when the wait is over.
    :param limit: s of ROS time after which the follower counts as lost; 0: none.
    """

    def __init__(self, watch: FollowerWatch, until: Callable[[], bool], limit: float = 0.0) -> None:
        super().__init__([LOST] if limit else [])
        self._watch = watch
        self._until = until
        self._limit = limit
        self._stopped = False

    def run(self, userdata: Any) -> str:
        """Waits until the condition holds, or the patience is over."""
        watch, passed = self._watch, RosStopwatch()
        limit = self._limit if self._limit > 0 else math.inf
        self._stopped = False
        self.interruptible(self._stop)
        with watch.changed:
            # The slice is for a lidar that has fallen silent.
            while not (self._stopped or self._until() or passed.look() > limit):
                watch.changed.wait(1.0)
            outcome = SUCCEEDED if self._until() else LOST
        self.interruptible(None)
        return PREEMPTED if self._stopped else outcome

    def _stop(self) -> None:
        self._stopped = True
        with self._watch.changed:
            self._watch.changed.notify_all()
