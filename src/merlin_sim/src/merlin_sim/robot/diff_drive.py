# SPDX-License-Identifier: Apache-2.0
"""The base controller of a differential drive: limits and ramps, and odometry from the wheels."""

import math
from dataclasses import dataclass
from typing import Tuple

from merlin_reactive.pose import Pose, wrap
from merlin_reactive.seeded_random import draw

LATE = 0.15  # s; a navigation that follows odometry sends 20 commands a second
GIVEN_UP = 1.0  # s after which a late command is no longer waited for


@dataclass(frozen=True)
class DriveLimits:
    """What the base can do: m/s, rad/s, m/s², rad/s²."""

    speed: float = 1.0
    turn_speed: float = 2.0
    acceleration: float = 1.0
    turn_acceleration: float = 2.0


@dataclass(frozen=True)
class DriveGeometry:
    """Wheel radius and distance of the wheels, m; as in urdf/rb1.urdf."""

    wheel_radius: float = 0.0762
    track: float = 0.34


class BaseController:
    """Turns the commanded velocity into wheel speeds within the limits, and forgets a silent commander.

    :param timeout: s of simulated time after the last command after which the base stops.
    """

    def __init__(self, limits: DriveLimits, geometry: DriveGeometry, timeout: float) -> None:
        self.limits = limits
        self.geometry = geometry
        self._timeout = timeout
        self._target = (0.0, 0.0)  # m/s, rad/s; one tuple, so that a thread that reads it sees one command
        self._commanded_at = -math.inf
        self.velocity = (0.0, 0.0)

    def command(self, speed: float, turn_speed: float, now: float) -> None:
        """Takes a command; it acts from the next physics step on. Not finite counts as stop."""
        if not (math.isfinite(speed) and math.isfinite(turn_speed)):
            speed = turn_speed = 0.0
        limits = self.limits
        self._commanded_at = now
        self._target = (
            max(-limits.speed, min(limits.speed, speed)),
            max(-limits.turn_speed, min(limits.turn_speed, turn_speed)),
        )

    def neglected(self, now: float) -> bool:
        """Whether the next command for a moving robot is overdue and still awaited."""
        return self._target != (0.0, 0.0) and LATE < now - self._commanded_at < LATE + GIVEN_UP

    def wheel_speeds(self, now: float, step: float) -> Tuple[float, float]:
        """Speeds of the left and right wheel for the next step of `step` seconds, rad/s."""
        target = self._target if now - self._commanded_at <= self._timeout else (0.0, 0.0)
        speed = _towards(self.velocity[0], target[0], self.limits.acceleration * step)
        turn = _towards(self.velocity[1], target[1], self.limits.turn_acceleration * step)
        self.velocity = (speed, turn)
        half = turn * self.geometry.track / 2
        return (speed - half) / self.geometry.wheel_radius, (speed + half) / self.geometry.wheel_radius


def _towards(value: float, target: float, change: float) -> float:
    return value + max(-change, min(change, target - value))


@dataclass(frozen=True)
class OdometryNoise:
    """How odometry drifts.

    Errors of scale stay the same for a run; the random parts grow with the square root of what was driven.
    """

    distance_scale: float = 0.0  # standard deviation of the scale error of distances
    turn_scale: float = 0.0  # standard deviation of the scale error of turns
    distance: float = 0.0  # m per square root of a metre
    turn: float = 0.0  # rad per square root of a metre driven or a radian turned


class WheelOdometry:
    """The pose by the wheels' encoders, in the odom frame."""

    def __init__(self, geometry: DriveGeometry, noise: OdometryNoise, seed: int, name: str) -> None:
        self._geometry = geometry
        self._noise = noise
        self._seed, self._name = seed, name + "/odometry"
        scales = draw(seed, self._name, 0).standard_normal(2)
        self._distance_scale = 1.0 + noise.distance_scale * scales[0]
        self._turn_scale = 1.0 + noise.turn_scale * scales[1]
        self._wheels = (0.0, 0.0)
        self.pose = Pose(0.0, 0.0)
        self.velocity = (0.0, 0.0)

    def update(self, left: float, right: float, tick: int, elapsed: float) -> None:
        """Takes the wheels' angles (rad) `elapsed` seconds after the last ones; `tick` indexes the noise."""
        radius = self._geometry.wheel_radius
        moved_left, moved_right = (left - self._wheels[0]) * radius, (right - self._wheels[1]) * radius
        self._wheels = (left, right)
        distance = self._distance_scale * (moved_left + moved_right) / 2
        turn = self._turn_scale * (moved_right - moved_left) / self._geometry.track
        if self._noise.distance or self._noise.turn:
            driven = abs(distance) + abs(turn)
            errors = draw(self._seed, self._name, tick + 1).standard_normal(2) * math.sqrt(driven)
            distance += self._noise.distance * errors[0]
            turn += self._noise.turn * errors[1]
        heading = self.pose.yaw + turn / 2  # exact for an arc up to second order
        self.pose = Pose(
            self.pose.x + distance * math.cos(heading),
            self.pose.y + distance * math.sin(heading),
            wrap(self.pose.yaw + turn),
        )
        self.velocity = (distance / elapsed, turn / elapsed)
