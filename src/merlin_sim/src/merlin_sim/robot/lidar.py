# SPDX-License-Identifier: Apache-2.0
"""The planar laser of a simulated robot."""

import math
from dataclasses import dataclass
from typing import Iterable

import numpy as np

from merlin_reactive.pose import Pose
from merlin_reactive.seeded_random import draw
from merlin_sim.robot.ray_casting import Circle, ScanOutlines


@dataclass(frozen=True)
class LidarModel:
    """What the laser can do; lengths in m, angles in rad."""

    rays: int = 360
    range_min: float = 0.05
    range_max: float = 10.0
    sigma: float = 0.01  # of a range


class Lidar:
    """Scans from the middle of the robot; ray i points to -pi + i * 2 pi / rays in the robot's frame."""

    def __init__(self, model: LidarModel, seed: int, name: str) -> None:
        self.model = model
        self._seed, self._name = seed, name + "/scan"
        self.increment = 2 * math.pi / model.rays
        self._angles = -math.pi + self.increment * np.arange(model.rays)

    def scan(self, pose: Pose, outlines: ScanOutlines, others: Iterable[Circle], tick: int) -> np.ndarray:
        """The ranges seen from a pose, m; infinite where nothing is within reach.

        :param others: the outlines of other robots.
        :param tick: indexes the noise.
        """
        model = self.model
        ranges = outlines.distances(pose.point, self._angles + pose.yaw, model.range_max, others)
        ranges += model.sigma * draw(self._seed, self._name, tick).standard_normal(model.rays)
        ranges = np.maximum(ranges, model.range_min)
        ranges[ranges > model.range_max] = np.inf
        return ranges.astype(np.float32)
