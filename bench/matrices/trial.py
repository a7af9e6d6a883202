# SPDX-License-Identifier: Apache-2.0
"""Drives a simulated robot with the navigation of this package, without ROS and as fast as it computes.

For tests, for figures, and for engineers who change worlds or navigation and want to see the effect.
"""

import argparse
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import List, Optional, Protocol, Tuple

import numpy as np

from merlin_reactive.navigation.navigator import DriveOutcome, NavigationSettings, Navigator
from merlin_reactive.navigation.path_planner import NoPath
from merlin_reactive.pose import Point, Pose
from merlin_sim.engine.simulation import ODOMETRY_EVERY, RobotSpec, Simulation
from merlin_sim.robot.diff_drive import OdometryNoise
from merlin_sim.robot.truth_localization import PoseNoise, TruthLocalization
from merlin_sim.world.survey import map_of
from merlin_sim.world.world_model import World

SCAN_EVERY = 10  # physics steps
AT_SPEED = 0.05  # m/s from which touching something is a collision
URDF = Path(__file__).resolve().parents[2] / "src" / "merlin_sim" / "urdf" / "rb1.urdf"


def trials(text: str) -> int:
    """Reads how many trials there are to be, one or more.

    :raises argparse.ArgumentTypeError: when the text is not such a number.
    """
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of trials: give 1 or more")
    return int(text)


@dataclass
class TrialResult:
    """What became of a drive: s, m; `text` is what a client of move_base would read."""

    outcome: DriveOutcome
    text: str
    time: float
    distance: float
    collisions: int
    waited: float
    final_error: float
    path: List[Point] = field(default_factory=list)
    speeds: List[Tuple[float, float]] = field(default_factory=list)  # m/s, rad/s; one per point of the path

    @property
    def reached(self) -> bool:
        """Whether the goal was reached without a collision."""
        return self.outcome is DriveOutcome.REACHED and not self.collisions


class PoseSource(Protocol):
    """Where a robot believes it is."""

    def estimate(self, truth: Pose, time: float) -> Pose:
        """The believed pose (map frame) at a time, s."""
        ...


class Trial:
    """One robot in a world, and what navigation makes of it.

    :param start: map frame.
    :param noise: of the localisation.
    :param odometry: how the wheels' odometry drifts.
    """

    def __init__(
        self,
        world: World,
        start: Pose,
        seed: int = 1,
        settings: Optional[NavigationSettings] = None,
        noise: Optional[PoseNoise] = None,
        urdf: Path = URDF,
        odometry: Optional[OdometryNoise] = None,
    ) -> None:
        spec = RobotSpec("", start, odometry_noise=odometry or OdometryNoise())
        self.simulation = Simulation(world, [spec], urdf, seed)
        self.robot = self.simulation.robots[""]
        self.navigator = Navigator(map_of(world), settings or NavigationSettings(yaw_goal_tolerance=math.pi))
        self.localization: PoseSource = TruthLocalization(noise or PoseNoise(), seed, "")

    def drive(self, goal: Pose, limit: float = 180.0) -> TrialResult:
        """Drives to a goal; gives up after `limit` seconds of simulated time."""
        simulation, robot = self.simulation, self.robot
        began, driven = simulation.time, robot.distance
        angles = -math.pi + robot.lidar.increment * np.arange(robot.lidar.model.rays)
        path: List[Point] = []
        speeds: List[Tuple[float, float]] = []
        collisions, touching, waited = 0, False, 0.0
        outcome, text = DriveOutcome.NO_CONTROL, f"not there after {limit:g} s"
        started = False
        while simulation.time - began < limit:
            if simulation.tick % ODOMETRY_EVERY == 0:
                truth = robot.body.pose()
                path.append(truth.point)
                speeds.append(robot.body.velocity())
                pose = self.localization.estimate(truth, simulation.time)
                if simulation.tick % SCAN_EVERY == 0:
                    self.navigator.see(pose, angles, simulation.scan(robot), simulation.time)
                if not started:
                    try:
                        self.navigator.start(goal, pose, simulation.time)
                    except NoPath as error:
                        outcome, text = DriveOutcome.NO_PLAN, str(error)
                        break
                    started = True
                step = self.navigator.step(pose, robot.odometry.velocity, simulation.time)
                waited += ODOMETRY_EVERY / 100 if step.outcome is DriveOutcome.WAITING else 0.0
                robot.base.command(step.speed, step.turn, simulation.time)
                if step.ended:
                    outcome, text = step.outcome, step.text
                    break
            simulation.step()
            touches = robot.body.touches()
            if touches and not touching and math.hypot(*robot.body.velocity()) > AT_SPEED:
                collisions += 1
            touching = touches
        pose = robot.body.pose()
        return TrialResult(
            outcome,
            text,
            simulation.time - began,
            robot.distance - driven,
            collisions,
            waited,
            pose.distance(goal),
            path,
            speeds,
        )

    def close(self) -> None:
        """Gives the physics engine back."""
        self.simulation.close()
