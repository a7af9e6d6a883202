# SPDX-License-Identifier: Apache-2.0
"""The only way from navigation to the wheels: once closed for a goal, it blocks all commands of that goal."""

import threading
from typing import Optional

import rospy
from geometry_msgs.msg import Twist

from merlin_ros.actions.action_server import ServerGoal
from merlin_ros.publishing import publish


class VelocityPublisher:
    """Publishes velocities for the goal that owns the topic.

    The lock is a leaf: it is held around one publish and nothing else is locked inside, so that a cancel
    never waits for a control loop.
    """

    def __init__(self, topic: str) -> None:
        self._lock = threading.Lock()  # guards the owner and orders what is published
        self._owner: Optional[ServerGoal] = None
        self._publisher = rospy.Publisher(topic, Twist, queue_size=10)

    def open(self, goal: ServerGoal) -> None:
        """Passes the velocities of a goal on."""
        with self._lock:
            self._owner = goal

    def send(self, goal: ServerGoal, speed: float, turn: float) -> bool:
        """Sends a velocity (m/s, rad/s) unless the goal no longer owns the topic or shall stop."""
        with self._lock:
            if self._owner is not goal or goal.cancel_requested:
                return False
            twist = Twist()
            twist.linear.x, twist.angular.z = speed, turn
            self._publisher.publish(twist)
            return True

    def close(self, goal: ServerGoal) -> None:
        """Stops the robot, unless another goal owns the topic by now."""
        with self._lock:
            if self._owner is goal:
                self._owner = None
            if self._owner is None:
                publish(self._publisher, Twist())

    def stop(self) -> None:
        """Stops the robot, also when another goal owns the topic."""
        with self._lock:
            self._owner = None
            publish(self._publisher, Twist())
