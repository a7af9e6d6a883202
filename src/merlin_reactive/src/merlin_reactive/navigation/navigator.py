# SPDX-License-Identifier: Apache-2.0
"""Brings a robot to a pose: plans, follows, waits for what is in the way, goes round it, or says why not.

Knows no ROS: the node feeds poses and scans in and sends the velocities that come out.
"""

import enum
import math
from dataclasses import dataclass, field, replace
from typing import List, Optional, Tuple

import numpy as np

from merlin_reactive.navigation.giving_way import GivingWay
from merlin_reactive.navigation.obstacle_memory import ObstacleMemory
from merlin_reactive.navigation.path_follower import Cruise, Path, PathFollower
from merlin_reactive.navigation.path_planner import NoPath, PathPlanner
from merlin_reactive.navigation.right_of_way import ANNOUNCED, STEP, RightOfWay, RobotWay
from merlin_reactive.navigation.scan_guard import ScanGuard
from merlin_reactive.occupancy_grid import OccupancyGrid, hit_points
from merlin_reactive.pose import Point, Pose, wrap

# What the move_base of ROS says; clients compare with these.
REACHED_TEXT = "Goal reached."
NO_PLAN_TEXT = "Failed to find a valid plan. Even after executing recovery behaviors."
NO_CONTROL_TEXT = "Failed to find a valid control. Even after executing recovery behaviors."

AHEAD = 2.0  # m of path that is watched for obstacles
STOP_GAP = 0.25  # m before the place where an obstacle would be too close at which the robot waits
STANDING = 0.02  # m/s and rad/s below which the robot counts as standing
BIAS = 0.1  # m/s and rad/s that odometry may show at most while it stands
TURNED = 0.1  # rad, also nearer to the heading of the goal, that count as turning
TURNS = math.ceil(2 * math.pi / TURNED)  # on the spot that count: a base that sways does not get away
CREEP = 0.03  # m/s below which it rather stands
HERE = 0.7  # m within which waiting continues and does not begin anew
GIVE_WAY = 0.5  # m that it backs off for a person that waits for it
RECOVERY_WAY = 0.15  # m that it backs off when it does not get away
BACK_SPEED = 0.1  # m/s
STOP_RESERVE = 0.01  # m inside the tolerance of the goal that stopping is aimed at
LOST_PATH = 0.5  # m off the path at which a new one is planned
MIDDLE = Pose(0.0, 0.0)  # of the robot
YIELD_GAP = 0.05  # m before another robot's way at which it waits
BESIDE_ROBOT = 0.12  # m around a robot within which what was seen is that robot


class DriveOutcome(enum.Enum):
    """State of a drive."""

    DRIVING = "driving"
    WAITING = "waiting"
    REACHED = "reached"
    NO_PLAN = "no plan"
    NO_CONTROL = "no control"


@dataclass(frozen=True)
class NavigationSettings:
    """Settings of a drive; m, rad, s."""

    radius: float = 0.25
    clearance: float = 0.05  # of plans from mapped and seen obstacles
    tight_clearance: float = 0.025  # where there is no other way
    guard: float = 0.015  # around the robot that the live scan must leave free
    cruise: Cruise = field(default_factory=Cruise)
    xy_goal_tolerance: float = 0.10
    yaw_goal_tolerance: float = 0.10  # pi or more: any final yaw
    replan_after: float = 1.0  # s to wait for a person to go away before it plans a detour
    patience: float = 20.0  # waited in all before it gives up
    recover_after: float = 4.0  # without movement, though nothing blocks the path
    recoveries: int = 3
    keep_obstacles: float = 30.0  # remembered unseen
    yield_patience: float = 60.0  # s of giving way to other robots before it gives up


@dataclass(frozen=True)
class DriveStep:
    """The command: speeds (m/s, rad/s), the state of the drive, and a sentence about it."""

    speed: float
    turn: float
    outcome: DriveOutcome
    text: str = ""

    @property
    def ended(self) -> bool:
        """Whether there is nothing more to do."""
        return self.outcome not in (DriveOutcome.DRIVING, DriveOutcome.WAITING)


class Navigator:
    """Drives one robot on one map, to one goal at a time. Used by one thread at a time.

    :param rules: the right of way where it meets other robots; None: it is alone.
    """

    def __init__(
        self, grid: OccupancyGrid, settings: NavigationSettings, rules: Optional[RightOfWay] = None
    ) -> None:
        self.settings = settings
        self.planner = PathPlanner(grid, settings.radius, settings.clearance)
        self.memory = ObstacleMemory(grid, self.planner.distance, settings.keep_obstacles)
        self._giving = GivingWay(rules, self.planner) if rules else None
        self._guard = ScanGuard(settings.radius, settings.guard, settings.cruise.acceleration)
        self._goal: Optional[Pose] = None
        self._follower: Optional[PathFollower] = None
        self.path: List[Point] = []  # corners of the path that is followed

    def see(
        self, pose: Pose, angles: np.ndarray, ranges: np.ndarray, now: float, mount: Pose = MIDDLE
    ) -> None:
        """Takes a scan, made at a pose of the laser; angles relative to it.

        :param mount: of the laser on the robot.
        """
        self._guard.see(hit_points(mount, angles, ranges))
        self.memory.see(pose, angles, ranges, now)
        for robot in self._giving.rules.others(now) if self._giving else ():
            self.memory.forget_near(robot.pose.point, robot.radius + BESIDE_ROBOT)

    def start(self, goal: Pose, pose: Pose, now: float) -> None:
        """Begins to drive to a goal.

        :raises NoPath: when the goal can never be reached on this map.
        """
        self._goal = goal
        self._follower = None
        self._seen = np.zeros((0, 2))  # what stands beside the map, at this step
        self._waits_at: Optional[Pose] = None  # where it first had to wait, about here
        self._waits_since = now
        self._gave_way = False
        self._planned_at = -math.inf
        self._why = ""
        self._moved_at, self._moved_from = now, pose
        self._turns = 0  # since it last changed its place
        self._recoveries = 0
        self._backing: Optional[Pose] = None  # where it began to back off
        self._backing_way, self._backing_since = 0.0, now
        self._at_goal = False
        self._least_error = math.inf  # rad, of the heading at the goal
        self._astray_since: Optional[float] = None  # since its path leads elsewhere than it is to go
        if self._giving:
            self._giving.start()
        try:
            self._follow(self.planner.plan(pose.point, goal.point, self.memory.points(now)))
        except NoPath:
            # What was seen may go away; what is on the map does not.
            self._follow(self.planner.plan(pose.point, goal.point))

    def step(self, pose: Pose, velocity: Tuple[float, float], now: float) -> DriveStep:
        """What to do at a pose, at a measured velocity (m/s, rad/s)."""
        assert self._goal is not None and self._follower is not None, "start() comes first"
        settings = self.settings
        self._follower.locate(pose)
        off = pose.distance(self._goal)
        if self._at_goal and off > 2 * settings.xy_goal_tolerance:  # it was pushed, or localised anew
            self._at_goal, self._least_error = False, math.inf
            self._moved_at, self._moved_from = now, pose
            self._replan(pose, now)
        if self._at_goal or off <= settings.xy_goal_tolerance:
            self._at_goal = True  # passing the edge of the tolerance while turning starts nothing anew
            return self._finish(pose, velocity, now)
        stop = self._stops_at(pose, velocity[0])
        if stop.distance(self._goal) <= settings.xy_goal_tolerance - STOP_RESERVE:
            return DriveStep(0.0, 0.0, DriveOutcome.DRIVING, "braking for the goal")
        if self._follower.offset > LOST_PATH:
            self._replan(pose, now)
        if self._backing is not None:
            return self._back_off(pose, now)
        limit = settings.cruise.speed
        if self._giving:
            limit, stands = self._give_way(self._giving, pose, now)
            if stands is not None:
                return stands
        self._seen = self._obstacles(now)
        room = self._room_ahead(now)
        if room < AHEAD:
            if self._waits_at is None or pose.distance(self._waits_at) > HERE:
                self._waits_at, self._waits_since, self._gave_way = pose, now, False
            waited = now - self._waits_since
            if min(waited, now - self._planned_at) >= settings.replan_after and self._replan(pose, now):
                room = self._room_ahead(now)
            limit = min(limit, math.sqrt(2 * settings.cruise.acceleration * max(0.0, room - STOP_GAP)))
            if limit < CREEP:
                return self._wait(pose, waited, now)
        return self._drive(pose, limit, now)

    def _give_way(self, giving: GivingWay, pose: Pose, now: float) -> Tuple[float, Optional[DriveStep]]:
        """The speed (m/s) that the other robots leave it, and the step if it has to stand."""
        settings = self.settings
        way = np.array([pose.point]) if giving.rules.astray else self.way()
        given = giving.step(pose, way, self.memory.points(now), now)
        if given.replan and self._astray_since is None:
            self._astray_since = now
        if self._astray_since is not None and (
            given.replan or now - self._planned_at >= settings.replan_after
        ):
            if self._replan(pose, now):
                self._astray_since = None
            elif giving.refuge is not None:
                giving.unreachable()
        giving.rules.astray = self._astray_since is not None
        room = given.room if self._astray_since is None else 0.0
        limit = math.sqrt(2 * settings.cruise.acceleration * max(0.0, room - YIELD_GAP))
        if limit >= CREEP:
            return min(limit, settings.cruise.speed), None
        waited = given.waited if self._astray_since is None else now - self._astray_since
        if max(waited, given.waited) >= settings.yield_patience:
            why = f"For {settings.yield_patience:g} s it {given.reason}."
            return 0.0, DriveStep(0.0, 0.0, DriveOutcome.NO_PLAN, f"{NO_PLAN_TEXT} {why}")
        self._moved_at, self._moved_from = now, pose
        return 0.0, DriveStep(0.0, 0.0, DriveOutcome.WAITING, given.reason)

    def _stops_at(self, pose: Pose, speed: float) -> Pose:
        """Where the robot stands when it brakes now."""
        way = speed * abs(speed) / (2 * self.settings.cruise.acceleration)
        return Pose(pose.x + way * math.cos(pose.yaw), pose.y + way * math.sin(pose.yaw), pose.yaw)

    def _wait(self, pose: Pose, waited: float, now: float) -> DriveStep:
        """Stands before what is in the way, makes room for it once, and gives up in the end."""
        if waited >= self._patience(pose, now):
            why = self._why or "Something stands in the way."
            return DriveStep(0.0, 0.0, DriveOutcome.NO_PLAN, f"{NO_PLAN_TEXT} {why}")
        self._moved_at, self._moved_from = now, pose  # standing is right here
        if waited >= self.settings.patience / 2 and not self._gave_way:
            # A robot and a person that wait for each other in a doorway wait forever.
            self._gave_way = True
            self._backing, self._backing_way, self._backing_since = pose, GIVE_WAY, now
        return DriveStep(0.0, 0.0, DriveOutcome.WAITING, "something is in the way")

    def _patience(self, pose: Pose, now: float) -> float:
        """s that it stands before what is in the way: a robot that drives is going to move."""
        robots = self._giving.rules.others(now) if self._giving else []
        near = any(
            other.pose.distance(pose) < other.radius + self.settings.radius + AHEAD for other in robots
        )
        return self.settings.yield_patience if near else self.settings.patience

    def _back_off(self, pose: Pose, now: float) -> DriveStep:
        assert self._backing is not None
        speed = self._guard.allowed(-BACK_SPEED, 0.0)
        gone = pose.distance(self._backing)
        if speed == 0.0 or gone > self._backing_way or now - self._backing_since > 10.0:
            self._backing = None
            self._moved_at, self._moved_from = now, pose
            self._replan(pose, now)
            return DriveStep(0.0, 0.0, DriveOutcome.DRIVING, "backed off")
        return DriveStep(speed, 0.0, DriveOutcome.DRIVING, "backing off")

    def way(self) -> np.ndarray:
        """The next points (n x 2, STEP apart) of the path that is followed, and its end if that is near."""
        assert self._follower is not None
        length = min(self._follower.remaining, (ANNOUNCED - 2) * STEP)
        along = self._follower.progress + np.append(np.arange(0.0, length, STEP), length)
        return self._follower.path.at(along)

    def announcement(self, pose: Pose) -> Optional[RobotWay]:
        """What other robots have to know of this one while it drives; None: it drives alone."""
        if self._giving is None:
            return None
        rules = self._giving.rules
        way = np.array([pose.point]) if rules.astray else self.way()
        return RobotWay(rules.name, pose, rules.radius, way, rules.cornered, self._giving.refuge is not None)

    def _obstacles(self, now: float) -> np.ndarray:
        seen = self.memory.points(now)
        return seen if self._giving is None else np.concatenate([seen, self._giving.rules.bodies(now)])

    def clear(self) -> None:
        """Forgets what was seen beside the map."""
        self.memory.forget()

    def _drive(self, pose: Pose, limit: float, now: float) -> DriveStep:
        assert self._follower is not None
        settings = self.settings
        if pose.distance(self._moved_from) > 0.05:
            self._moved_at, self._moved_from, self._turns = now, pose, 0
        elif abs(wrap(pose.yaw - self._moved_from.yaw)) > TURNED and self._turns < TURNS:
            self._moved_at, self._moved_from = now, replace(self._moved_from, yaw=pose.yaw)
            self._turns += 1
        if now - self._moved_at > settings.recover_after:
            self._recoveries += 1
            if self._recoveries > settings.recoveries:
                why = "The robot does not get away from where it is."
                return DriveStep(0.0, 0.0, DriveOutcome.NO_CONTROL, f"{NO_CONTROL_TEXT} {why}")
            self._backing, self._backing_way, self._backing_since = pose, RECOVERY_WAY, now
        speed, turn = self._follower.command(pose, limit)
        return DriveStep(*self._guard.steered(speed, turn, settings.cruise.turn_speed), DriveOutcome.DRIVING)

    def _finish(self, pose: Pose, velocity: Tuple[float, float], now: float) -> DriveStep:
        """Turns and stops at the goal, and gives up a base that does not."""
        assert self._goal is not None and self._follower is not None
        settings = self.settings
        error = wrap(self._goal.yaw - pose.yaw)
        if abs(error) < self._least_error - TURNED:
            self._moved_at, self._least_error = now, abs(error)
        late = now - self._moved_at > settings.recover_after
        turns = settings.yaw_goal_tolerance < math.pi and abs(error) > settings.yaw_goal_tolerance
        speed = max(abs(velocity[0]), abs(velocity[1]))
        if late and (turns or speed > BIAS):
            self._moved_at = now
            self._recoveries += 1
            if self._recoveries > settings.recoveries:
                why = f"The robot does not {'turn' if turns else 'stop'} at its goal."
                return DriveStep(0.0, 0.0, DriveOutcome.NO_CONTROL, f"{NO_CONTROL_TEXT} {why}")
        if turns:
            return DriveStep(0.0, self._follower.turn(error), DriveOutcome.DRIVING)
        if speed > (BIAS if late else STANDING):
            return DriveStep(0.0, 0.0, DriveOutcome.DRIVING)
        return DriveStep(0.0, 0.0, DriveOutcome.REACHED, REACHED_TEXT)

    def _room_ahead(self, now: float) -> float:
        """How far along the path the robot can go before something seen is too close, m; AHEAD at most."""
        assert self._follower is not None
        points = self._obstacles(now)
        if not len(points):
            return AHEAD
        along = np.arange(0.0, min(AHEAD, self._follower.remaining) + 0.05, 0.05)
        ahead = self._follower.path.at(self._follower.progress + along)
        low, high = ahead.min(axis=0) - 0.5, ahead.max(axis=0) + 0.5
        points = points[((points >= low) & (points <= high)).all(axis=1)]
        if not len(points):
            return AHEAD
        gaps = np.hypot(ahead[:, :1] - points[:, 0], ahead[:, 1:] - points[:, 1]).min(axis=1)
        # Where the robot is already, it is: only what comes nearer counts.
        close = gaps < min(self.settings.radius + self.settings.tight_clearance - 0.01, gaps[0] - 0.01)
        return float(along[np.argmax(close)]) if close.any() else AHEAD

    def _replan(self, pose: Pose, now: float) -> bool:
        assert self._goal is not None
        self._planned_at = now
        aside = self._giving.refuge if self._giving else None
        target = self._goal.point if aside is None else aside
        # Where no way leads past them, those that go after it make room.
        for around in self._giving.bodies(now) if self._giving else [np.zeros((0, 2))]:
            seen = np.concatenate([self.memory.points(now), around])
            for clearance in (self.settings.clearance, self.settings.tight_clearance):
                try:
                    self._follow(self.planner.plan(pose.point, target, seen, clearance))
                    return True
                except NoPath as error:
                    self._why = f"{str(error)[0].upper()}{str(error)[1:]}."
        return False

    def _follow(self, path: List[Point]) -> None:
        self.path = path
        self._follower = PathFollower(Path(path), self.settings.cruise, self._may_go)

    def _may_go(self, start: Point, end: Point) -> bool:
        """Whether going straight keeps enough distance, or at least does not come nearer to anything."""
        samples = max(2, math.ceil(math.dist(start, end) / 0.025) + 1)
        way = np.linspace(start, end, samples)
        room = self.planner.rooms(way)
        seen = self._seen[np.hypot(*(self._seen - start).T) < 1.5]
        if len(seen):
            gaps = np.hypot(way[:, :1] - seen[:, 0], way[:, 1:] - seen[:, 1]).min(axis=1)
            room = np.minimum(room, gaps)
        enough = self.settings.radius + (self.settings.clearance + self.settings.tight_clearance) / 2
        return bool(room.min() >= min(enough, room[0] - 0.005))
