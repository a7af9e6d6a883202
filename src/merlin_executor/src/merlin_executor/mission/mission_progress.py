# SPDX-License-Identifier: Apache-2.0
"""Where a mission is: its task, and whether it is paused. Pure; the numbers are those of MissionStatus."""

from enum import IntEnum
from typing import NamedTuple

PAUSED_TEXT = "paused: the next goal is sent when the mission is resumed"


class MissionState(IntEnum):
    """The states of merlin_msgs/MissionStatus."""

    STARTING = 0
    RUNNING = 1
    PAUSED = 2
    SUCCEEDED = 3
    FAILED = 4
    CANCELLED = 5


class MissionPoint(NamedTuple):
    """What is published of a mission."""

    state: MissionState
    task: int
    """Number of the present task, counted from 1; 0: none yet."""
    description: str


class MissionProgress:
    """The book of one mission. Not thread-safe."""

    def __init__(self) -> None:
        self._task = 0
        self._doing = "starting"
        self._paused = False
        self.now = MissionPoint(MissionState.STARTING, 0, self._doing)
        """The present progress."""

    def task(self, description: str) -> bool:
        """A next task begins.

        :return: whether that is to be published now: a paused mission says so when it continues.
        """
        self._task += 1
        self._doing = description
        if not self._paused:
            self.now = MissionPoint(MissionState.RUNNING, self._task, description)
        return not self._paused

    def pause(self, paused: bool) -> None:
        """The mission was paused, or continues."""
        self._paused = paused
        state = MissionState.PAUSED if paused else MissionState.RUNNING
        self.now = MissionPoint(state, self._task, PAUSED_TEXT if paused else self._doing)

    def report(self, state: MissionState, description: str) -> None:
        """The mission has reached a state."""
        self.now = MissionPoint(state, self._task, description)


class Switched(NamedTuple):
    """The answer to a request to pause or resume."""

    done: bool
    words: str


class PauseSwitch:
    """Whether a mission is paused, and what a request to pause or resume is answered. Not thread-safe."""

    def __init__(self) -> None:
        self.paused = False
        """Whether it is paused."""
        self._asked = False  # by an operator
        self._over = True

    def begin(self) -> None:
        """Called when the mission begins: an earlier pause no longer counts."""
        self.paused = self._asked = self._over = False

    def end(self) -> None:
        """The mission has ended."""
        self._over = True

    def set(self, paused: bool, asked: bool = True) -> Switched:
        """The mission is to pause, or to continue.

        :param asked: by an operator; otherwise it pauses itself, and ends no pause that an operator wants.
        """
        if self._over:
            return Switched(False, "The mission has ended.")
        if not asked and self._asked:
            return Switched(False, "An operator has paused the mission.")
        self._asked, wanted = asked and paused, self._asked
        if self.paused == paused and wanted == self._asked:
            refused = "The mission is paused already." if paused else "The mission is not paused."
            return Switched(False, refused)
        self.paused = paused
        return Switched(True, "Paused: no further goal is sent." if paused else "The mission continues.")
