"""How fast a robot may move, and what that makes of a straight line and of a turn.

Both are the same problem: the shortest time from rest to rest over a way `s` under a limit of the speed
and one of the acceleration, whose answer is a trapezoid of speed (a triangle when the way is short).
"""

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Profile:
    """Fastest motion from rest to rest.

    Attributes:
        way: length, m or rad.
        speed: limit of the speed, m/s or rad/s.
        acceleration: limit of the acceleration and of the braking, m/s² or rad/s².
    """

    way: float
    speed: float
    acceleration: float

    def __post_init__(self) -> None:
        if not (self.way >= 0 and self.speed > 0 and self.acceleration > 0):
            raise ValueError(f"{self} is no motion: the way must be ≥ 0, the limits > 0")

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

    Attributes:
        speed: m/s.
        acceleration: m/s².
        turn_rate: rad/s.
        turn_acceleration: rad/s².
        radius: of the disc that holds the robot, m.
    """

    speed: float = 0.30
    acceleration: float = 1.0
    turn_rate: float = 1.0
    turn_acceleration: float = 2.0
    radius: float = 0.25

    def drive(self, distance: float) -> Profile:
        """The fastest straight drive of a distance (m)."""
        return Profile(distance, self.speed, self.acceleration)

    def turn(self, angle: float) -> Profile:
        """The fastest turn on the spot by an angle (rad, either direction)."""
        return Profile(abs(angle), self.turn_rate, self.turn_acceleration)

    def bend_delay(self, angle: float) -> float:
        """Time lost by rounding a corner (s), against driving the same length straight on.

        The shortest path of a disc runs round a corner on an arc of the disc's radius, on which the speed
        is at most turn_rate * radius.

        Parameters:
            angle: by how much the heading changes, rad.
        """
        return abs(angle) * max(0.0, 1.0 / self.turn_rate - self.radius / self.speed)
