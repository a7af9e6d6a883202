# SPDX-License-Identifier: Apache-2.0
"""A world with robots in it, step by step. Knows no ROS and no wall time."""

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Dict, List, Set

import numpy as np

from merlin_reactive.navigation.path_follower import Path as Way
from merlin_reactive.pose import Point, Pose
from merlin_sim.engine.physics import Physics
from merlin_sim.engine.scene import Scene
from merlin_sim.engine.world_control import WorldControl
from merlin_sim.rendering.shot import Shot
from merlin_sim.robot.camera import CAMERA_LINK, Camera, CameraError, CameraModel
from merlin_sim.robot.diff_drive import (
    BaseController,
    DriveGeometry,
    DriveLimits,
    OdometryNoise,
    WheelOdometry,
)
from merlin_sim.robot.lidar import Lidar, LidarModel
from merlin_sim.world.world_model import DoorEvent, World, WorldEvent
from merlin_sim.world.world_places import ROBOT, ROBOT_RADIUS

PHYSICS_RATE = 100  # steps per simulated second
ODOMETRY_EVERY = 5  # steps
DOOR_ROOM = 0.15  # m that a door's leaf keeps from a robot


@dataclass(frozen=True)
class RobotSpec:
    """A robot to simulate.

    :param name: its namespace; may be empty.
    :param start: where it stands at the beginning, map frame.
    """

    name: str
    start: Pose
    limits: DriveLimits = field(default_factory=DriveLimits)
    odometry_noise: OdometryNoise = field(default_factory=OdometryNoise)
    lidar: LidarModel = field(default_factory=LidarModel)
    camera: CameraModel = field(default_factory=CameraModel)
    command_timeout: float = 0.5  # s


class WorldRobot:
    """A robot's body, base controller, odometry, laser and camera."""

    def __init__(self, spec: RobotSpec, physics: Physics, urdf: Path, seed: int) -> None:
        geometry = DriveGeometry()
        self.spec = spec
        self.body = physics.add_robot(urdf, spec.start, geometry)
        self.base = BaseController(spec.limits, geometry, spec.command_timeout)
        self.odometry = WheelOdometry(geometry, spec.odometry_noise, seed, spec.name)
        self.lidar = Lidar(spec.lidar, seed, spec.name)
        self.camera = Camera(spec.camera, seed, spec.name)
        self.distance = 0.0  # m really driven since the beginning
        self._last = spec.start

    def drive(self, now: float) -> None:
        """Passes the base controller's wheel speeds to the motors."""
        self.body.drive(*self.base.wheel_speeds(now, 1.0 / PHYSICS_RATE))

    def measure(self, tick: int) -> None:
        """Reads the encoders and adds up the distance."""
        self.odometry.update(*self.body.wheel_angles(), tick, ODOMETRY_EVERY / PHYSICS_RATE)
        pose = self.body.pose()
        self.distance += math.hypot(pose.x - self._last.x, pose.y - self._last.y)
        self._last = pose


class WorldEvents:
    """What the file of a world says will happen: doors that open and close, furniture that is moved.

    Everything happens at moments of simulated time; only a door waits, as it does not close on a robot.
    """

    def __init__(self, world: World, scene: Scene) -> None:
        self._world = world
        self._scene = scene
        self._pending: List[WorldEvent] = list(world.events)

    def step(self, now: float, robots: List[Point]) -> None:
        """Applies the events that are due at a time, s."""
        waiting: Set[str] = set()  # doors, whose later events wait as well
        for event in [event for event in self._pending if event.at <= now]:
            door = event.door if isinstance(event, DoorEvent) else ""
            if door not in waiting and self._happen(event, robots):
                self._pending.remove(event)
            elif door:
                waiting.add(door)

    def _happen(self, event: WorldEvent, robots: List[Point]) -> bool:
        """Plays an event; False when a robot is in its way."""
        world, keep = self._world, ROBOT_RADIUS + DOOR_ROOM
        if isinstance(event, DoorEvent):
            door = next(door for door in world.doors if door.name == event.door)
            way = Way([door.start, door.end])
            if not event.open and any(way.nearest(robot, 0.0, way.length)[1] < keep for robot in robots):
                return False
            self._scene.put_solid(door.leaf(world.wall_thickness, world.wall_height), not event.open)
            return True
        thing = next(solid for solid in world.furniture + world.unmapped if solid.name == event.thing)
        self._scene.put_solid(thing.moved(event.to), True)
        return True


class Simulation:
    """Owns the physics and the simulated time.

    :param urdf: description of the robots.
    :raises ValueError: two robots of one name, or too many.
    """

    def __init__(self, world: World, specs: List[RobotSpec], urdf: Path, seed: int) -> None:
        names = [spec.name for spec in specs]
        if len(set(names)) != len(names):
            raise ValueError(f"two robots have the same namespace: {names}")
        self.world = world
        self.tick = 0  # physics steps so far; everything random is indexed by it
        self.physics = Physics(world, 1.0 / PHYSICS_RATE)
        self.robots: Dict[str, WorldRobot] = {
            spec.name: WorldRobot(spec, self.physics, urdf, seed) for spec in specs
        }
        bodies = {name or ROBOT: robot.body for name, robot in self.robots.items()}
        self.scene = Scene(world, self.physics, bodies)
        self.control = WorldControl(world, self.scene)
        self._events = WorldEvents(world, self.scene)

    @property
    def time(self) -> float:
        """Simulated time, s."""
        return self.tick / PHYSICS_RATE

    @property
    def neglected(self) -> bool:
        """Whether a robot drives on an old command: its software does not keep up."""
        return any(robot.base.neglected(self.time) for robot in self.robots.values())

    def step(self) -> None:
        """Simulates one physics step."""
        now = self.time
        for robot in self.robots.values():
            robot.drive(now)
        self.physics.step()
        self.scene.carry()
        self.tick += 1
        if self.tick % ODOMETRY_EVERY == 0:
            for robot in self.robots.values():
                robot.measure(self.tick)
            places = [robot.body.pose().point for robot in self.robots.values()]
            self.scene.follow()
            self._events.step(self.time, places)
            self.control.step(self.time, ODOMETRY_EVERY / PHYSICS_RATE)

    def scan(self, robot: WorldRobot) -> np.ndarray:
        """What the robot's laser sees now, m."""
        others = [
            (pose.x, pose.y, ROBOT_RADIUS)
            for other in self.robots.values()
            if other is not robot
            for pose in [other.body.pose()]
        ]
        return robot.lidar.scan(robot.body.pose(), self.scene.outlines, others, self.tick)

    def shot(self, robot: WorldRobot) -> Shot:
        """What the robot's camera sees now, for a picture that is made while the simulation continues.

        :raises CameraError: its description has no camera.
        """
        pose = robot.body.camera_pose()
        if pose is None:
            raise CameraError(f"the robot's description has no link {CAMERA_LINK} with a mass")
        return self.physics.shot(robot.camera, pose, self.tick)

    def close(self) -> None:
        """Gives the engine back."""
        self.physics.close()
