# SPDX-License-Identifier: Apache-2.0
"""Tracks the person who follows the robot, with its lidar."""

import math
from typing import List, Optional, Tuple

import numpy as np

GAP = 0.15  # m between neighbouring points of different things
NARROW, WIDE = 0.10, 0.60  # m, widths of what can be a person
BODY = 0.2  # m from the near side of a person to the middle
FRONT = math.radians(40)  # half of the sector in which the person stands at first
FIRST = 2.6  # m, how far at most
STRIDE = 0.35  # m by which a person can be off the expected place at once
PACE = 1.0  # m/s, more than a person who follows walks

Point = Tuple[float, float]


class PersonTracker:
    """Follows one person from scan to scan, in a frame that does not move with the robot.

    :ivar place: of the person, m in the frame of the poses given; None: not found yet.
    :ivar distance: from the robot at the last scan in which the person was seen, m.
    :ivar seen: time of that scan, s.
    """

    def __init__(self) -> None:
        self.place: Optional[Point] = None
        self.distance = 0.0
        self.seen = 0.0

    def update(self, time: float, pose: Tuple[float, float, float], points: np.ndarray) -> bool:
        """Takes a scan.

        :param time: s.
        :param pose: of the robot, x, y (m), yaw (rad).
        :param points: what the lidar sees, n x 2, m, in the robot's frame, in the order of the rays.
        :return: whether the person was seen.
        """
        bodies = people_like(points)
        if self.place is None:
            chosen = _nearest_in_front(bodies)
        else:
            expected = _into_robot_frame(self.place, pose)
            reach = STRIDE + PACE * min(2.0, max(0.0, time - self.seen))
            near = [body for body in bodies if math.dist(body, expected) <= reach]
            chosen = min(near, key=lambda body: math.dist(body, expected), default=None)
        if chosen is None:
            return False
        self.distance, self.seen = math.hypot(*chosen), time
        x, y, yaw = pose
        self.place = (
            x + chosen[0] * math.cos(yaw) - chosen[1] * math.sin(yaw),
            y + chosen[0] * math.sin(yaw) + chosen[1] * math.cos(yaw),
        )
        return True


def people_like(points: np.ndarray) -> List[Point]:
    """Middles of the groups of points that are as wide as a person."""
    if len(points) < 2:
        return []
    steps = np.hypot(*(points - np.roll(points, 1, axis=0)).T)
    starts = np.nonzero(steps > GAP)[0]
    if not len(starts):
        return []
    ordered = np.roll(points, -int(starts[0]), axis=0)  # so that no group goes over the end
    groups = np.split(ordered, (starts - starts[0])[1:])
    found = []
    for group in groups:
        if len(group) >= 3 and NARROW <= float(np.hypot(*(group[-1] - group[0]))) <= WIDE:
            near = group[np.argmin(np.hypot(*group.T))]
            middle = group.mean(axis=0)
            away = float(np.hypot(*middle))
            outwards = (float(np.hypot(*near)) + BODY) / away if away > 0.0 else 1.0
            found.append((float(middle[0] * outwards), float(middle[1] * outwards)))
    return found


def _nearest_in_front(bodies: List[Point]) -> Optional[Point]:
    ahead = [
        body for body in bodies if abs(math.atan2(body[1], body[0])) <= FRONT and math.hypot(*body) <= FIRST
    ]
    return min(ahead, key=lambda body: math.hypot(*body), default=None)


def _into_robot_frame(place: Point, pose: Tuple[float, float, float]) -> Point:
    x, y, yaw = pose
    dx, dy = place[0] - x, place[1] - y
    return dx * math.cos(yaw) + dy * math.sin(yaw), dy * math.cos(yaw) - dx * math.sin(yaw)
