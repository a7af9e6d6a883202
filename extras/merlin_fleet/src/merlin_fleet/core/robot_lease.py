# SPDX-License-Identifier: Apache-2.0
"""The lease of a robot, by the robot's own clock: until when what it owns may run."""

from typing import NamedTuple


class LeaseTimes(NamedTuple):
    """Times of a lease, s.

    The robot counts from the moment at which it sent the last renewal that was answered, by its own clock,
    leaves `drift` for the difference of the speeds, and begins to stop `stop_time` before `ttl` has passed.
    The store received that renewal after it was sent, and had the lease then. So a robot that sees a claim
    vanish, for whatever reason, and waits for `ttl` from then on, knows that its owner stands.
    """

    ttl: float = 15.0
    """After the last renewal, within which all that moves for a goal stands."""
    renew_every: float = 2.0
    stop_time: float = 6.0
    """From a cancel to the end of all that a goal moves: the Executor's cancel deadline and 1 s."""
    drift: float = 0.01
    """Most by which the speeds of the two clocks differ: 0.01 is 10 ms in a second."""

    def checked(self) -> "LeaseTimes":
        """These times.

        :raises ValueError: when they leave no time to run.
        """
        if not (self.ttl > 0 and self.renew_every > 0 and self.stop_time >= 0 and 0 <= self.drift < 1):
            raise ValueError(f"a lease of {self} cannot be kept")
        if self.runs < 2 * self.renew_every:
            least = (2 * self.renew_every + self.stop_time) / (1 - self.drift)
            raise ValueError(
                f"a lease of {self.ttl:g} s is too short for a stop of {self.stop_time:g} s and renewals "
                f"each {self.renew_every:g} s; {least:.1f} s is the least"
            )
        return self

    @property
    def runs(self) -> float:
        """s after the sending of a renewal after which everything is stopped."""
        return self.ttl * (1 - self.drift) - self.stop_time

    @property
    def kept(self) -> float:
        """s for which the store keeps the lease after a renewal: as long as its goals may run."""
        return self.ttl - self.stop_time

    def wait(self, ttl: float) -> float:
        """s, by the clock of one robot, in which the `ttl` of another one has passed for certain."""
        return ttl / (1 - self.drift)


class RobotLease:
    """What a robot knows of its lease.

    :param times: of the lease.
    """

    def __init__(self, times: LeaseTimes) -> None:
        self._times = times.checked()
        self.lease = 0
        """0: no lease."""
        self.renewed_at = 0.0
        """When the last renewal that the store answered was sent."""
        self.stop_at = 0.0
        """From then on nothing of the lease may run."""

    def renew(self, lease: int, asked_at: float, ttl: float) -> None:
        """The store has granted or renewed the lease.

        :param asked_at: when the request was sent.
        :param ttl: for which the store keeps it; one that is shorter than agreed counts.
        """
        if lease != self.lease:
            self.lease, self.stop_at, self.renewed_at = lease, 0.0, asked_at
        if asked_at >= self.renewed_at:
            self.renewed_at = asked_at
            self.stop_at = asked_at + min(self._times.runs, ttl * (1 - self._times.drift))

    def lose(self) -> None:
        """The store no longer knows the lease."""
        self.lease, self.stop_at = 0, 0.0

    def holds(self, now: float) -> bool:
        """Whether what belongs to the lease may run."""
        return bool(self.lease) and now < self.stop_at
