"""One robot as guests and barman notice it: where it is and was, and when it is quiet around it."""

import math
from typing import List, Optional, Tuple

from nav_msgs.msg import Odometry

from merlin_guests.places import Point
from merlin_guests.quiet_room import QuietRoom

TRAIL = 0.15  # m between the remembered places of the robot


class SeenRobot:
    """What is known of a robot; its owner guards it.

    :param name: its namespace; empty: the only one.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.place: Optional[Point] = None
        self.trail: List[Point] = []
        self.quiet_room = QuietRoom()

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


Said = Tuple[str, str]
"""A robot's name, and what it said."""
