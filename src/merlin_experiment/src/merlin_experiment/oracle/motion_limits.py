# SPDX-License-Identifier: Apache-2.0
"""How fast a robot may move, and what that makes of a straight line and of a turn.

Both are the same problem: the shortest time from rest to rest over a way `s` under a limit of the speed
and one of the acceleration, whose answer is a trapezoid of speed (a triangle when the way is short).
"""

import math
from dataclasses import dataclass
from typing import Tuple


@dataclass(frozen=True)
class SpeedProfile:
    """Fastest motion from rest to rest.

    :ivar way: length, m or rad.
    :ivar speed: limit of the speed, m/s or rad/s.
    :ivar acceleration: limit of the acceleration and of the braking, m/s² or rad/s².
    """

    way: float
    speed: float
    acceleration: float

    def __post_init__(self) -> None:
        if not (self.way >= 0 and self.speed > 0 and self.acceleration > 0):
            raise ValueError(f"{self} is not a motion: the way must be ≥ 0, the limits > 0")

    @property
    def peak(self) -> float:
        """Highest speed reached."""
        return min(self.speed, math.sqrt(self.way * self.acceleration))

    @property
    def ramp(self) -> float:
        """Time of the acceleration, and of the braking, s."""
        return self.peak / self.acceleration

    @property
    def duration(self) -> float:
        """Time of the whole motion, s."""
        peak = self.peak
        return self.way / peak + peak / self.acceleration if peak > 0 else 0.0

    def way_at(self, time: float) -> float:
        """Way covered after some time (s)."""
        if time <= 0:
            return 0.0
        if time >= self.duration:
            return self.way
        if time < self.ramp:
            return 0.5 * self.acceleration * time**2
        if time <= self.duration - self.ramp:
            return self.peak * (time - 0.5 * self.ramp)
        return self.way - 0.5 * self.acceleration * (self.duration - time) ** 2


@dataclass(frozen=True)
class MotionLimits:
    """Limits of a differential-drive robot.

    :ivar speed: m/s.
    :ivar acceleration: m/s².
    :ivar turn_rate: rad/s.
    :ivar turn_acceleration: rad/s².
    :ivar radius: of the disc that holds the robot, m.
    """

    speed: float = 0.30
    acceleration: float = 1.0
    turn_rate: float = 1.0
    turn_acceleration: float = 2.0
    radius: float = 0.25

    def drive(self, distance: float) -> SpeedProfile:
        """The fastest straight drive of a distance (m)."""
        return SpeedProfile(distance, self.speed, self.acceleration)

    def turn(self, angle: float) -> SpeedProfile:
        """The fastest turn on the spot by an angle (rad, either direction)."""
        return SpeedProfile(abs(angle), self.turn_rate, self.turn_acceleration)

    def set_off(self, angle: float, distance: float, motion: Tuple[float, float] = (0.0, 0.0)) -> "SetOff":
        """The fastest drive of a distance (m) in a direction that is off the heading by an angle (rad).

        :param angle: rad, either direction.
        :param distance: m.
        :param motion: speed (m/s) and turning speed towards the direction (rad/s) at the start, ≥ 0.
        """
        return SetOff(self, abs(angle), distance, motion)


class SetOff:
    """Turning and driving together: what a robot gains on its way cannot be more than this.

    It covers its way at no more than its speed times the cosine of the angle between heading and path. So it
    begins to gain when it faces the path within a right angle, and speeds up while it turns the rest. What it
    moves sideways meanwhile is counted as free, as are corners of the path (rounding one at full speed, on an
    arc of speed / turn_rate, costs centimetres).

    :ivar duration: s, until it stands again.
    """

    STEP = 0.002  # s, of the numerical integration over the turn

    def __init__(
        self, limits: MotionLimits, angle: float, distance: float, motion: Tuple[float, float] = (0.0, 0.0)
    ) -> None:
        """:param limits: of the robot.
        :param angle: between heading and path at the start, rad, ≥ 0.
        :param distance: to cover, m.
        :param motion: speed (m/s) and turning speed (rad/s) at the start, ≥ 0; what is beyond the limits, or
            too fast to stop within the way, is taken as what just is not.
        """
        self._limits, self._distance = limits, distance
        self._gains = [0.0]
        self._speed = min(motion[0], limits.speed, math.sqrt(2.0 * limits.acceleration * distance))
        turning = min(motion[1], limits.turn_rate, math.sqrt(2.0 * limits.turn_acceleration * angle))
        # A turn that begins with some speed is the end of one from rest.
        before = turning**2 / (2.0 * limits.turn_acceleration)
        turn, skipped = limits.turn(angle + before), turning / limits.turn_acceleration
        while len(self._gains) * self.STEP < turn.duration - skipped:
            off = angle + before - turn.way_at(len(self._gains) * self.STEP + skipped)
            if off < math.pi / 2:
                self._speed = min(limits.speed, self._speed + limits.acceleration * self.STEP)
            gain = self._speed * max(0.0, math.cos(off)) * self.STEP
            if self._gains[-1] + gain + self._braking_way() >= distance:
                break
            self._gains.append(self._gains[-1] + gain)
        self._turned = (len(self._gains) - 1) * self.STEP
        # From here it faces the path (or has to brake already): a trapezoid that began with some speed is the
        # end of one from rest.
        self._rest = limits.drive(distance - self._gains[-1] + self._braking_way())
        self._skipped = self._speed / limits.acceleration
        self.duration = self._turned + self._rest.duration - self._skipped

    def way_at(self, time: float) -> float:
        """The most that it has covered after some time (s), m."""
        if time <= self._turned:
            return self._gains[max(0, int(time / self.STEP))]
        since = self._rest.way_at(time - self._turned + self._skipped) - self._braking_way()
        return min(self._distance, self._gains[-1] + max(0.0, since))

    def _braking_way(self) -> float:
        return self._speed**2 / (2.0 * self._limits.acceleration)
