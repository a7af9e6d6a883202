# SPDX-License-Identifier: Apache-2.0
"""Decides when it is quiet enough to call across the room."""

QUIET = 6.0  # s without speech
ANSWER_DUE = 20.0  # s in which a person that was asked begins to answer


class QuietRoom:
    """What was heard last; times are s of simulated time."""

    def __init__(self) -> None:
        self._last_sound = 0.0
        self._robot_speaks = False
        self._answer_due = 0.0

    @property
    def robot_speaks(self) -> bool:
        """Whether the robot has begun to speak and has not ended."""
        return self._robot_speaks

    def sound(self, now: float) -> None:
        """A person in the room speaks: an answer that was due has begun."""
        self._last_sound, self._answer_due = now, 0.0

    def robot(self, now: float, speaking: bool) -> None:
        """The robot begins or ends to speak; while it does it is not quiet, however long that takes."""
        self._robot_speaks, self._last_sound = speaking, now

    def asked(self, now: float) -> None:
        """The robot has asked a person that will answer; no other person speaks first."""
        self._answer_due = now + ANSWER_DUE

    def quiet(self, now: float) -> bool:
        """Whether a guest may call."""
        return not self._robot_speaks and now - self._last_sound > QUIET and now > self._answer_due
