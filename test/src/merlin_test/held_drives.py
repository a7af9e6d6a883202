# SPDX-License-Identifier: Apache-2.0
"""Drives of the simulated base that last until the test is done with them."""

import threading
from typing import List, Optional

import rospy
from geometry_msgs.msg import Twist
from std_srvs.srv import SetBool

from merlin_test import LONG
from merlin_test.topic_links import wait_for_publishers


class HeldDrives:
    """Holds drives, and sees by the velocity whether one of them is under way.

    :param robot: namespace of the base, of several.
    """

    def __init__(self, robot: str = "") -> None:
        place = f"{robot}/" if robot else ""
        self._changed = threading.Condition()  # guards the fields below
        self._velocities: List[Twist] = []
        self._held: Optional[float] = None  # m/s
        # rospy's own: it waits for a master that a busy machine delays, too.
        self._hold = rospy.ServiceProxy(f"{place}base/hold", SetBool)
        self._hold.wait_for_service(LONG)
        self._subscriber = rospy.Subscriber(f"{place}cmd_vel", Twist, self._receive, tcp_nodelay=True)
        wait_for_publishers(self._subscriber)

    def _receive(self, velocity: Twist) -> None:
        with self._changed:
            self._velocities.append(velocity)
            self._changed.notify_all()

    def hold(self) -> None:
        """The next drive lasts until it is cancelled, or :meth:`end` ends it; one that is held now ends."""
        self._held = float(self._hold(True).message)

    def end(self) -> None:
        """Ends the drive that is held."""
        self._hold(False)

    def wait_driving(self) -> None:
        """Waits until the held drive is under way."""
        with self._changed:
            assert self._changed.wait_for(self._seen, LONG), f"{self._held}: {self._velocities[-5:]}"

    def wait_stopped(self) -> None:
        """Waits until the robot stands, after the held drive."""
        with self._changed:
            assert self._changed.wait_for(lambda: self._seen() and self._velocities[-1] == Twist(), LONG), (
                self._velocities[-5:]
            )

    def _seen(self) -> bool:
        return any(velocity.linear.x == self._held for velocity in self._velocities)
