# SPDX-License-Identifier: Apache-2.0
"""The node ``navigation``: the ``move_base`` action and what belongs to it."""

import math
import threading
from typing import List, Optional, Tuple

import rospy
import tf2_geometry_msgs  # noqa: F401 - teaches tf2 to transform PoseStamped
import tf2_ros
from geometry_msgs.msg import PoseStamped
from move_base_msgs.msg import MoveBaseAction, MoveBaseActionGoal, MoveBaseFeedback, MoveBaseGoal
from nav_msgs.msg import OccupancyGrid, Odometry
from nav_msgs.msg import Path as PathMessage
from nav_msgs.srv import GetPlan, GetPlanRequest, GetPlanResponse
from std_srvs.srv import Empty, EmptyRequest, EmptyResponse

from merlin_reactive.navigation.navigator import (
    NO_CONTROL_TEXT,
    NO_PLAN_TEXT,
    DriveOutcome,
    NavigationSettings,
    Navigator,
)
from merlin_reactive.navigation.path_follower import Cruise
from merlin_reactive.navigation.path_planner import NoPath, PathPlanner
from merlin_reactive.navigation.right_of_way import RightOfWay
from merlin_reactive.navigation.velocity_publisher import VelocityPublisher
from merlin_reactive.navigation.way_exchange import WayExchange
from merlin_reactive.pose import Point, Pose
from merlin_reactive.robot_state import RobotState, StateError, jumped, velocity_of
from merlin_reactive.ros_messages import bad_rotation, grid_of, path_message, pose_of, stamped
from merlin_ros.actions.action_server import ServerGoal
from merlin_ros.actions.serial_action_server import SerialActionServer
from merlin_ros.deadline import Deadline
from merlin_ros.health import ERROR, Health, HealthReporter
from merlin_ros.node import run_node
from merlin_ros.parameters import graph_name, number

INVALID_QUATERNION_TEXT = "Aborting on goal because it was sent with an invalid quaternion"


class NavigationGoalError(Exception):
    """A goal that can never be driven to; the text is the answer to the client."""


def goal_pose(target: PoseStamped, frame: str, buffer: tf2_ros.Buffer) -> Pose:
    """The goal in the global frame.

    :raises NavigationGoalError: bad orientation, not finite, or a frame that tf does not know.
    """
    reason = bad_rotation(target.pose.orientation)
    if reason:
        raise NavigationGoalError(f"{INVALID_QUATERNION_TEXT}: {reason}")
    position = target.pose.position
    if not (math.isfinite(position.x) and math.isfinite(position.y)):
        raise NavigationGoalError(f"The goal position ({position.x}, {position.y}) is not finite")
    own = target.header.frame_id.lstrip("/")
    if not own:
        raise NavigationGoalError(f"The goal has no frame; {frame} is what it should be in")
    if own == frame:
        return pose_of(target.pose)
    latest = PoseStamped(header=target.header, pose=target.pose)
    latest.header.frame_id, latest.header.stamp = own, rospy.Time(0)
    try:
        return pose_of(buffer.transform(latest, frame).pose)
    except tf2_ros.TransformException as error:
        raise NavigationGoalError(
            f"The goal is in the frame {own}, which cannot be transformed to {frame}: {error}"
        ) from error


START_TIMEOUT = 10.0  # s of running time for the map to appear
PATIENCE = 10.0  # s of running time that it stands without them before driving is given up
LOOK = 0.1  # s of running time without odometry after which the ages are looked at
SENSOR_AGE = 0.5  # s of ROS time after which odometry, scan and transforms are too old to drive by
PLAN_WAIT = 3.0  # s of running time that a plan waits for odometry
FEEDBACK_EVERY = 4  # control steps


def read_settings() -> NavigationSettings:
    """Reads the private parameters.

    :raises ParameterError: when one is out of range.
    """
    default, cruise = NavigationSettings(), Cruise()
    return NavigationSettings(
        radius=number("~robot_radius", default.radius, 0.05),
        clearance=number("~clearance", default.clearance, 0.0),
        guard=number("~guard", default.guard, 0.0),
        cruise=Cruise(
            speed=number("~speed", cruise.speed, 0.05),
            turn_speed=number("~turn_speed", cruise.turn_speed, 0.1),
            acceleration=number("~acceleration", cruise.acceleration, 0.1),
            turn_acceleration=number("~turn_acceleration", cruise.turn_acceleration, 0.1),
        ),
        xy_goal_tolerance=number("~xy_goal_tolerance", default.xy_goal_tolerance, 0.02),
        yaw_goal_tolerance=number("~yaw_goal_tolerance", default.yaw_goal_tolerance, 0.02),
        replan_after=number("~replan_after", default.replan_after, 0.0),
        patience=number("~patience", default.patience, 0.0),
        yield_patience=number("~yield_patience", default.yield_patience, 0.0),
        keep_obstacles=number("~keep_obstacles", default.keep_obstacles, 0.1),
    )


class NavigationNode:
    """Serves ``move_base`` for one robot.

    :raises ParameterError: a parameter cannot be used.
    """

    def __init__(self) -> None:
        self._settings = read_settings()
        self._frame = str(rospy.get_param("~global_frame", "map")).lstrip("/")
        self._age = number("~sensor_age", SENSOR_AGE, 0.05)
        self._navigator: Optional[Navigator] = None  # replaced with each map; `_state.changed` is its lock
        self._state = RobotState(self._frame)
        self._velocity = VelocityPublisher("cmd_vel")
        self._rules, self._exchange = self._meet_others()
        self._server = SerialActionServer("move_base", MoveBaseAction, self._execute, self._cancel)
        name = self._server.name
        self._current = rospy.Publisher(f"{name}/current_goal", PoseStamped, queue_size=1)
        self._path = rospy.Publisher(f"{name}/plan", PathMessage, queue_size=1)
        self._goals = rospy.Publisher(f"{name}/goal", MoveBaseActionGoal, queue_size=1)
        self._map_topic = graph_name("~map_topic", "/map")
        self._subscribers = [
            rospy.Subscriber(self._map_topic, OccupancyGrid, self._receive_map),
            rospy.Subscriber("move_base_simple/goal", PoseStamped, self._receive_goal, tcp_nodelay=True),
        ]
        self._services = [
            rospy.Service(f"{name}/make_plan", GetPlan, self._make_plan),
            rospy.Service(f"{name}/clear_costmaps", Empty, self._clear),
        ]
        rospy.on_shutdown(self._shutdown)
        self._server.start()

    def health(self) -> Health:
        """Whether everything that driving needs has arrived: map, odometry, scan."""
        if self._navigator is None:
            return Health(ERROR, f"there is no map on {rospy.resolve_name(self._map_topic)}")
        missing = self._state.missing(self._age)
        return Health(ERROR, missing) if missing else Health()

    def _meet_others(self) -> Tuple[Optional[RightOfWay], Optional[WayExchange]]:
        topic = graph_name("~robot_ways")
        if not topic:
            return None, None
        name = str(rospy.get_param("~robot", "")) or rospy.get_namespace().strip("/")
        rules = RightOfWay(name, self._settings.radius)
        return rules, WayExchange(topic, self._frame, rules, lambda: self._state.time)

    def _receive_map(self, message: OccupancyGrid) -> None:
        try:
            navigator = Navigator(grid_of(message), self._settings, self._rules)
        except ValueError as error:
            rospy.logerr(f"navigation: {error}")
            return
        with self._state.changed:
            self._navigator = navigator
            self._state.changed.notify_all()

    def _receive_goal(self, target: PoseStamped) -> None:
        goal = MoveBaseActionGoal(goal=MoveBaseGoal(target_pose=target))
        goal.header.stamp = rospy.Time.now()
        self._goals.publish(goal)

    def _cancel(self, goal: ServerGoal) -> None:
        self._velocity.close(goal)
        self._state.wake()

    def _execute(self, goal: ServerGoal) -> None:
        self._velocity.open(goal)
        try:
            navigator = self._ready(goal)
            if navigator is not None:
                self._drive(goal, navigator)
        except (NavigationGoalError, StateError) as error:
            goal.abort(text=str(error))
        except NoPath as error:
            goal.abort(text=f"{NO_PLAN_TEXT} {str(error)[0].upper()}{str(error)[1:]}.")
        finally:
            self._velocity.close(goal)
            if self._exchange is not None:
                self._exchange.end()

    def _ready(self, goal: ServerGoal) -> Optional[Navigator]:
        """The navigator, once map and pose have arrived; None when the goal was cancelled before."""
        deadline = Deadline(START_TIMEOUT)
        with self._state.changed:
            deadline.wait(self._state.changed, lambda: self._navigator is not None or goal.cancel_requested)
            navigator = self._navigator
        if goal.cancel_requested:
            goal.cancelled(text="cancelled")
            return None
        if navigator is None:
            raise StateError(f"There is no map after {START_TIMEOUT:.0f} s")
        return navigator

    def _drive(self, goal: ServerGoal, navigator: Navigator) -> None:
        target = goal_pose(goal.goal.target_pose, self._frame, self._state.buffer)
        reason = navigator.planner.why_unreachable(target.point)
        if reason:
            raise NoPath(reason)
        self._current.publish(stamped(target, self._frame, rospy.Time.now()))
        stamp: Optional[rospy.Time] = None
        started = False
        scanned = -math.inf
        patience = Deadline(PATIENCE)
        standing = False
        step = 0
        shown: Optional[List[Point]] = None  # the path that was published last
        last: Optional[Odometry] = None
        while True:
            odometry = self._state.wait_news(stamp, goal.cancel_event, LOOK)
            if goal.cancel_requested:
                goal.cancelled(text="cancelled")
                return
            if odometry is not None:
                if last is not None:
                    _refuse_jump(last, odometry)
                last = odometry
                stamp = odometry.header.stamp
            missing = self._state.missing(self._age)
            try:
                pose = self._state.pose(odometry) if odometry is not None and not missing else None
                scan = self._state.scan(scanned) if pose is not None else None
            except StateError as error:
                missing = str(error)
            if missing:
                if patience.expired:
                    raise StateError(f"{NO_CONTROL_TEXT} {missing[0].upper()}{missing[1:]}.")
                self._velocity.send(goal, 0.0, 0.0)
                if started and not standing:
                    rospy.logwarn(f"navigation: the robot stands: {missing}")
                    goal.tell(f"stands: {missing}")
                standing = True
                continue
            if odometry is None or pose is None:
                continue
            if standing and started:
                rospy.loginfo("navigation: the robot drives on: nothing is missing any more")
                goal.tell("")
            standing, patience = False, Deadline(PATIENCE)
            now = self._state.time
            if scan is not None:
                scanned = scan.stamp
                navigator.see(scan.pose, scan.angles, scan.ranges, now, scan.mount)
            if not started:
                navigator.start(target, pose, now)
                started = True
            result = navigator.step(pose, velocity_of(odometry), now)
            if result.outcome is DriveOutcome.REACHED:
                goal.succeed(text=result.text)
                return
            if result.ended:
                raise StateError(result.text)
            self._velocity.send(goal, result.speed, result.turn)
            if self._exchange is not None:
                self._exchange.publish(navigator.announcement(pose), stamp)
            if step % FEEDBACK_EVERY == 0:
                goal.feedback(MoveBaseFeedback(base_position=stamped(pose, self._frame, stamp)))
            step += 1
            if navigator.path is not shown:
                shown = navigator.path
                self._path.publish(path_message(navigator.path, self._frame, stamp, target.yaw))

    def _make_plan(self, request: GetPlanRequest) -> GetPlanResponse:
        navigator = self._navigator
        if navigator is None:
            raise rospy.ServiceException("there is no map yet")
        stamp = rospy.Time.now()
        try:
            if request.start.header.frame_id:
                start = goal_pose(request.start, self._frame, self._state.buffer)
            else:
                odometry = self._state.wait_news(None, threading.Event(), PLAN_WAIT)
                if odometry is None:
                    raise StateError(f"There is no odometry on {rospy.resolve_name('odom')}")
                start = self._state.pose(odometry)
            goal = goal_pose(request.goal, self._frame, self._state.buffer)
        except (NavigationGoalError, StateError) as error:
            raise rospy.ServiceException(str(error)) from error
        target = _reachable(navigator.planner, goal, request.tolerance)
        try:
            points = navigator.planner.plan(start.point, target, navigator.memory.points(self._state.time))
        except NoPath as error:
            rospy.loginfo(f"make_plan: {error}")
            return GetPlanResponse(plan=path_message([], self._frame, stamp, goal.yaw))
        return GetPlanResponse(plan=path_message(points, self._frame, stamp, goal.yaw))

    def _clear(self, _: EmptyRequest) -> EmptyResponse:
        if self._navigator is not None:
            self._navigator.clear()
        return EmptyResponse()

    def _shutdown(self) -> None:
        self._velocity.stop()
        self._server.shutdown()


def _refuse_jump(last: Odometry, odometry: Odometry) -> None:
    """Raises StateError when the wheels cannot have made the way between two odometries."""
    if jumped(last, odometry):
        before, after = pose_of(last.pose.pose), pose_of(odometry.pose.pose)
        raise StateError(
            f"{NO_CONTROL_TEXT} The odometry jumped from ({before.x:.2f}, {before.y:.2f}) to "
            f"({after.x:.2f}, {after.y:.2f}): the base was restarted, or the simulator reset."
        )


def _reachable(planner: PathPlanner, goal: Pose, tolerance: float) -> Point:
    """The point nearest to the goal, within the tolerance (m), where the robot can stand; else the goal."""
    if not planner.why_unreachable(goal.point):
        return goal.point
    return planner.nearest(goal.point, tolerance) or goal.point


def main() -> int:
    """The executable ``navigation``; returns its exit code."""
    return run_node("navigation", lambda: HealthReporter({"move_base": NavigationNode().health}).start())
