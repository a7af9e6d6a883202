# SPDX-License-Identifier: Apache-2.0
"""The times of a request as its client gives them."""

import math
import re
import time
from typing import Any, Dict, Optional, Tuple, Union

import rospy

from merlin_ros.work.passed_time import CALENDAR, LAST

When = Union[rospy.Time, float]
TIMES = ("not_before", "deadline")
LONGEST = 365 * 24 * 3600.0  # s from now, or between two errands
_SECONDS = {"s": 1.0, "min": 60.0, "h": 3600.0}
_DURATION = re.compile(r"(\d+(?:\.\d+)?)(s|min|h)\Z")
_CLOCK = re.compile(r"([01]?\d|2[0-3]):([0-5]\d)(?::([0-5]\d))?\Z")
CLOCK_WAIT = 3.0  # s of wall time
Written = Union[float, Tuple[int, int, int]]


def ros_time(when: Optional[When], name: str) -> rospy.Time:
    """A time of a request as a ROS time.

    :param when: a ROS time, or s from now; None: there is none, which is the ROS time zero.
    :param name: of the parameter, for the error.
    :raises ValueError: for what is not a time, or not in the future.
    """
    if isinstance(when, rospy.Time) and when.secs > LAST:
        raise ValueError(f"{name} is {when.secs} s of ROS time; ROS has no time so late")
    if when is None or isinstance(when, rospy.Time):
        return when or rospy.Time()
    if isinstance(when, bool) or not isinstance(when, (int, float)) or not math.isfinite(when):
        raise ValueError(f"{name} is {when!r}; it has to be a rospy.Time, or a number of seconds from now")
    if when <= 0.0:
        raise ValueError(f"{name} is {when:g} s from now; it has to be in the future")
    at = ros_now(name) + when
    if at > LAST:
        raise ValueError(f"{name} is {when:g} s from now; ROS has no time so late")
    return rospy.Time.from_sec(at)


def ros_now(name: str) -> float:
    """ROS time, s; in a simulation the first message of its clock is waited for.

    :raises ValueError: there is none.
    """
    clock = rospy.rostime.get_rostime_cond()
    with clock:
        if not clock.wait_for(rospy.get_time, CLOCK_WAIT):
            raise ValueError(f"{name}: the simulator's clock stands, so that no time from now can be counted")
    return rospy.get_time()


def check_timeout(timeout: Optional[float]) -> None:
    """Checks a time after which goals are cancelled.

    :raises ValueError: it is not a number of seconds above 0, nor None.
    """
    number = isinstance(timeout, (int, float)) and not isinstance(timeout, bool)
    if timeout is not None and not (number and timeout > 0.0):
        raise ValueError(f"timeout is {timeout!r}; it has to be a number of seconds above 0")


def with_ros_times(options: Dict[str, Any]) -> Dict[str, Any]:
    """Options of :meth:`MerlinExecutorClient.send` whose times stay the same when they are sent again.

    :raises ValueError: as :func:`ros_time`.
    """
    return {name: ros_time(value, name) if name in TIMES else value for name, value in options.items()}


def read_time(text: str) -> Written:
    """Reads a time that a person has written: ``90s``, ``10min``, ``2h`` from now, or ``14:30`` of today.

    :return: s from now; or hour, minute and second.
    :raises ValueError: for another text.
    """
    duration = _DURATION.match(text)
    if duration is not None:
        seconds = float(duration.group(1)) * _SECONDS[duration.group(2)]
        if seconds > LONGEST:
            raise ValueError(f"{text!r} is too long; the longest time is a year, 8760h")
        return seconds
    clock = _CLOCK.match(text)
    if clock is None:
        raise ValueError(f"{text!r} is not a time; write 90s, 10min or 2h from now, or 14:30 of today")
    return int(clock.group(1)), int(clock.group(2)), int(clock.group(3) or 0)


def at_time(written: Optional[Written], name: str) -> Optional[rospy.Time]:
    """The ROS time of what :func:`read_time` has read.

    :param name: of the option, for the error.
    :raises ValueError: for a time that has passed, and for a time of the day in a simulation.
    """
    if written is None:
        return None
    if isinstance(written, float):
        return ros_time(written, name)
    now = ros_now(name)
    if now < CALENDAR:
        raise ValueError(f"{name}: the robot's clock is a simulator's; write a time from now, such as 10min")
    clock = "{:02}:{:02}:{:02}".format(*written)
    day = time.localtime(now)[:3]
    at = time.mktime((*day, *written, 0, 0, -1))
    if at <= now:
        raise ValueError(f"{name}: {clock} has passed today; write a time from now, such as 10h")
    return rospy.Time.from_sec(at)
