# SPDX-License-Identifier: Apache-2.0
"""One robot as guests and barman perceive it: its poses, and when no person speaks near it."""

import math
from typing import List, Optional, Tuple

import rospy
from nav_msgs.msg import Odometry

from merlin_guests.places import Point

TRAIL = 0.15  # m between the remembered places of the robot
QUIET = 6.0  # s without speech
ANSWER_DUE = 20.0  # s in which a person that was asked begins to answer


class QuietRoom:
    """What was heard last; times are s of simulated time."""

    def __init__(self) -> None:
        self._last_sound = 0.0
        self.robot_speaks = False
        """Whether the robot has begun to speak and has not ended."""
        self._answer_due = 0.0

    def sound(self, now: float) -> None:
        """A person in the room speaks: an answer that was due has begun."""
        self._last_sound, self._answer_due = now, 0.0

    def robot(self, now: float, speaking: bool) -> None:
        """The robot begins or ends to speak; while it does it is not quiet, however long that takes."""
        self.robot_speaks, self._last_sound = speaking, now

    def asked(self, now: float) -> None:
        """The robot has asked a person that will answer; no other person speaks first."""
        self._answer_due = now + ANSWER_DUE

    def quiet(self, now: float) -> bool:
        """Whether a guest may call."""
        return not self.robot_speaks and now - self._last_sound > QUIET and now > self._answer_due


class SeenRobot:
    """What is known of a robot; its owner guards it.

    :param name: its namespace; empty: the only one.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.place: Optional[Point] = None
        self.trail: List[Point] = []
        self.quiet_room = QuietRoom()
        self.voice: Optional[rospy.Subscriber] = None  # hears when it begins and ends to speak

    @property
    def prefix(self) -> str:
        """Of the names of its topics and services."""
        return f"{self.name}/" if self.name else ""

    def move(self, message: Odometry) -> None:
        """Takes where it is now."""
        position = message.pose.pose.position
        self.place = (position.x, position.y)
        if not self.trail or math.dist(self.trail[-1], self.place) > TRAIL:
            self.trail.append(self.place)

    def is_quiet(self, now: float) -> bool:
        """Whether a guest may call; one that died while it spoke has ended to speak.

        :param now: s of simulated time.
        """
        if self.quiet_room.robot_speaks and self.voice is not None and not _connected(self.voice):
            self.quiet_room.robot(now, False)
        return self.quiet_room.quiet(now)


def _connected(subscriber: rospy.Subscriber) -> bool:
    """Whether a publisher lives. rospy's own count keeps those that died for a while."""
    return any(connection.socket is not None for connection in subscriber.impl.connections)


#: A robot's name, and what it said.
Said = Tuple[str, str]
