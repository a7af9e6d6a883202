# SPDX-License-Identifier: Apache-2.0
"""The panel of the map: robots on it, their paths, points of interest and people."""

import math
from typing import Any, Callable, Dict, List, Optional, Tuple

import numpy
import roslib.message
import tf2_ros
from actionlib_msgs.msg import GoalStatus
from move_base_msgs.msg import MoveBaseActionGoal, MoveBaseActionResult
from nav_msgs.msg import OccupancyGrid, Path
from sensor_msgs.msg import LaserScan

from merlin_monitor.listeners.panel import Panel, PlanRobots
from merlin_monitor.listeners.ros_system import RosSystem
from merlin_monitor.state.freshness import Source
from merlin_monitor.state.map_section import Sent, yaw_of
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_monitor.truth.worst_truth import NAVIGATION

PEOPLE = (
    "merlin_msgs/SimPeople",
    "geometry_msgs/PoseArray",
    "people_msgs/People",
    "visualization_msgs/MarkerArray",
)
GOAL, RESULT = "move_base/goal", "move_base/result"
#: Of move_base and its global planners.
PATHS = ("move_base/plan", "move_base/NavfnROS/plan", "move_base/GlobalPlanner/plan")
SIMULATED_PEOPLE = "/merlin_sim/people"
POINTS = "world/points_of_interest"
MOVED = 0.02  # m or rad that the robot must move to be drawn anew
SCAN_SHOWN = 0.5  # s of wall time between two scans that are shown
OLD_POSITION = 2.0  # s of wall time without a newer position
#: No transform: none was received, or the name, which comes with messages, is one that no frame can have.
NO_TRANSFORM = (tf2_ros.TransformException, ValueError)


class MapPanel(Panel):
    """The map. People are followed on ``~people_topic`` in one of the types of `PEOPLE`; while it has no
    publisher, on the simulator's topic."""

    name, title, place, width = "map", "Map", 30, 5

    def __init__(self, state: MonitorModel, ros: RosSystem) -> None:
        super().__init__(state, ros)
        robot = self.ros.namespace.strip("/")
        base_frame = f"{robot}/base_footprint" if robot else "base_footprint"
        self._frames = (
            str(self.ros.parameter("~global_frame", "map")).lstrip("/"),
            str(self.ros.parameter("~base_frame", base_frame)).lstrip("/"),
        )
        map_topic = str(self.ros.parameter("~map_topic", "/map"))
        people_topic = self.ros.resolve(str(self.ros.parameter("~people_topic", "people")))
        simulated = self.ros.parameter("/use_sim_time", False)
        self._people_topics = [people_topic, SIMULATED_PEOPLE] if simulated else [people_topic]
        self._people: Any = None
        self._points: Any = None
        self._shown: Optional[Tuple[float, float, float]] = None
        self._robots: Dict[str, Tuple[float, float, float]] = {}  # of one plan, that are shown
        # ROS time of the newest position, and s of wall time when it came.
        self._located: Tuple[Optional[float], float] = (None, 0.0)
        self._scan: Optional[LaserScan] = None  # the last one, of the subscriber's thread
        self._scan_shown = 0.0  # s of wall time
        self._transform = self.ros.transforms()
        self._navigation = self._follow("")[0]
        self._subscribers = [
            self.subscribe(map_topic, OccupancyGrid, lambda grid, at: state.map.grid(grid), queue_size=1),
            self.ros.subscribe("scan", LaserScan, self._scanned, queue_size=1),
        ]
        self._others = PlanRobots(self, self._follow, state.map.forget)

    def look(self, topics: Dict[str, str]) -> None:
        """Notices people, points of interest and the robots of one plan."""
        self._others.look()
        for topic in self._people_topics:
            kind = topics.get(topic, "")
            message_class = roslib.message.get_message_class(kind) if kind in PEOPLE else None
            if self._people is None and message_class is not None:
                self._people = self.subscribe(
                    topic, message_class, lambda people, at: self.state.map.people(people), queue_size=1
                )
        points = self.ros.parameter(POINTS, {})
        if points != self._points:
            self._points = points
            self.state.inbox.put(self._take_points, points)

    def source(self) -> Source:
        """The robot's position, which may be old."""
        at, wall = self._located
        if (self.state.tree.get("meta", "simulator") or {}).get("paused"):
            self._located = at, self.ros.silence_clock()  # nothing moves, and nothing is lost
        located = at is not None and (at == 0.0 or self.ros.silence_clock() - self._located[1] < OLD_POSITION)
        return Source(located, "the robot's position")

    def owners(self) -> Dict[str, Source]:
        """The navigation servers, of which one that is gone or hangs is enough; where it is one, that one."""
        servers = [self.source_of(each) for each in (self._navigation, *self._others.subscribers(RESULT))]
        there = [each for each in servers if each.connected or each.node] or servers[:1]
        there.sort(key=lambda each: (each.connected, each.node))
        first = there[0]
        others = tuple(each.node for each in there[1:])
        return {NAVIGATION: first._replace(others=others)}

    def sample(self) -> None:
        """Looks where the robot is now."""
        self._look_at_scan()
        self._look_at_robots()
        pose = self._pose()
        if pose is not None and self._shown is not None:
            difference = [abs(a - b) for a, b in zip(pose, self._shown)]
            if max(difference) < MOVED:
                return
        if pose != self._shown:
            self._shown = pose
            self.state.inbox.put(self.state.map.robot, pose, self.ros.time())

    def _look_at_robots(self) -> None:
        """Where the robots of one plan are, when they publish it."""
        found = {name: self._pose_of(f"{name}/base_footprint") for name in sorted(self._others.names())}
        poses = {name: pose for name, pose in found.items() if pose is not None}
        moved = [
            name
            for name, pose in poses.items()
            if max(abs(a - b) for a, b in zip(pose, self._robots.get(name, (1e9,) * 3))) >= MOVED
        ]
        if moved or poses.keys() != self._robots.keys():
            self._robots = poses
            self.state.inbox.put(self.state.map.robots, poses)

    def _follow(self, robot: str) -> List[Any]:
        """Subscribes to where a robot is going; of several robots of one plan by their names."""
        shown, below = self.state.map, f"/{robot}/" if robot else ""

        def ended(end: MoveBaseActionResult, at: float) -> None:
            shown.ended(_failure(end), at, robot, _sent(end.status.goal_id))

        def goal(to: MoveBaseActionGoal, at: float) -> None:
            sent = _sent(to.goal_id if to.goal_id.id else to.header)
            shown.goal(self._target(to.goal.target_pose), self.ros.time(), robot, sent)

        takes: List[Tuple[str, type, Callable[[Any, float], None]]] = [
            (RESULT, MoveBaseActionResult, ended),
            (GOAL, MoveBaseActionGoal, goal),
        ]
        takes += [(path, Path, lambda way, at: shown.path(_points_of(way), at, robot)) for path in PATHS]
        return [
            self.subscribe(f"{below}{topic}", kind, take, queue_size=1 if kind is Path else 100)
            for topic, kind, take in takes
        ]

    def _target(self, target: Any) -> Optional[Tuple[float, float, float]]:
        """Where a goal is in the map's frame; None: no transform into it is known."""
        at, frame = target.pose, target.header.frame_id.lstrip("/")
        x, y, yaw = at.position.x, at.position.y, yaw_of(at.orientation)
        if frame in ("", self._frames[0]):
            return x, y, yaw
        try:
            from_x, from_y, turn = _pose_in(self._transform(self._frames[0], frame))
        except NO_TRANSFORM:
            return None
        cosine, sine = math.cos(turn), math.sin(turn)
        return from_x + x * cosine - y * sine, from_y + x * sine + y * cosine, yaw + turn

    def check(self, at: float, wall: float) -> None:
        """Notices that it stands."""
        self.state.map.look(at)

    def _scanned(self, scan: LaserScan) -> None:
        self._scan = scan

    def _look_at_scan(self) -> None:
        scan, wall = self._scan, self.ros.silence_clock()
        if scan is None or wall - self._scan_shown < SCAN_SHOWN:
            return
        self._scan, self._scan_shown = None, wall
        try:
            stamped = self._transform(self._frames[0], scan.header.frame_id.lstrip("/"))
        except NO_TRANSFORM:
            return
        self.state.inbox.put(self.state.map.seen, scan_points(scan, stamped.transform))

    def _pose(self) -> Optional[Tuple[float, float, float]]:
        try:
            stamped = self._transform(*self._frames)
        except NO_TRANSFORM:
            return None
        # Zero when all transforms on the way are static.
        at = stamped.header.stamp.to_sec()
        if at != self._located[0]:
            self._located = at, self.ros.silence_clock()
        return _pose_in(stamped)

    def _pose_of(self, frame: str) -> Optional[Tuple[float, float, float]]:
        try:
            return _pose_in(self._transform(self._frames[0], frame))
        except NO_TRANSFORM:
            return None

    def _take_points(self, points: Any) -> None:
        self.state.places(set(self.state.map.points(points)))


def _failure(end: MoveBaseActionResult) -> str:
    """Why a drive failed; empty: it did not."""
    failed = end.status.status in (GoalStatus.ABORTED, GoalStatus.REJECTED, GoalStatus.LOST)
    return end.status.text or "no reason given" if failed else ""


def scan_points(scan: Any, laser: Any) -> Any:
    """What a laser sees, m; an array of two columns.

    :param laser: geometry_msgs/Transform of the laser in the frame of the points; it may hang upside down.
    """
    ranges = numpy.asarray(scan.ranges, dtype=float)
    angles = scan.angle_min + scan.angle_increment * numpy.arange(len(ranges))
    hits = numpy.isfinite(ranges) & (ranges >= scan.range_min) & (ranges < scan.range_max)
    ranges, angles = ranges[hits], angles[hits]
    ahead, left = ranges * numpy.cos(angles), ranges * numpy.sin(angles)
    turn, place = laser.rotation, laser.translation
    x, y, z, w = turn.x, turn.y, turn.z, turn.w
    return numpy.column_stack(
        (
            place.x + (1.0 - 2.0 * (y * y + z * z)) * ahead + 2.0 * (x * y - w * z) * left,
            place.y + 2.0 * (x * y + w * z) * ahead + (1.0 - 2.0 * (x * x + z * z)) * left,
        )
    )


def _points_of(path: Path) -> List[Tuple[float, float]]:
    return [(stamped.pose.position.x, stamped.pose.position.y) for stamped in path.poses]


def _sent(of: Any) -> Sent:
    """Of a goal's id; of the header of a goal without one."""
    return Sent(getattr(of, "id", ""), of.stamp.to_sec())


def _pose_in(stamped: Any) -> Tuple[float, float, float]:
    found = stamped.transform
    return found.translation.x, found.translation.y, yaw_of(found.rotation)
