# SPDX-License-Identifier: Apache-2.0
"""Node: what rviz shows of MERLIN, and goals for points of interest that are clicked there."""

import math
import threading
from typing import Mapping, Optional, Sequence

import rospy
from geometry_msgs.msg import PoseStamped

from merlin_executor.core.outcome import Outcome
from merlin_executor.core.request_limits import RequestTooLarge
from merlin_executor.executor_client import ExecutorRequest, MerlinExecutorClient, outcome_name
from merlin_executor.goal_check import GoalError
from merlin_monitor.listeners.ros_system import RosSystem
from merlin_monitor.panel_board import PanelBoard
from merlin_monitor.panels.control import sentences_of_node
from merlin_monitor.panels.map import POINTS, MapPanel
from merlin_monitor.panels.now import NowPanel
from merlin_monitor.panels.plan import PlanPanel
from merlin_monitor.rviz.markers import MarkerPublisher
from merlin_monitor.state.inbox import Inbox
from merlin_monitor.state.map_section import read_points
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_planning.knowledge_text import PDDLSyntaxError, parse_goal
from merlin_ros.node import run_node
from merlin_ros.parameters import ParameterError, number, whole
from merlin_ros.service_proxy import ServiceError

#: In a goal, what stands for the point.
BLANK = "{point}"
GOOD = (Outcome.SUCCEEDED, Outcome.ALREADY_TRUE, Outcome.CANCELLED)


class NoPlace(ValueError):
    """No point of interest is at that place; the text names the nearest one."""


def nearest(points: Mapping[str, Sequence[float]], x: float, y: float, reach: float) -> str:
    """The name of the point of interest nearest to a place.

    :param points: name → x and y, m.
    :param reach: m; one that is further away is not meant.
    :raises NoPlace: when none is meant.
    """
    if not (math.isfinite(x) and math.isfinite(y)):
        raise NoPlace("the place is not a pair of finite numbers")
    if not points:
        raise NoPlace("there are no points of interest")
    distances = {name: math.hypot(point[0] - x, point[1] - y) for name, point in points.items()}
    name = min(distances, key=lambda each: distances[each])
    if distances[name] > reach:
        raise NoPlace(
            f"no point of interest within {reach:g} m of ({x:.2f}, {y:.2f}); "
            f"the nearest is {name}, {distances[name]:.2f} m away"
        )
    return name


class ClickedGoals:
    """Sends a goal to the Executor for each place that is clicked on the map, instead of the one before.

    :param frame: of the map.
    :param goal: in PDDL, with ``{point}`` for the point of interest nearest to the place.
    :param priority: of the goal.
    :param reach: m, beyond which a point is not meant.
    """

    def __init__(self, frame: str, goal: str, priority: int, reach: float) -> None:
        self._frame = frame
        self._goal = goal
        self._priority = priority
        self._reach = reach
        self._client = MerlinExecutorClient()
        self._lock = threading.Lock()  # each publisher has a thread; guards the field below
        self._request: Optional[ExecutorRequest] = None
        self._places = rospy.Subscriber(
            "merlin/clicked_goal", PoseStamped, self._clicked, queue_size=1, tcp_nodelay=True
        )

    def _clicked(self, place: PoseStamped) -> None:
        try:
            with self._lock:
                self._send(place)
        except (GoalError, NoPlace, PDDLSyntaxError, RequestTooLarge, ServiceError) as error:
            rospy.logwarn(f"rviz: no goal is sent: {' '.join(str(error).split())}")

    def _send(self, place: PoseStamped) -> None:
        frame = place.header.frame_id.lstrip("/")
        if frame != self._frame:
            raise NoPlace(f"the place is in frame {frame!r}; set rviz's fixed frame to {self._frame}")
        points = read_points(rospy.get_param(POINTS, {}))
        point = nearest(points, place.pose.position.x, place.pose.position.y, self._reach)
        if not self._client.executor_alive:
            raise NoPlace(f"there is no Executor at {self._client.name}")
        goal = self._goal.replace(BLANK, point)
        before = self._request
        self._request = self._client.send(goal, self._priority, on_done=lambda done: _log_end(goal, done))
        rospy.loginfo(f"rviz: {goal} is sent, priority {self._priority}")
        if before is not None and not before.done:
            before.cancel()


def _log_end(goal: str, request: ExecutorRequest) -> None:
    assert request.result is not None
    outcome = request.result.outcome
    because = f": {' '.join(request.result.reason.split())}" if request.result.reason else ""
    log = rospy.loginfo if outcome in GOOD else rospy.logwarn
    log(f"rviz: {goal}: {outcome_name(outcome)}{because}")


REACH = 2.0  # m
LEAST_REACH = 0.01  # m


def main() -> int:
    """Runs the node; returns the exit code."""
    return run_node("rviz_markers", _start)


def _start() -> None:
    frame = str(rospy.get_param("~global_frame", "map")).lstrip("/")
    goal, priority = _goal(), whole("~priority", 0)
    reach = number("~reach", REACH, LEAST_REACH)
    state = MonitorModel(Inbox(rospy.logwarn))
    state.wording.sentences = sentences_of_node(RosSystem(), needed=False)
    panels = PanelBoard(state, only=(MapPanel, NowPanel, PlanPanel))
    publisher = MarkerPublisher(state, frame)
    # Only the inbox of the model: nothing is drawn for a page, and no history is kept.
    state.inbox.start()
    panels.start(beats=False)
    rospy.on_shutdown(publisher.stop)
    rospy.on_shutdown(state.inbox.stop)
    ClickedGoals(frame, goal, priority, reach)


def _goal() -> str:
    goal = str(rospy.get_param("~goal", f"(robot_at {BLANK})"))
    try:
        if BLANK not in goal:
            raise PDDLSyntaxError(f"it does not have {BLANK}")
        parse_goal(goal.replace(BLANK, "point"))
    except PDDLSyntaxError as error:
        name = rospy.resolve_name("~goal")
        raise ParameterError(f"parameter {name} is {goal!r}: {error}; give (robot_at {BLANK})") from error
    return goal
