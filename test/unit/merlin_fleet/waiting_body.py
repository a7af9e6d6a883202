# SPDX-License-Identifier: Apache-2.0
"""Robots' bodies for tests: a goal runs until the test ends it, or has succeeded at once."""

import threading
from typing import Any, Callable, Tuple

from merlin_fleet.core.records import Goal


class WaitingBody:
    """Begins goals, and ends them by :attr:`ended`; a stop ends the goal as cancelled."""

    def __init__(self) -> None:
        self.began = threading.Event()
        self.ended: Callable[[bool, str, str], None]

    def cost(self, goal: Goal, behind: Any) -> Any:
        return 1.0, ""

    def begin(self, goal: Goal, ended: Callable[[bool, str, str], None]) -> None:
        self.ended = ended
        self.began.set()

    def stop(self, goal: str, reason: str) -> None:
        self.ended(False, "CANCELLED", reason)


class DoesAtOnce:
    """A robot's body that has done each goal at once."""

    def cost(self, goal: Any, behind: Any) -> Tuple[float, str]:
        return 1.0, ""

    def begin(self, goal: Any, ended: Any) -> None:
        ended(True, "SUCCEEDED", "")

    def stop(self, goal: str, reason: str) -> None:
        raise AssertionError(reason)
