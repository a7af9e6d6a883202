# SPDX-License-Identifier: Apache-2.0
"""How fast a velocity may be, and how fast it may grow. Knows nothing of ROS."""

import math
from typing import NamedTuple, Tuple

CREDIT = 0.1  # s of growth that are saved up at most: a late command must not allow a jump
ROUNDING = 1.0 + 1e-9  # a controller that drives at the limit is not above it


class VelocityLimits(NamedTuple):
    """Limits of one base; the defaults are those of the simulated robot."""

    max_speed: float = 1.0
    """m/s, of the vector x, y."""
    max_turn_speed: float = 2.0
    """rad/s."""
    max_acceleration: float = 1.0
    """m/s²; infinite: not limited."""
    max_turn_acceleration: float = 2.0
    """rad/s²; infinite: not limited."""
    max_jerk: float = math.inf
    """m/s³, with which the acceleration grows; infinite: not limited."""
    max_turn_jerk: float = math.inf
    """rad/s³, likewise."""


class Velocity(NamedTuple):
    """What a geometry_msgs/Twist says of a base: m/s and rad/s, in the frame of the robot."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    roll: float = 0.0
    pitch: float = 0.0
    yaw: float = 0.0

    @property
    def speed(self) -> float:
        """Along the floor, m/s."""
        return math.hypot(self.x, self.y)


STANDING = Velocity()


class VelocityLimiter:
    """Judges velocities one after the other. Not thread-safe.

    What is too fast is scaled as a whole, so that the base stays on the curve that was meant. Growth is
    measured from what was sent last; that the base gets slower, or grows no faster, is never limited. Over
    any time t a speed grows by `max_acceleration` · (t + :data:`CREDIT`) at the most; when it did not grow
    before, by `max_jerk` · (t + :data:`CREDIT`)².

    :param limits: of the base.
    :param refuse: sends zero in place of what is above a limit.
    """

    def __init__(self, limits: VelocityLimits, refuse: bool = False) -> None:
        self._limits = limits
        self._refuse = refuse
        self._sent = STANDING
        self._growth = _Growth(limits.max_acceleration, limits.max_jerk)
        self._turn_growth = _Growth(limits.max_turn_acceleration, limits.max_turn_jerk)

    def judge(self, velocity: Velocity, now: float) -> Tuple[Velocity, str]:
        """What may go to the base now, and what is wrong with the velocity that came; changes nothing.

        :param now: s of a clock that is never set back.
        :return: the second is a sentence; empty: nothing is wrong, and the velocity goes as it is.
        """
        if not all(map(math.isfinite, velocity)):
            return STANDING, f"a velocity is not finite: {velocity}; zero is sent instead"
        if velocity.z or velocity.roll or velocity.pitch:
            return STANDING, f"a velocity leaves the floor: {velocity}; zero is sent instead"
        limits = self._limits
        most, most_turn = limits.max_speed, limits.max_turn_speed
        part = min(_part(most, velocity.speed), _part(most_turn, abs(velocity.yaw)))
        less = _scaled(velocity, part)
        most = self._kept(less) + self._growth.most(now)
        most_turn = self._kept_turn(less) + self._turn_growth.most(now)
        growth = min(_part(most, less.speed), _part(most_turn, abs(less.yaw)))
        if part == growth == 1.0:
            return velocity, ""
        said = "is above the limits" if part < 1.0 else "grows faster than the limits allow"
        known = " ".join(f"{name}:={value:g}" for name, value in limits._asdict().items())
        why = (
            f"a velocity {said}, and {'zero' if self._refuse else 'less'} is sent instead: "
            f"{velocity.speed:g} m/s and {velocity.yaw:g} rad/s, after {self._sent.speed:g} and "
            f"{self._sent.yaw:g}; {known}"
        )
        return STANDING if self._refuse else _scaled(less, growth), why

    def sent(self, velocity: Velocity, now: float) -> None:
        """A velocity went to the base, as it was judged at this moment."""
        self._growth.grew(max(0.0, velocity.speed - self._kept(velocity)), now)
        self._turn_growth.grew(max(0.0, abs(velocity.yaw) - self._kept_turn(velocity)), now)
        self._sent = velocity

    def stood(self) -> None:
        """Zero went to the base."""
        self._sent = STANDING
        for growth in (self._growth, self._turn_growth):
            growth.rate = 0.0

    def _kept(self, velocity: Velocity) -> float:
        """What the base drives already in the direction of a velocity, m/s."""
        speed = velocity.speed
        if not speed:
            return 0.0
        return max(0.0, (self._sent.x * velocity.x + self._sent.y * velocity.y) / speed)

    def _kept_turn(self, velocity: Velocity) -> float:
        return max(0.0, math.copysign(self._sent.yaw, self._sent.yaw * velocity.yaw))


class _Growth:
    """How much a speed may grow. Time that was not used for it is saved up.

    :ivar rate: at which it grew last, per s.
    """

    def __init__(self, acceleration: float, jerk: float) -> None:
        self._acceleration, self._jerk = acceleration, jerk
        self._used = -math.inf  # time up to which growth is used up, s
        self.rate = 0.0

    def most(self, now: float) -> float:
        """By how much it may grow now."""
        saved, rate = self._allowed(now)
        return saved * rate

    def grew(self, by: float, now: float) -> None:
        """It has grown by as much, or not at all."""
        saved, rate = self._allowed(now)
        self._used = max(self._used, now - CREDIT) + by / rate
        self.rate = min(rate, by / saved)

    def _allowed(self, now: float) -> Tuple[float, float]:
        """Time that is left to grow in, s, and the rate with which it may."""
        # Not zero, so that an infinite limit has its meaning.
        saved = max(1e-9, min(CREDIT, now - self._used))
        return saved, min(self._acceleration, self.rate + self._jerk * saved)


def _part(limit: float, value: float) -> float:
    """The part of a value, 0..1, that is within a limit."""
    return 1.0 if value <= limit * ROUNDING else limit / value


def _scaled(velocity: Velocity, part: float) -> Velocity:
    return Velocity(x=velocity.x * part, y=velocity.y * part, yaw=velocity.yaw * part)
