# SPDX-License-Identifier: Apache-2.0
"""Waiting for events until a point in ROS time: what lasts in the robot's world stops with its clock."""

import contextlib
import threading
import time
from typing import Any, Callable, Iterable, Optional, Union

import rospy

Duration = Union[rospy.Duration, float, int]


class RosDeadline:
    """A point in ROS time; it survives a clock that is set back.

    :param duration: from now; None: never.
    """

    def __init__(self, duration: Optional[Duration]) -> None:
        self._left = float("inf") if duration is None else seconds(duration)
        self._last = rospy.get_time() if duration is not None else 0.0

    def remaining(self) -> float:
        """ROS time that is left, s; never negative."""
        if self._left != float("inf"):
            now = rospy.get_time()
            self._left -= max(0.0, now - self._last)
            self._last = now
        return max(0.0, self._left)

    def slice(self) -> float:
        """Wall time to wait until the next look at the clock, s."""
        left = self.remaining()
        # Simulated time may run faster than the wall's and announces nothing.
        return min(1.0, left) if rospy.rostime.is_wallclock() else min(1.0, max(0.01, left / 20.0))


class WallDeadline(RosDeadline):
    """A point in wall time, for what has nothing to do with the robot's world."""

    def __init__(self, duration: Optional[Duration]) -> None:
        self._end = float("inf") if duration is None else time.monotonic() + seconds(duration)

    def remaining(self) -> float:
        """Wall time that is left, s; never negative."""
        return max(0.0, self._end - time.monotonic())

    def slice(self) -> float:
        """Wall time to wait until the next look at the clock, s."""
        return min(1.0, self.remaining())


class OnSubscriber(rospy.SubscribeListener):
    """The event of a new subscriber of a publisher.

    :param call: called with what publishes to that subscriber alone.
    """

    def __init__(self, call: Callable[[Callable[[Any], None]], None]) -> None:
        super().__init__()
        self._call = call

    def peer_subscribe(self, topic_name: str, topic_publish: Any, peer_publish: Any) -> None:
        """A subscriber has come; rospy calls it."""
        self._call(peer_publish)


def seconds(duration: Duration) -> float:
    """A duration as a number."""
    return duration.to_sec() if hasattr(duration, "to_sec") else float(duration)


def wait(
    condition: threading.Condition,
    predicate: Callable[[], bool],
    deadline: RosDeadline,
    slice_limit: float = 1.0,
) -> bool:
    """Waits, with the condition held, until the predicate is true, the deadline passes or ROS shuts down.

    :param slice_limit: wall time after which the predicate is asked again though nothing was notified, s.
    :return: the last value of the predicate.
    """
    while not predicate():
        if rospy.is_shutdown() or deadline.remaining() <= 0.0:
            return False
        condition.wait(min(deadline.slice(), slice_limit))
    return True


class _Mark(bytes):
    """Nothing, behind what waits for a subscriber: rospy asks for the length of what it has sent, and has no
    other event for it.
    """

    def __init__(self) -> None:
        self.sent = threading.Event()

    def __len__(self) -> int:
        self.sent.set()
        return 0


def wait_until_sent(publishers: Iterable[rospy.Publisher], limit: float) -> None:
    """Waits until rospy has sent what was published: when a topic is left, it drops what waits.

    :param limit: of wall time, s; messages to a subscriber that does not read wait for ever.
    """
    marks = []
    for link in [link for publisher in publishers for link in list(publisher.impl.connections)]:
        mark: Any = _Mark()
        with contextlib.suppress(Exception):  # rospy raises what the message before it has met: it is lost
            link.write_data(mark)
            marks.append(mark)
    deadline = WallDeadline(limit)
    for mark in marks:
        mark.sent.wait(deadline.remaining())
