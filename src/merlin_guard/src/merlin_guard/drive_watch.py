# SPDX-License-Identifier: Apache-2.0
"""What is wrong with a drive that the guard lets pass. Knows nothing of ROS and starts no thread."""

from typing import Dict, Optional, Sequence, Tuple

from merlin_guard.settings import GuardSettings
from merlin_guard.velocity_limits import Velocity

DEAD_ZONE = 0.03  # m/s and rad/s up to which many bases do not move
STILL = 0.01  # m, and parts of a quaternion, within which odometry counts as standing
ONE_OCCURRENCE = 10.0  # s without a fault of a velocity after which it is reported anew


class DriveWatch:
    """Notices drives without velocities, velocities without motion, and velocities above the limits.

    Times are s of the robot's world, as the guard's attention counts them. Not thread-safe, but for
    :meth:`odometry`.

    :param source: topic on which velocities come.
    :param settings: of the guard.
    """

    def __init__(self, source: str, settings: GuardSettings) -> None:
        self._source = source
        self._settings = settings
        self._drives_since: Optional[float] = None
        self._goals: Tuple[str, ...] = ()
        self._commanded_at = 0.0
        self._pushes_since: Optional[float] = None  # when velocities began that have to move the base
        self._place: Optional[Tuple[float, ...]] = None  # of odometry that was not looked at
        self._stands_at: Optional[Tuple[float, ...]] = None
        self._stands_since = 0.0
        self._stuck = False
        self._faults: Dict[str, Tuple[str, float]] = {}  # what → its first text, and when it was last so
        self.faults = 0
        """Velocities that did not go to the base as they came."""
        self.uncommanded: Tuple[str, ...] = ()
        """Goals for which no velocity has come for `no_command_limit`, as of the last :meth:`look`."""

    def command(self, sent: Velocity, fault: str, world: float) -> None:
        """A velocity has come.

        :param sent: what went to the base for it.
        :param fault: why that is something else; empty: it is not, or no drive is active.
        """
        self._commanded_at = world
        if sent.speed > DEAD_ZONE or abs(sent.yaw) > DEAD_ZONE:
            self._pushes_since = world if self._pushes_since is None else self._pushes_since
        else:
            self._pushes_since = None
        if fault:
            self.faults += 1
            what = fault.partition(":")[0]
            # A text that changes would be reported each time.
            self._faults[what] = self._faults.get(what, (fault, world))[0], world

    def odometry(self, place: Tuple[float, ...]) -> None:
        """Odometry says where the base is; any numbers that change with its pose. From any thread."""
        self._place = place

    def look(self, drivers: Sequence[str], goals: Tuple[str, ...], world: float) -> str:
        """What is wrong now, one sentence; empty: nothing.

        :param drivers: the motion servers whose goals may move the base now.
        :param goals: ids of the active goals.
        """
        who = ", ".join(drivers)
        if not drivers:
            self._drives_since = self._pushes_since = None
        elif self._drives_since is None or goals != self._goals:
            self._drives_since = world
        self._goals = goals
        silent = 0.0 if self._drives_since is None else world - max(self._drives_since, self._commanded_at)
        self.uncommanded = goals if silent >= self._settings.no_command_limit else ()
        self._faults = {
            what: (text, at) for what, (text, at) in self._faults.items() if world - at <= ONE_OCCURRENCE
        }
        self._look_at_odometry(world)
        if self._stuck:
            return (
                f"{who} drives, and the base does not move: odometry stands still since "
                f"{self._settings.no_motion_after:g} s"
            )
        if silent >= self._settings.no_command_after:
            return (
                f"{who} has an active goal and has sent no velocity on {self._source} for "
                f"{self._settings.no_command_after:g} s"
            )
        faults = "; ".join(text for text, _ in self._faults.values())
        return f"{who}: {faults}" if faults and who else faults

    def _look_at_odometry(self, world: float) -> None:
        place, self._place = self._place, None
        if self._pushes_since is None or world - self._commanded_at > self._settings.command_timeout:
            self._pushes_since = self._stands_at = None
            self._stuck = False
        elif place is not None:
            # Silent odometry says nothing: only a new word of it counts.
            if self._stands_at is None or not _same(place, self._stands_at):
                self._stands_at, self._stands_since = place, world
            self._stuck = world - self._stands_since >= self._settings.no_motion_after


def _same(one: Tuple[float, ...], other: Tuple[float, ...]) -> bool:
    return all(abs(a - b) <= STILL for a, b in zip(one, other))  # NaN is never the same
