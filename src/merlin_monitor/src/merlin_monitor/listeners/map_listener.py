"""Follows the map, the robot on it, its path, points of interest and people."""

import math
from typing import Any, Dict, List, Optional, Tuple

import roslib.message
import rospy
import tf2_ros
from geometry_msgs.msg import PoseStamped
from move_base_msgs.msg import MoveBaseActionResult
from nav_msgs.msg import OccupancyGrid, Path

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


class MapListener:
    """Keeps the section of the map up to date.

    :param state: the model.
    :param map_topic: of the map.
    :param global_frame: the map's frame.
    :param base_frame: the robot's frame.
    :param people_topic: of people's positions, of one of the types in `PEOPLE`; without a publisher, the
        simulator's topic is taken.
    """

    def __init__(
        self, state: MonitorModel, map_topic: str, global_frame: str, base_frame: str, people_topic: str
    ) -> None:
        self._state = state
        self._frames = global_frame, base_frame
        self._people_topics = [rospy.resolve_name(people_topic), SIMULATED_PEOPLE]
        self._people: Optional[rospy.Subscriber] = None
        self._points: Any = None
        self._shown: Optional[Tuple[float, float, float]] = None
        self._located_at: Optional[float] = None
        self._buffer = tf2_ros.Buffer(rospy.Duration(5.0))
        self._transforms = tf2_ros.TransformListener(self._buffer)
        self._subscribers = [
            rospy.Subscriber(map_topic, OccupancyGrid, self._grid, queue_size=1),
            rospy.Subscriber("move_base/current_goal", PoseStamped, self._goal, queue_size=5),
            rospy.Subscriber("move_base/result", MoveBaseActionResult, self._arrived, queue_size=5),
            *(rospy.Subscriber(f"move_base/{name}", Path, self._path, queue_size=1) for name in PATHS),
        ]

    def look(self, topics: Dict[str, str]) -> None:
        """Notices people and points of interest."""
        for topic in self._people_topics:
            kind = topics.get(topic, "")
            message_class = roslib.message.get_message_class(kind) if kind in PEOPLE else None
            if self._people is None and message_class is not None:
                self._people = rospy.Subscriber(topic, message_class, self._receive_people, queue_size=1)
        points = rospy.get_param(POINTS, {})
        if points != self._points:
            self._points = points
            self._state.inbox.put(self._take_points, points)

    @property
    def located(self) -> bool:
        """Whether the robot's position is known and not old."""
        at = self._located_at
        return at is not None and (at == 0.0 or rospy.get_time() - at < OLD_POSITION)

    def sample(self) -> None:
        """Looks where the robot is now."""
        pose = self._pose()
        if pose is not None and self._shown is not None:
            difference = [abs(a - b) for a, b in zip(pose, self._shown)]
            if max(difference) < MOVED:
                return
        if pose != self._shown:
            self._shown = pose
            self._state.inbox.put(self._state.map.robot, pose)

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
        self._state.now.places = set(self._state.map.points(points))
        self._state.now.refresh()

    def _grid(self, message: OccupancyGrid) -> None:
        self._state.inbox.put(self._state.map.grid, message)

    def _path(self, message: Path) -> None:
        points: List[Tuple[float, float]] = [
            (stamped.pose.position.x, stamped.pose.position.y) for stamped in message.poses
        ]
        self._state.inbox.put(self._state.map.path, points)

    def _goal(self, message: PoseStamped) -> None:
        where = message.pose.position
        pose = where.x, where.y, _yaw(message.pose.orientation)
        self._state.inbox.put(self._state.map.goal, pose)

    def _arrived(self, message: MoveBaseActionResult) -> None:
        self._state.inbox.put(self._state.map.goal, None)
        self._state.inbox.put(self._state.map.path, [])

    def _receive_people(self, message: Any) -> None:
        self._state.inbox.put(self._state.map.people, message)


def _yaw(rotation: Any) -> float:
    sine = 2.0 * (rotation.w * rotation.z + rotation.x * rotation.y)
    cosine = 1.0 - 2.0 * (rotation.y * rotation.y + rotation.z * rotation.z)
    return math.atan2(sine, cosine)
