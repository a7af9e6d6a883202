# SPDX-License-Identifier: Apache-2.0
"""Drives several simulated robots in one world, each with its own navigation, without ROS."""

import dataclasses
import math
from dataclasses import dataclass, field
from typing import Dict, List, Optional, Sequence

import numpy as np

from matrices.trial import AT_SPEED, SCAN_EVERY, URDF
from merlin_reactive.navigation.navigator import DriveOutcome, NavigationSettings, Navigator
from merlin_reactive.navigation.path_planner import NoPath
from merlin_reactive.navigation.right_of_way import RightOfWay
from merlin_reactive.pose import Pose
from merlin_sim.engine.simulation import ODOMETRY_EVERY, RobotSpec, Simulation, WorldRobot
from merlin_sim.robot.truth_localization import PoseNoise, TruthLocalization
from merlin_sim.world.survey import map_of
from merlin_sim.world.world_model import World

REPORT_EVERY = 10  # physics steps between two words of a robot to the others


@dataclass(frozen=True)
class Route:
    """What one robot does: from where to where, and how long it stands first (s)."""

    name: str
    start: Pose
    goal: Pose
    after: float = 0.0


@dataclass
class MeetingResult:
    """What became of all drives: how each ended, s until the last one had, m that all drove."""

    outcomes: Dict[str, DriveOutcome]
    texts: Dict[str, str]
    time: float
    driven: float
    collisions: int
    waited: float
    tracks: Dict[str, List[Pose]] = field(default_factory=dict)

    @property
    def solved(self) -> bool:
        """Whether every robot is where it was to go, and none touched anything."""
        return not self.collisions and all(each is DriveOutcome.REACHED for each in self.outcomes.values())


class _Driver:
    """One robot of the trial."""

    def __init__(self, route: Route, robot: WorldRobot, navigator: Navigator, seed: int) -> None:
        self.route, self.robot, self.navigator = route, robot, navigator
        self.localization = TruthLocalization(PoseNoise(), seed, route.name)
        self.outcome: Optional[DriveOutcome] = None
        self.text = ""
        self.waited = 0.0
        self.touching = False
        self.started = False

    def step(self, simulation: Simulation, angles: np.ndarray) -> None:
        """One control step."""
        now = simulation.time
        pose = self.localization.estimate(self.robot.body.pose(), now)
        if simulation.tick % SCAN_EVERY == 0:
            self.navigator.see(pose, angles, simulation.scan(self.robot), now)
        if self.outcome is not None or now < self.route.after:
            return
        if not self.started:
            try:
                self.navigator.start(self.route.goal, pose, now)
            except NoPath as error:
                self.outcome, self.text = DriveOutcome.NO_PLAN, str(error)
                return
            self.started = True
        step = self.navigator.step(pose, self.robot.odometry.velocity, now)
        self.waited += ODOMETRY_EVERY / 100 if step.outcome is DriveOutcome.WAITING else 0.0
        self.robot.base.command(step.speed, step.turn, now)
        if step.ended:
            self.outcome, self.text = step.outcome, step.text


def meet(world: World, routes: Sequence[Route], seed: int = 1, limit: float = 240.0) -> MeetingResult:
    """Drives all routes at once; gives up after `limit` seconds of simulated time."""
    specs = [RobotSpec(route.name, route.start) for route in routes]
    simulation = Simulation(world, specs, URDF, seed)
    grid = map_of(world)
    settings = NavigationSettings(yaw_goal_tolerance=math.pi)
    rules = [RightOfWay(route.name, settings.radius) for route in routes]
    drivers = [
        _Driver(route, simulation.robots[route.name], Navigator(grid, settings, rule), seed)
        for route, rule in zip(routes, rules)
    ]
    lidar = drivers[0].robot.lidar
    angles = -math.pi + lidar.increment * np.arange(lidar.model.rays)
    collisions = 0
    tracks: Dict[str, List[Pose]] = {route.name: [] for route in routes}
    try:
        while simulation.time < limit and any(driver.outcome is None for driver in drivers):
            if simulation.tick % ODOMETRY_EVERY == 0:
                for driver in drivers:
                    driver.step(simulation, angles)
                    tracks[driver.route.name].append(driver.robot.body.pose())
            if simulation.tick % REPORT_EVERY == 0:
                _tell(drivers, rules, simulation.time)
            simulation.step()
            for driver in drivers:
                body = driver.robot.body
                touches = body.touches()
                collisions += touches and not driver.touching and math.hypot(*body.velocity()) > AT_SPEED
                driver.touching = touches
    finally:
        time = simulation.time
        simulation.close()
    return MeetingResult(
        {driver.route.name: driver.outcome or DriveOutcome.WAITING for driver in drivers},
        {driver.route.name: driver.text or f"not there after {limit:g} s" for driver in drivers},
        time,
        sum(driver.robot.distance for driver in drivers),
        collisions,
        sum(driver.waited for driver in drivers),
        tracks,
    )


def _tell(drivers: Sequence[_Driver], rules: Sequence[RightOfWay], now: float) -> None:
    for driver in drivers:
        if driver.started:
            pose = driver.localization.estimate(driver.robot.body.pose(), now)
            said = driver.navigator.announcement(pose)
            assert said is not None, "it was given its rules"
            for rule in rules:
                rule.note(dataclasses.replace(said, driving=said.driving and driver.outcome is None), now)
