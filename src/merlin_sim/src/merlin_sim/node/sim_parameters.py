# SPDX-License-Identifier: Apache-2.0
"""The simulator's parameters, checked."""

import math
from dataclasses import dataclass
from typing import List

import rospy

from merlin_ros.parameters import ParameterError, choice, number, whole
from merlin_sim.engine.simulation import RobotSpec
from merlin_sim.node.robot_starts import place_robots
from merlin_sim.robot.camera import CameraModel
from merlin_sim.robot.diff_drive import DriveLimits, OdometryNoise
from merlin_sim.robot.lidar import LidarModel
from merlin_sim.robot.truth_localization import PoseNoise
from merlin_sim.world.world_model import World


@dataclass(frozen=True)
class SimParameters:
    """Private parameters of the simulator, except those of the robots."""

    world: str
    urdf: str
    seed: int
    real_time_factor: float
    localization: str
    pose_noise: PoseNoise
    camera_rate: float
    camera_latency: float


def read_parameters() -> SimParameters:
    """Reads the private parameters.

    :raises ParameterError: when one is missing or out of range.
    """
    world = rospy.get_param("~world", "")
    if not isinstance(world, str) or not world:
        raise ParameterError("parameter ~world is missing: the path of a world file (see docs/simulation.md)")
    return SimParameters(
        world=world,
        urdf=str(rospy.get_param("~urdf", "")),
        seed=whole("~seed", 1),
        real_time_factor=number("~real_time_factor", 1.0, 0.0),
        localization=choice("~localization", ("truth", "particles", "none")),
        pose_noise=PoseNoise(
            xy=number("~localization_noise_xy", PoseNoise.xy, 0.0),
            yaw=number("~localization_noise_yaw", PoseNoise.yaw, 0.0),
        ),
        camera_rate=number("~camera_rate", 2.0, 0.1),
        camera_latency=number("~camera_latency", 0.2, 0.01),
    )


def read_robots(world: World) -> List[RobotSpec]:
    """Reads ``~robots``, see :func:`place_robots`, and what all of them have.

    :raises ParameterError: when a robot cannot be placed, or another parameter is wrong.
    """
    placed = place_robots(rospy.get_param("~robots", [""]), world)
    limits = DriveLimits(
        speed=number("~max_speed", DriveLimits.speed, 0.01),
        turn_speed=number("~max_turn_speed", DriveLimits.turn_speed, 0.01),
        acceleration=number("~acceleration", DriveLimits.acceleration, 0.01),
        turn_acceleration=number("~turn_acceleration", DriveLimits.turn_acceleration, 0.01),
    )
    noise = OdometryNoise(
        distance_scale=number("~odometry_distance_scale", 0.0, 0.0),
        turn_scale=number("~odometry_turn_scale", 0.0, 0.0),
        distance=number("~odometry_distance_noise", 0.005, 0.0),
        turn=number("~odometry_turn_noise", 0.005, 0.0),
    )
    lidar = LidarModel(sigma=number("~scan_noise", LidarModel.sigma, 0.0))
    camera = _camera()
    timeout = number("~cmd_vel_timeout", RobotSpec.command_timeout, 0.05)
    return [RobotSpec(name, start, limits, noise, lidar, camera, timeout) for name, start in placed]


def _camera() -> CameraModel:
    width, height = (
        number(f"~camera_{name}", default, 16) for name, default in (("width", 640), ("height", 480))
    )
    fov = number("~camera_fov", CameraModel.fov, 0.1)
    if max(width, height) > 4096:
        raise ParameterError("parameters ~camera_width, ~camera_height: at most 4096 pixels")
    if fov > 0.9 * math.pi:
        raise ParameterError(f"parameter ~camera_fov is {fov:g} rad, more than {0.9 * math.pi:.2f}")
    return CameraModel(int(width), int(height), fov, number("~camera_noise", CameraModel.noise, 0.0))
