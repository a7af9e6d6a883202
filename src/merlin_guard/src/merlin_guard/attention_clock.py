# SPDX-License-Identifier: Apache-2.0
"""The guard's own time: it does not count what the guard itself missed."""

from typing import Optional

from merlin_ros.actions.sending_order import SendingOrder

LONGEST_STEP = 0.2  # s that one step may add
GAP = 0.5  # s between two steps from which the guard counts as having been away


class AttentionClock:
    """Two clocks that advance while the guard pays attention.

    A process that is starved of its processor, or stopped, sees all its peers silent for just as long. So a
    step between two events adds :data:`LONGEST_STEP` at the most: a starved guard must not take a peer for
    silent.

    :ivar wall: s of attention in wall time.
    :ivar world: s of attention in the time of the robot's world: it stands still while a simulator says that
        it is paused, and is slower while that says that it is slower than real time. But it is never slower
        than ROS time: a message alone does not stop it.
    :ivar back_at: `wall` when the guard last came back after a gap; 0.0 before the first one.
    :ivar order: of what is stamped with ROS time.
    """

    def __init__(self) -> None:
        self.wall = 0.0
        self.world = 0.0
        self.back_at = 0.0
        self.order = SendingOrder()
        self._looked = (0.0, 0.0)  # wall and world at the last look at ROS time
        self._rate = 1.0
        self._last: Optional[float] = None

    def set_rate(self, rate: float) -> None:
        """Sets how fast the world runs.

        :param rate: s of the world per s of wall time; 0: paused; at most 1 is used.
        """
        self._rate = min(1.0, max(0.0, rate))

    def advance(self, now: float) -> None:
        """Brings the clocks to an event.

        :param now: s of the monotonic clock; an earlier time than before counts as the same.
        """
        if self._last is None:
            self._last = now
        elapsed = max(0.0, now - self._last)
        self._last = max(now, self._last)
        step = min(elapsed, LONGEST_STEP)
        self.wall += step
        self.world += step * self._rate
        if elapsed > GAP:
            self.back_at = self.wall

    def look(self, ros_time: int) -> None:
        """Takes ROS time, ns, as it is at the last event."""
        wall, world = self._looked
        self.world = max(self.world, world + min(self.wall - wall, self.order.look(ros_time) / 1e9))
        self._looked = self.wall, self.world
