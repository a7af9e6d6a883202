# SPDX-License-Identifier: Apache-2.0
"""The last word before the wheels: no command may drive the disc into what the laser sees."""

import math
from typing import Tuple

import numpy as np

REACTION = 0.15  # s from a command to its effect, with reserve
FRACTIONS = (1.0, 0.75, 0.5, 0.25, 0.1)  # of the speed wanted, tried in this order
SWERVES = (0.0, 0.25, -0.25, 0.5, -0.5, 0.8, -0.8)  # rad/s added to the turn wanted, tried in this order
SWERVE_WAY = 0.25  # m ahead that a swerve is chosen for
SWERVE_GAP = 0.015  # m beyond the guard's gap that a swerve tries to keep
POSES = 6  # along the way to standstill


class ScanGuard:
    """Limits the speed so that the robot can stop before what it sees.

    :param radius: of the robot, m.
    :param margin: kept free around it, m.
    :param acceleration: that it brakes with, m/s².
    """

    def __init__(self, radius: float, margin: float, acceleration: float) -> None:
        self._gap = radius + margin
        self._acceleration = acceleration
        self._points = np.zeros((0, 2))

    def see(self, points: np.ndarray) -> None:
        """Takes the points (n x 2, m) of a scan in the robot's frame."""
        near = np.hypot(points[:, 0], points[:, 1]) < self._gap + 1.0
        self._points = points[near]

    def allowed(self, speed: float, turn: float) -> float:
        """The greatest part of a speed (m/s) that is safe while turning (rad/s)."""
        if speed == 0.0 or not len(self._points):
            return speed
        now = np.hypot(self._points[:, 0], self._points[:, 1])
        # What is nearer than the gap already must only not come nearer still.
        needed = np.minimum(self._gap, now - 0.001)
        for fraction in FRACTIONS:
            if (self._nearest(speed * fraction, turn) >= needed).all():
                return speed * fraction
        return 0.0

    def steered(self, speed: float, turn: float, turn_limit: float) -> Tuple[float, float]:
        """The greatest safe speed (m/s) and the turn nearest to that wanted (rad/s) which keeps it going.

        Where the pose is believed a little off, the path leads past a corner too closely; a slight swerve in
        time continues where braking alone would make the robot creep.
        """
        if speed <= 0.0 or not len(self._points):
            return self.allowed(speed, turn), turn
        needed = np.minimum(self._gap + SWERVE_GAP, np.hypot(self._points[:, 0], self._points[:, 1]))
        best, chosen = -math.inf, turn
        for swerve in SWERVES:
            tried = max(-turn_limit, min(turn_limit, turn + swerve))
            x, y = _arc(np.linspace(0.0, SWERVE_WAY, POSES)[1:], tried / speed)
            gaps = np.hypot(self._points[:, :1] - x, self._points[:, 1:] - y).min(axis=1)
            spare = float((gaps - needed).min())
            if spare > best:
                best, chosen = spare, tried
            if spare >= 0.0:
                break
        return self.allowed(speed, chosen), chosen

    def _nearest(self, speed: float, turn: float) -> np.ndarray:
        """Least distance of each point from the robot's middle while it stops from a speed."""
        distance = abs(speed) * REACTION + speed * speed / (2 * self._acceleration)
        along = np.linspace(0.0, math.copysign(distance, speed), POSES)[1:]
        x, y = _arc(along, turn / speed)
        return np.hypot(self._points[:, :1] - x, self._points[:, 1:] - y).min(axis=1)


def _arc(along: np.ndarray, curvature: float) -> Tuple[np.ndarray, np.ndarray]:
    angle = along * curvature
    if abs(curvature) < 1e-3:
        return along, along * angle / 2
    return np.sin(angle) / curvature, (1 - np.cos(angle)) / curvature
