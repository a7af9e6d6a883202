# SPDX-License-Identifier: Apache-2.0
"""Where the robot believes to be: truth with stated noise."""

from dataclasses import dataclass
from typing import List

from merlin_reactive.pose import Pose, wrap
from merlin_sim.robot.smooth_noise import SmoothNoise

WANDER = 2.0  # s within which the error becomes another one


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
