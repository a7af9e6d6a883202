# SPDX-License-Identifier: Apache-2.0
"""Where the robot believes to be: truth with stated noise."""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import List, Tuple

import numpy as np

from merlin_reactive.pose import Pose, wrap
from merlin_reactive.seeded_random import draw

WANDER = 2.0  # s within which the error becomes another one


class SmoothNoise:
    """Gaussian noise that wanders: a smooth function of time through independent values.

    :param sigmas: standard deviation of each component.
    :param period: time between independent values, s.
    """

    def __init__(self, seed: int, name: str, sigmas: Tuple[float, ...], period: float) -> None:
        self._seed, self._name = seed, name
        self._sigmas = np.array(sigmas)
        self._period = period
        self._knot = lru_cache(maxsize=4)(self._draw)  # each is asked for at some fifty moments

    def at(self, time: float) -> np.ndarray:
        """The value of each component at a time, s."""
        index = math.floor(time / self._period)
        phase = (time / self._period - index) * math.pi / 2
        # sin and cos of one angle keep the variance constant between the knots.
        return self._sigmas * (math.cos(phase) * self._knot(index) + math.sin(phase) * self._knot(index + 1))

    def _draw(self, index: int) -> np.ndarray:
        return draw(self._seed, self._name, index).standard_normal(len(self._sigmas))


@dataclass(frozen=True)
class PoseNoise:
    """Standard deviations of the believed pose: m along each axis, rad."""

    xy: float = 0.02
    yaw: float = 0.01


class TruthLocalization:
    """Ground truth with smooth Gaussian noise, a function of seed and simulated time."""

    def __init__(self, noise: PoseNoise, seed: int, name: str) -> None:
        self._sigma = noise
        self._noise = SmoothNoise(seed, name + "/localization", (noise.xy, noise.xy, noise.yaw), WANDER)

    def estimate(self, truth: Pose, time: float) -> Pose:
        """The believed pose in the map frame at a time, s."""
        dx, dy, dyaw = self._noise.at(time)
        return Pose(truth.x + dx, truth.y + dy, wrap(truth.yaw + dyaw))

    def covariance(self) -> List[float]:
        """The covariance of the estimate, as geometry_msgs/PoseWithCovariance has it."""
        values = [0.0] * 36
        values[0] = values[7] = self._sigma.xy**2
        values[35] = self._sigma.yaw**2
        return values


def map_to_odom(believed: Pose, odometry: Pose) -> Pose:
    """The pose of the odom frame in the map frame that follows from both poses of the base."""
    return believed.compose(odometry.inverse())
