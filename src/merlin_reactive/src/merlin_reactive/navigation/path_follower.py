# SPDX-License-Identifier: Apache-2.0
"""Drives along a path: fast where it is straight, round corners without stopping, braking late."""

import math
from dataclasses import dataclass
from typing import Callable, Sequence, Tuple, Union

import numpy as np

from merlin_reactive.pose import Point, Pose, wrap

#: m along the path to the point that is steered for: the first that it can go straight to.
LOOKAHEADS = (1.5, 1.0, 0.7, 0.5, 0.35, 0.25, 0.18, 0.12)
SHORTEST = 0.25  # m within which the end of the path is approached without turning for it sharply
GAIN = 3.5  # rad/s of turning per radian of heading error
FULL_SPEED_ERROR = 0.8  # rad of heading error up to which it drives at full speed
STAND_ERROR = 1.4  # rad of heading error from which it turns on the spot
AIMED = 0.3  # rad of heading error up to which turning the rest while it drives needs no room
SLOWER = (1.0, 0.6, 0.3)  # parts of the speed that are tried where turning while it drives needs room
BRAKE_USE = 0.9  # part of the turning acceleration that the end of a turn is planned with
WINDOW = 1.0  # m of path ahead of the last progress in which the robot is looked for


@dataclass(frozen=True)
class Cruise:
    """Limits of a drive: m/s, rad/s, m/s², rad/s²."""

    speed: float = 0.30
    turn_speed: float = 1.0
    acceleration: float = 1.0
    turn_acceleration: float = 2.0


class Path:
    """A polyline measured by the distance along it."""

    def __init__(self, points: Sequence[Point]) -> None:
        corners = np.array(points, dtype=float)
        lengths = np.hypot(*np.diff(corners, axis=0).T) if len(corners) > 1 else np.zeros(0)
        keep = np.concatenate([[True], lengths > 1e-9])
        self._corners = corners[keep]
        self._distances = np.concatenate([[0.0], np.cumsum(lengths[lengths > 1e-9])])
        self.length = float(self._distances[-1])

    def at(self, distances: Union[float, np.ndarray]) -> np.ndarray:
        """The points (n x 2, or one) at distances along the path; beyond its ends, the ends."""
        return np.stack(
            [np.interp(distances, self._distances, self._corners[:, axis]) for axis in (0, 1)], axis=-1
        )

    def nearest(self, point: Point, first: float, last: float) -> Tuple[float, float]:
        """The place nearest to a point between two distances along the path, and how far off the point is."""
        along = np.arange(max(first, 0.0), min(last, self.length) + 0.02, 0.02)
        offsets = self.at(along) - np.asarray(point)
        index = int(np.argmin(np.hypot(offsets[:, 0], offsets[:, 1])))
        return min(float(along[index]), self.length), float(np.hypot(*offsets[index]))


class PathFollower:
    """Follows one path.

    :param path: in the frame of the poses.
    :param safe: whether the robot may go straight from one point to another. Where it may not, the robot
        steers for a nearer point of the path, so that it cuts no corner that it would touch.
    """

    def __init__(
        self, path: Path, cruise: Cruise, safe: Callable[[Point, Point], bool] = lambda start, end: True
    ) -> None:
        self.path = path
        self._safe = safe
        self._cruise = cruise
        self.progress = 0.0  # m along the path
        self.offset = 0.0  # m off the path

    @property
    def remaining(self) -> float:
        """Length of the path ahead, m."""
        return self.path.length - self.progress

    def locate(self, pose: Pose) -> None:
        """Takes the robot's place; progress never goes back far."""
        self.progress, self.offset = self.path.nearest(
            pose.point, self.progress - 0.2, self.progress + WINDOW
        )

    def command(self, pose: Pose, limit: float) -> Tuple[float, float]:
        """Speed (m/s, at most `limit`) and turning speed (rad/s) from a pose."""
        target = self._target(pose.point)
        dx, dy = target[0] - pose.x, target[1] - pose.y
        error = wrap(math.atan2(dy, dx) - pose.yaw)
        if abs(error) >= STAND_ERROR:
            return 0.0, self.turn(error)
        slow = (STAND_ERROR - abs(error)) / (STAND_ERROR - FULL_SPEED_ERROR)
        speed = min(limit, self._cruise.speed) * min(1.0, slow)
        if abs(error) > AIMED:
            speed *= self._room_to_turn(pose, target, error, speed)
        # Close to the end the bearing of the goal says little; turning for it would make the robot dance.
        return speed, self.turn(error) * min(1.0, self.remaining / SHORTEST)

    def _room_to_turn(self, pose: Pose, target: Point, error: float, speed: float) -> float:
        """The part of a speed at which it can turn to the target on an arc and then go to it."""
        for part in SLOWER:
            radius = part * speed / self._cruise.turn_speed
            left = math.copysign(radius, error)
            end = (
                pose.x + left * (math.sin(pose.yaw + error) - math.sin(pose.yaw)),
                pose.y - left * (math.cos(pose.yaw + error) - math.cos(pose.yaw)),
            )
            if self._safe(pose.point, end) and self._safe(end, target):
                return part
        return 0.0

    def _target(self, point: Point) -> Point:
        """The farthest point of the path ahead that the robot can go straight to; the nearest one if none."""
        ahead = self.path.at(self.progress + np.array(LOOKAHEADS))
        for x, y in ahead[:-1]:
            if self._safe(point, (float(x), float(y))):
                return float(x), float(y)
        return float(ahead[-1, 0]), float(ahead[-1, 1])

    def turn(self, error: float) -> float:
        """Turning speed that removes a heading error (rad) without overshooting."""
        braking = math.sqrt(2 * BRAKE_USE * self._cruise.turn_acceleration * abs(error))
        return math.copysign(min(GAIN * abs(error), braking, self._cruise.turn_speed), error)
