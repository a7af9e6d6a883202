# SPDX-License-Identifier: Apache-2.0
"""The section of the map: the map's picture, the robot, its path, points of interest and people on it."""

import math
from collections import deque
from typing import Any, Callable, Deque, Dict, List, NamedTuple, Optional, Sequence, Tuple, Union

import numpy

from merlin_monitor.history.pictures import Pictures, png
from merlin_monitor.state.guard_section import GUARD
from merlin_monitor.state.state_tree import StateTree
from merlin_monitor.text.phrase import Phrase, say
from merlin_ros.work.passed_time import clock_text

SECTION = "map"
MOST_PEOPLE = 200
ABSENT = 0  # state of a simulated person that is absent
SHOWN = 0  # action of a marker that is not to be deleted
NEAR_MAP = 0.2  # m around what the map shows, in which what is seen is that
MOST_SEEN = 150  # points
STANDS_AFTER = 3.0  # s without a move on the way to a goal
MOVED = 0.05  # m
TURNED = 0.1  # rad
LEVEL = 0.07  # of a quaternion, across: 8°
ROOM = 0.4  # m around the goal and the way that a robot needs
AHEAD = 1.0  # m of the way
_INK = {"free": 0, "unknown": 40, "occupied": 255}  # opacity
STANDS_GOAL = "stands since {time}: something that the map does not have stands at the goal"
STANDS_WAY = "stands since {time}: something that the map does not have is in the way"
STANDS = "stands since {time} on the way to its goal; nothing in the way is seen"
LONGEST_PATH = 300  # points that are shown
TRAIL_STEP = 0.15  # m between two points of the trail
LONGEST_TRAIL = 400  # points
JUMP = 2.0  # m; further away within one look, the robot was put there
LATE_GOALS = 20  # ends that may be read before their goals


class Sent(NamedTuple):
    """The id of a goal, and when it was sent, s of ROS time; one without an id gets both from its server."""

    id: str = ""
    stamp: float = 0.0

    def is_of(self, end: "Sent") -> bool:
        """Whether a result is that of this goal."""
        return self.id == end.id if self.id else self.stamp <= end.stamp


NOT_SAID = Sent()


class RobotTrack:
    """Keeps ``path``, ``goal`` and ``trail`` of one robot. Its goals, results and paths overtake each other.

    :param tree: of the state.
    :param place: where these three are in the state.
    """

    def __init__(self, tree: StateTree, *place: str) -> None:
        self._tree = tree
        self._place = place
        self._trail: Deque[Tuple[int, float, float]] = deque()
        self._runs: Optional[Sent] = None
        self._ends: Deque[Sent] = deque(maxlen=LATE_GOALS)
        self._ended = -math.inf  # s of ROS time

    def path(self, points: Sequence[Tuple[float, float]], at: float = math.inf) -> None:
        """The way the robot means to take, m; none: it is not going anywhere."""
        if self._runs is None and at < self._ended:
            return
        points = [(x, y) for x, y in points if math.isfinite(x + y)]
        stride = max(1, -(-len(points) // LONGEST_PATH))
        shown = [[round(x, 2), round(y, 2)] for x, y in points[::stride]]
        if points and stride > 1:
            shown.append([round(points[-1][0], 2), round(points[-1][1], 2)])
        self._tree.set(*self._place, "path", shown)

    def goal(
        self, pose: Optional[Tuple[float, float, float]], at: float = 0.0, sent: Sent = NOT_SAID
    ) -> bool:
        """Where it is going, m and rad; None: not known. Returns whether this is the goal that runs.

        :param at: s of ROS time; what is later is of before the clock began anew.
        """
        older = self._runs is not None and sent.stamp < self._runs.stamp <= at
        if older or (any(sent) and any(sent.is_of(end) for end in self._ends if end.stamp <= at)):
            return False
        self._runs = sent
        known = pose is not None and math.isfinite(sum(pose))
        self._tree.set(*self._place, "goal", [round(value, 3) for value in pose or ()] if known else None)
        return True

    def ended(self, end: Sent, at: float) -> bool:
        """A goal has ended. Returns whether none runs now."""
        self._ends.append(end)
        if self._runs is not None and not self._runs.is_of(end):
            return False
        self._runs, self._ended = None, at
        self._tree.set(*self._place, "goal", None)
        self._tree.set(*self._place, "path", [])
        return True

    def was(self, x: float, y: float) -> None:
        """Notes where the robot is, m."""
        trail = self._trail
        number = 0
        if trail:
            number, last_x, last_y = trail[-1]
            far = math.hypot(x - last_x, y - last_y)
            if far < TRAIL_STEP:
                return
            if far > JUMP:
                trail.clear()
                self._tree.set(*self._place, "trail", {})
        trail.append((number + 1, x, y))
        self._tree.set(*self._place, "trail", str(number + 1), [round(x, 2), round(y, 2)])
        if len(trail) > LONGEST_TRAIL:
            self._tree.remove(*self._place, "trail", str(trail.popleft()[0]))


def yaw_of(rotation: Any) -> float:
    """The yaw of a geometry_msgs/Quaternion, rad."""
    sine = 2.0 * (rotation.w * rotation.z + rotation.x * rotation.y)
    cosine = 1.0 - 2.0 * (rotation.y * rotation.y + rotation.z * rotation.z)
    return math.atan2(sine, cosine)


def grid_place(info: Any) -> Dict[str, Any]:
    """Origin (m), yaw (rad) and size (m) of a nav_msgs/MapMetaData, and as ``box`` what it covers."""
    width, height = info.width * info.resolution, info.height * info.resolution
    x, y, yaw = info.origin.position.x, info.origin.position.y, yaw_of(info.origin.orientation)
    corners = numpy.array([(0.0, 0.0), (width, 0.0), (0.0, height), (width, height)]) @ _turn(yaw).T + (x, y)
    low, high = corners.min(axis=0), corners.max(axis=0)
    box = dict(zip(("x", "y", "width", "height"), map(float, (*low, *(high - low)))))
    return {"x": x, "y": y, "yaw": yaw, "width": width, "height": height, "box": box}


def cells_of(info: Any, points: Any) -> Any:
    """The column and row of each point, also beyond the grid; points are x and y in m, one in each row."""
    origin = info.origin.position
    # Turned back by the inverse of the turn, which is its transpose.
    within = (points - (origin.x, origin.y)) @ _turn(yaw_of(info.origin.orientation))
    return numpy.floor(within / info.resolution).astype(int).T


def _turn(yaw: float) -> Any:
    return numpy.array([(math.cos(yaw), -math.sin(yaw)), (math.sin(yaw), math.cos(yaw))])


class MapSection:
    """Keeps the section ``map`` of the state; the picture itself is fetched by the page.

    :param pictures: takes the map's.
    """

    def __init__(self, tree: StateTree, pictures: Optional[Pictures] = None) -> None:
        self._tree = tree
        self._pictures = pictures or Pictures()
        self._mapped: Any = None  # cells with something on or near them, rows from the south
        self._info: Any = None
        self._tracks = {"": RobotTrack(tree, SECTION)}  # the others: of the robots of one plan
        self._moved: Tuple[float, float, float] = (0.0, 0.0, 0.0)  # m and rad, where it stands
        self._since = 0.0  # s of ROS time since when it stands there, or is to drive
        self._failed = ""  # why the last drive ended

    def grid(self, message: Any) -> None:
        """Takes a message with the fields of nav_msgs/OccupancyGrid."""
        info = message.info
        why = grid_trouble(info, len(message.data))
        self._tree.set(SECTION, "trouble", why and say("the map cannot be drawn: {why}", why=why))
        if why:
            self._mapped = self._info = None
            self._tree.set(SECTION, "grid", None)
            return
        self._info = info
        self._mapped = near_cells(message.data, info.width, info.height, NEAR_MAP / info.resolution)
        version = self._pictures.put(SECTION, grid_picture(message.data, info.width, info.height))
        place = {"version": version, "frame": message.header.frame_id, **grid_place(info)}
        self._tree.set(SECTION, "grid", place)

    def robot(self, pose: Optional[Tuple[float, float, float]], at: float = 0.0) -> None:
        """Where the robot is, m and rad in the map's frame; None: not known.

        :param at: s of ROS time.
        """
        if pose is not None:
            self.track("").was(pose[0], pose[1])
            x, y, yaw = self._moved
            turned = abs(math.remainder(pose[2] - yaw, math.tau)) > TURNED
            if turned or math.hypot(pose[0] - x, pose[1] - y) > MOVED:
                self._moved, self._since = pose, at
        shown = None if pose is None else [round(pose[0], 3), round(pose[1], 3), round(pose[2], 3)]
        self._tree.set(SECTION, "robot", shown)

    def robots(self, poses: Dict[str, Tuple[float, float, float]]) -> None:
        """Where the robots of one plan are, by their names, m and rad in the map's frame."""
        shown = {name: [round(value, 3) for value in pose] for name, pose in poses.items()}
        self._tree.set(SECTION, "robots", shown)
        for name, (x, y, _) in poses.items():
            self.track(name).was(x, y)

    def seen(self, points: Any) -> None:
        """What a laser sees; what the map has there is left out.

        :param points: x and y in the map's frame, m, as an array of two columns.
        """
        if self._mapped is not None and len(points):
            columns, rows = cells_of(self._info, points)
            height, width = self._mapped.shape
            inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
            points = points[inside][~self._mapped[rows[inside], columns[inside]]]
        points = points[:: max(1, -(-len(points) // MOST_SEEN))]
        self._tree.set(SECTION, "seen", [[round(float(x), 2), round(float(y), 2)] for x, y in points])

    def ended(self, reason: str, at: float, robot: str = "", sent: Sent = NOT_SAID) -> None:
        """A drive has ended.

        :param reason: why it failed; empty: it did not.
        :param robot: of one plan; empty: the one of the monitor's namespace.
        :param sent: its goal.
        """
        if self.track(robot).ended(sent, at) and not robot:
            self._failed = reason
            self.look(at)

    def look(self, at: float) -> None:
        """Says why the robot stands, while it is to drive, or why its last drive ended."""
        stands: Phrase = say("did not get there: {why}", why=self._failed) if self._failed else ""
        goal, robot = self._tree.get(SECTION, "goal"), self._tree.get(SECTION, "robot")
        kept = self._tree.get(GUARD, "state") in ("stopped", "holding")  # which is said elsewhere
        if kept or at < self._since:
            self._since = at
        if goal and robot and at - self._since > STANDS_AFTER:
            stands = say(self._why(goal, robot), time=clock_text(self._since))
        self._tree.set(SECTION, "stands", stands)

    def _why(self, goal: Sequence[float], robot: Sequence[float]) -> str:
        seen = self._tree.get(SECTION, "seen") or []

        def crowded(x: float, y: float) -> bool:
            return any(math.hypot(x - a, y - b) < ROOM for a, b in seen)

        if crowded(goal[0], goal[1]):
            return STANDS_GOAL
        way = [p for p in self._tree.get(SECTION, "path") or [] if math.dist(p, robot[:2]) < AHEAD]
        return STANDS_WAY if any(crowded(x, y) for x, y in way) else STANDS

    def path(self, points: Sequence[Tuple[float, float]], at: float = math.inf, robot: str = "") -> None:
        """The way a robot means to take, m, and when it was found; none: it is not going anywhere."""
        self.track(robot).path(points, at)

    def goal(
        self,
        pose: Optional[Tuple[float, float, float]],
        at: float = 0.0,
        robot: str = "",
        sent: Sent = NOT_SAID,
    ) -> None:
        """Where a robot is going, m and rad; None: not known.

        :param at: since when, s of ROS time: what it stood before does not count.
        """
        if self.track(robot).goal(pose, at, sent) and not robot:
            self._failed = ""
            self._since = max(self._since, at)

    def track(self, robot: str) -> RobotTrack:
        """Of one of the robots of a plan."""
        if robot not in self._tracks:
            self._tracks[robot] = RobotTrack(self._tree, SECTION, "ways", robot)
        return self._tracks[robot]

    def forget(self, robot: str) -> None:
        """A robot of a plan is no longer one."""
        self._tracks.pop(robot, None)
        self._tree.remove(SECTION, "ways", robot)
        self._tree.remove(SECTION, "robots", robot)

    def points(self, parameter: Any) -> List[str]:
        """Takes ``world/points_of_interest``: name → x, y, yaw. Returns the names."""
        points = read_points(parameter)
        self._tree.set(SECTION, "points", points)
        return list(points)

    def people(self, message: Any) -> None:
        """Takes people from a PoseArray, a People, a MarkerArray or a SimPeople, read by their fields."""
        people: List[List[Union[float, str]]] = []
        position_of: Dict[str, Callable[[Any], Any]] = {
            "poses": lambda pose: pose.position,
            "people": lambda person: getattr(person, "position", person),
            "markers": lambda marker: marker.pose.position,
        }
        for attribute, position in position_of.items():
            for item in getattr(message, attribute, ()):
                if getattr(item, "state", None) == ABSENT or getattr(item, "action", SHOWN) != SHOWN:
                    continue
                where = position(item)
                if not math.isfinite(where.x + where.y):
                    continue
                name = str(getattr(item, "name", "") or "")
                place: List[Union[float, str]] = [round(where.x, 2), round(where.y, 2)]
                people.append([*place, name] if name else place)
        self._tree.set(SECTION, "people", people[:MOST_PEOPLE])


def read_points(parameter: Any) -> Dict[str, List[float]]:
    """The points of interest of ``world/points_of_interest``: name → x, y, yaw."""
    points: Dict[str, List[float]] = {}
    for name, place in (parameter if isinstance(parameter, dict) else {}).items():
        try:
            point = [float(place["x"]), float(place["y"]), float(place.get("yaw", 0.0))]
        except (TypeError, KeyError, ValueError, AttributeError):
            continue  # another node's parameter of that name
        if math.isfinite(sum(point)):
            points[name] = point
    return points


def grid_trouble(info: Any, cells: int) -> Phrase:
    """Why a grid of a nav_msgs/MapMetaData and so many cells cannot be drawn; empty: it can."""
    at, turned = info.origin.position, info.origin.orientation
    length = math.hypot(math.hypot(turned.x, turned.y), math.hypot(turned.z, turned.w))
    if not cells or cells != info.width * info.height:
        return say("it has not the {cells} cells of its size", cells=f"{info.width} x {info.height}")
    if not 0.0 < info.resolution < math.inf:
        return say("its resolution is {number} m", number=f"{info.resolution:g}")
    if not math.isfinite(at.x + at.y):
        return say("its origin is at {place} m", place=f"{at.x:g}, {at.y:g}")
    # Where it is not set, it has the length 0.
    if length == 0.0 or (0.9 < length < 1.1 and math.hypot(turned.x, turned.y) < LEVEL):
        return ""
    return say("the orientation of its origin is not a turn on the floor")


def near_cells(data: Sequence[int], width: int, height: int, cells: float) -> Any:
    """Which cells of an occupancy grid have something on or near them; None: there is no grid."""
    if width <= 0 or height <= 0 or len(data) != width * height:
        return None
    taken = numpy.asarray(data, dtype=numpy.int8).reshape(height, width) > 50
    reach = int(min(cells, 20.0))
    for _ in range(2):  # along one axis, then, transposed, along the other
        grown = taken.copy()
        for step in range(1, reach + 1):
            grown[step:] |= taken[:-step]
            grown[:-step] |= taken[step:]
        taken = grown.T
    return taken


def grid_picture(data: Sequence[int], width: int, height: int) -> bytes:
    """An occupancy grid as PNG: black, more or less opaque, north up; the page turns black into its ink."""
    cells = numpy.asarray(data, dtype=numpy.int8)
    if width <= 0 or height <= 0 or cells.size != width * height:
        cells, width, height = numpy.full(1, -1, dtype=numpy.int8), 1, 1
    alpha = numpy.full(cells.shape, _INK["unknown"], dtype=numpy.uint8)
    alpha[cells == 0] = _INK["free"]
    known = cells > 0
    alpha[known] = (cells[known].astype(numpy.uint16) * _INK["occupied"] // 100).clip(0, 255)
    rows = numpy.zeros((height, width, 2), dtype=numpy.uint8)
    rows[:, :, 1] = alpha.reshape(height, width)[::-1]
    return png(rows)
