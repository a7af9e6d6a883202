"""Drives of the simulated base that last until the test is done with them."""

import threading

import rospy
from geometry_msgs.msg import Twist
from std_srvs.srv import SetBool
from topic_links import wait_for_publishers

from merlin_ros.service_proxy import ServiceProxy

LONG = 60.0


class HeldDrives:
    """Holds drives, and sees by the velocity whether one of them is under way."""

    def __init__(self):
        self._changed = threading.Condition()  # guards the fields below
        self._velocities = []
        self._held = None
        self._hold = ServiceProxy("base/hold", SetBool)
        assert self._hold.wait(LONG), "the simulated base is there"
        self._subscriber = rospy.Subscriber("cmd_vel", Twist, self._receive, tcp_nodelay=True)
        wait_for_publishers(self._subscriber)

    def _receive(self, velocity):
        with self._changed:
            self._velocities.append(velocity)
            self._changed.notify_all()

    def hold(self):
        """The next drive lasts until it is cancelled, or :meth:`end` ends it; one that is held now ends."""
        self._held = float(self._hold(True).message)

    def end(self):
        """Ends the drive that is held."""
        self._hold(False)

    def wait_driving(self):
        """Waits until the held drive is under way."""
        with self._changed:
            assert self._changed.wait_for(self._seen, LONG), f"{self._held}: {self._velocities[-5:]}"

    def wait_stopped(self):
        """Waits until the robot stands, after the held drive."""
        with self._changed:
            assert self._changed.wait_for(lambda: self._seen() and self._velocities[-1] == Twist(), LONG), (
                self._velocities[-5:]
            )

    def _seen(self):
        return any(velocity.linear.x == self._held for velocity in self._velocities)
