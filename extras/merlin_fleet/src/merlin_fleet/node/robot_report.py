# SPDX-License-Identifier: Apache-2.0
"""What this robot says of itself in its fleet, and how it obeys a stop that comes from there."""

import math
import threading
import time
from typing import Any, Callable, Dict, List, Optional, Tuple
from urllib.parse import urlsplit

import rospy
import tf2_ros
from actionlib_msgs.msg import GoalID
from merlin_msgs.msg import ExecutorStatus, GuardStatus

from merlin_fleet.core.records import STATUS, Halt, Status
from merlin_fleet.node.executor_body import NO_EXECUTOR
from merlin_monitor.access.web_access import is_loopback
from merlin_monitor.listeners.ros_system import RosSystem
from merlin_monitor.state.map_section import read_points
from merlin_monitor.web.robot_guards import RobotGuards
from merlin_ros.master.master_link import ERRORS, bounded_master

LOOK = 2.0  # s between two looks where it is
REPEAT = 10.0  # s after which the same is said again, with its time
NEAR = 1.0  # m to a point of interest: it is at it
OLD_POSITION = 5.0  # s of ROS time
POINTS = "world/points_of_interest"
MONITOR = "merlin_monitor/address"
MOST = 20  # actions and goals that are named
LONGEST = 500  # characters of a text


class RobotReport:
    """Follows Executor, guard and position.

    :param executor: name of the Executor's action.
    :param alive: whether the Executor answers.
    :param page: address of the robot's page; empty: that of the monitor, if others reach it.
    :param tell: takes the status after each change, and every `REPEAT`.
    """

    def __init__(
        self, executor: str, alive: Callable[[], bool], page: str, tell: Callable[[str, Status], None]
    ) -> None:
        ros = RosSystem()
        robot = ros.namespace.strip("/")
        self._alive = alive
        self._page = page
        self._tell = tell
        self._frames = (
            str(rospy.get_param("~global_frame", "map")),
            str(rospy.get_param("~base_frame", f"{robot}/base_footprint" if robot else "base_footprint")),
        )
        self._transform = ros.transforms()
        self._points: Dict[str, List[float]] = {}  # this and the next are written by the thread alone
        self._monitor = ""
        self._guards = RobotGuards()
        self._cancels = rospy.Publisher(f"{executor}/cancel", GoalID, queue_size=10)
        self._changed = threading.Condition()  # guards the fields below
        self._executor: Optional[ExecutorStatus] = None
        self._guard: Optional[GuardStatus] = None
        self._halt_asked: Optional[Halt] = None  # the last one; revisions begin low again at another hub
        self._stop = 0
        self._obeyed: Optional[Callable[[], None]] = None  # of a stop that the guard has not confirmed
        self._news = True
        self._closed = False
        rospy.Subscriber("merlin/status", ExecutorStatus, self._take_executor, tcp_nodelay=True)
        rospy.Subscriber("merlin/guard", GuardStatus, self._take_guard, tcp_nodelay=True)
        self._thread = threading.Thread(target=self._work, name="fleet report", daemon=True)

    def start(self) -> None:
        """Begins to say what the robot does."""
        self._thread.start()

    def close(self) -> None:
        """Ends the thread."""
        with self._changed:
            self._closed = True
            self._changed.notify()

    def halt(self, halt: Halt, obeyed: Callable[[], None]) -> None:
        """Has the guard hold the base until a release there, and cancels all requests; returns at once.

        :param obeyed: called when the guard has confirmed it, unless another stop has come since. The status
            says after 1 s whether it has.
        """
        with self._changed:
            self._halt_asked = halt
        threading.Thread(target=self._halt, args=(halt, obeyed), name="fleet halt", daemon=True).start()

    def unfit(self) -> str:
        """Why the robot would not begin a goal: its base or its Executor is held; empty: it would."""
        hold = self._hold()
        with self._changed:
            executor = self._executor
        if hold or executor is None or not self._alive():
            return hold
        if executor.paused:
            return "its Executor is paused"
        return _short(f"its Executor is held before {executor.held}") if executor.held else ""

    def _hold(self) -> str:
        return _short(self._guards.holders_now())

    def _halt(self, halt: Halt, obeyed: Callable[[], None]) -> None:
        self._guards.stop(halt.by)
        self._cancels.publish(GoalID())  # without name and time: all goals
        rospy.logwarn(f"{halt.by} stops this robot from the fleet's page; it is held until merlin/release")
        self._guards.wait_held()
        with self._changed:
            if halt is self._halt_asked:
                self._stop, self._obeyed = halt.revision, obeyed
        self._say(self._status())
        self._look_whether_held()

    def _look_whether_held(self) -> None:
        """A stop stays in the hub until the guard has confirmed it, also over a new start of either."""
        held = all(self._guards.wait_held(0.0).values())
        with self._changed:
            obeyed = self._obeyed if held else None
            self._obeyed = None if held else self._obeyed
        if obeyed is not None:
            obeyed()

    def _take_executor(self, message: ExecutorStatus) -> None:
        with self._changed:
            self._executor, self._news = message, True
            self._changed.notify()

    def _take_guard(self, message: GuardStatus) -> None:
        with self._changed:
            before, self._guard = self._guard, message
            if before is None or (before.state, before.reason) != (message.state, message.reason):
                self._news = True
                self._changed.notify()
        self._look_whether_held()

    def _work(self) -> None:
        said, said_at = Status(), -math.inf
        while not rospy.is_shutdown():
            with self._changed:
                self._changed.wait_for(lambda: self._news or self._closed, LOOK)
                self._news = False
                if self._closed:
                    return
            now = time.monotonic()
            if now >= said_at + REPEAT:
                self._points = read_points(_parameter(POINTS)) or self._points
                self._monitor = own_page(str(_parameter(MONITOR) or ""))
            status = self._status()
            if status != said or now >= said_at + REPEAT:
                said, said_at = status, now
                self._say(status)

    def _say(self, status: Status) -> None:
        self._tell(STATUS, status._replace(at=time.time()))

    def _status(self) -> Status:
        place, x, y = self._where()
        alive = self._alive()
        with self._changed:
            executor = self._executor or ExecutorStatus()
            return Status(
                doing=tuple(_short(_action(each)) for each in executor.running[:MOST]) if alive else (),
                goals=tuple(map(_short, executor.goals[:MOST])) if alive else (),
                stage=executor.stage if alive and executor.state != ExecutorStatus.IDLE else "",
                trouble="" if alive else NO_EXECUTOR,
                place=place,
                x=x,
                y=y,
                hold=self._hold(),
                stop=self._stop,
                page=self._page or self._monitor,
            )

    def _where(self) -> Tuple[str, Optional[float], Optional[float]]:
        """The point of interest at which it is, and x and y in m in the frame of the map."""
        try:
            found = self._transform(*self._frames)
        except (tf2_ros.TransformException, ValueError):
            return "", None, None
        stamp = found.header.stamp.to_sec()  # 0: all is static
        if stamp and rospy.get_time() - stamp > OLD_POSITION:
            return "", None, None
        x, y = found.transform.translation.x, found.transform.translation.y
        away = {name: math.hypot(at[0] - x, at[1] - y) for name, at in self._points.items()}
        near = min(away, key=lambda name: away[name], default="")
        return near if away.get(near, math.inf) <= NEAR else "", round(x, 1), round(y, 1)


def own_page(address: str) -> str:
    """The address of a page, if other computers reach it; else empty."""
    try:
        host = urlsplit(address).hostname or "localhost"
    except ValueError:  # half a pair of brackets: the parameter is not the monitor's
        return ""
    return "" if is_loopback(host) else address


def _parameter(name: str) -> Any:
    """A parameter; None: there is none, or the master does not answer for a moment."""
    try:
        return bounded_master().getParam(rospy.resolve_name(name))
    except ERRORS:
        return None


def _action(running: Any) -> str:
    return " ".join([running.name, *(f"{pair.key}={pair.value}" for pair in running.parameters)])


def _short(text: str) -> str:
    return text[:LONGEST]
