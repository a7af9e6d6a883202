"""The panel of the map: the robot on it, its path, points of interest and people."""

import math
from typing import Any, Dict, Optional, Tuple

import roslib.message
import rospy
import tf2_ros
from geometry_msgs.msg import PoseStamped
from move_base_msgs.msg import MoveBaseActionResult
from nav_msgs.msg import OccupancyGrid, Path

from merlin_monitor.listeners.graph_watch import GraphWatch
from merlin_monitor.listeners.panel import Panel
from merlin_monitor.state.freshness import Source
from merlin_monitor.state.monitor_model import MonitorModel

PEOPLE = (
    "merlin_msgs/SimPeople",
    "geometry_msgs/PoseArray",
    "people_msgs/People",
    "visualization_msgs/MarkerArray",
)
PATHS = ("plan", "NavfnROS/plan", "GlobalPlanner/plan")  # of move_base and its global planners
SIMULATED_PEOPLE = "/merlin_sim/people"
POINTS = "world/points_of_interest"
MOVED = 0.02  # m or rad that the robot must move to be drawn anew
OLD_POSITION = 2.0  # s of ROS time after which a position counts as old


class MapPanel(Panel):
    """The map. People are followed on ``~people_topic`` in one of the types of `PEOPLE`; while it has no
    publisher, on the simulator's topic."""

    name, title, place, width = "map", "Map", 30, 5

    def __init__(self, state: MonitorModel, watch: GraphWatch) -> None:
        super().__init__(state, watch)
        robot = rospy.get_namespace().strip("/")
        base_frame = f"{robot}/base_footprint" if robot else "base_footprint"
        self._frames = (
            str(rospy.get_param("~global_frame", "map")),
            str(rospy.get_param("~base_frame", base_frame)),
        )
        map_topic = str(rospy.get_param("~map_topic", "/map"))
        people_topic = rospy.resolve_name(str(rospy.get_param("~people_topic", "people")))
        self._people_topics = [people_topic, SIMULATED_PEOPLE]
        self._people: Optional[rospy.Subscriber] = None
        self._points: Any = None
        self._shown: Optional[Tuple[float, float, float]] = None
        self._located_at: Optional[float] = None
        self._buffer = tf2_ros.Buffer(rospy.Duration(5.0))
        self._transforms = tf2_ros.TransformListener(self._buffer)
        self._subscribers = [
            self.subscribe(map_topic, OccupancyGrid, lambda grid, at: state.map.grid(grid), queue_size=1),
            self.subscribe("move_base/current_goal", PoseStamped, self._goal),
            self.subscribe("move_base/result", MoveBaseActionResult, self._arrived),
            *(self.subscribe(f"move_base/{path}", Path, self._path, queue_size=1) for path in PATHS),
        ]

    def look(self, topics: Dict[str, str]) -> None:
        """Notices people and points of interest."""
        for topic in self._people_topics:
            kind = topics.get(topic, "")
            message_class = roslib.message.get_message_class(kind) if kind in PEOPLE else None
            if self._people is None and message_class is not None:
                self._people = self.subscribe(
                    topic, message_class, lambda people, at: self.state.map.people(people), queue_size=1
                )
        points = rospy.get_param(POINTS, {})
        if points != self._points:
            self._points = points
            self.state.inbox.put(self._take_points, points)

    def source(self) -> Source:
        """The robot's position, which may be old."""
        at = self._located_at
        located = at is not None and (at == 0.0 or rospy.get_time() - at < OLD_POSITION)
        return Source(located, "the robot's position")

    def sample(self) -> None:
        """Looks where the robot is now."""
        pose = self._pose()
        if pose is not None and self._shown is not None:
            difference = [abs(a - b) for a, b in zip(pose, self._shown)]
            if max(difference) < MOVED:
                return
        if pose != self._shown:
            self._shown = pose
            self.state.inbox.put(self.state.map.robot, pose)

    def _pose(self) -> Optional[Tuple[float, float, float]]:
        try:
            stamped = self._buffer.lookup_transform(*self._frames, rospy.Time(0))
        except tf2_ros.TransformException:
            return None
        # Zero when all transforms on the way are static.
        self._located_at = stamped.header.stamp.to_sec()
        found = stamped.transform
        return found.translation.x, found.translation.y, _yaw(found.rotation)

    def _take_points(self, points: Any) -> None:
        self.state.now.places = set(self.state.map.points(points))
        self.state.now.refresh()

    def _path(self, message: Path, at: float) -> None:
        self.state.map.path([(stamped.pose.position.x, stamped.pose.position.y) for stamped in message.poses])

    def _goal(self, message: PoseStamped, at: float) -> None:
        where = message.pose.position
        self.state.map.goal((where.x, where.y, _yaw(message.pose.orientation)))

    def _arrived(self, message: MoveBaseActionResult, at: float) -> None:
        self.state.map.goal(None)
        self.state.map.path([])


def _yaw(rotation: Any) -> float:
    sine = 2.0 * (rotation.w * rotation.z + rotation.x * rotation.y)
    cosine = 1.0 - 2.0 * (rotation.y * rotation.y + rotation.z * rotation.z)
    return math.atan2(sine, cosine)
