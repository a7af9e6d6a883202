# SPDX-License-Identifier: Apache-2.0
"""Points and poses in the plane, in a right-handed frame (REP 103): metres, radians."""

import math
from dataclasses import dataclass
from typing import Tuple

Point = Tuple[float, float]


@dataclass(frozen=True)
class Pose:
    """A pose in the plane: m, m, rad."""

    x: float
    y: float
    yaw: float = 0.0

    @property
    def point(self) -> Point:
        """The position without the heading, m."""
        return (self.x, self.y)

    def compose(self, other: "Pose") -> "Pose":
        """The pose that `other`, given relative to this one, has in this one's frame."""
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        return Pose(
            self.x + cos * other.x - sin * other.y,
            self.y + sin * other.x + cos * other.y,
            wrap(self.yaw + other.yaw),
        )

    def inverse(self) -> "Pose":
        """The pose of this one's frame as seen from here."""
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        return Pose(-cos * self.x - sin * self.y, sin * self.x - cos * self.y, -self.yaw)

    def distance(self, other: "Pose") -> float:
        """Distance of the positions, m."""
        return math.hypot(other.x - self.x, other.y - self.y)


def wrap(angle: float) -> float:
    """The angle within -pi..pi, rad."""
    return math.atan2(math.sin(angle), math.cos(angle))
