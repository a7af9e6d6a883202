# SPDX-License-Identifier: Apache-2.0
"""How long the tasks of a mission take, so that its end can be expected."""

import statistics
from typing import Any, Dict, List, Mapping

MOST = 20  # tasks that count, the last ones


class TaskPace:
    """Notes when the tasks of one mission begin. The median of those that ended is expected of the others:
    a pause or a stop makes one of them long.
    """

    def __init__(self) -> None:
        self._task = 0
        self._since = 0.0  # s of ROS time
        self._whole = False  # whether the beginning of the task was seen
        self._lasted: List[float] = []  # s

    def take_up(self, kept: Mapping[str, Any]) -> None:
        """Goes on where an earlier life of the monitor ended, by the mission as it was shown."""
        if kept.get("pace"):
            self._task, self._since, self._whole = kept["task"], kept["since"], True
            self._lasted = [kept["pace"]]

    def task(self, number: int, at: float) -> None:
        """Takes the number of the present task, from 1, and when that was heard, s of ROS time."""
        if number == self._task:
            return
        if number == self._task + 1 and self._whole:
            self._lasted = [*self._lasted, at - self._since][-MOST:]
        elif number < self._task:
            self._lasted = []  # the mission began anew
        self._whole = number == 1 or number == self._task + 1
        self._task, self._since = number, at

    def shown(self) -> Dict[str, float]:
        """When the present task began, and how long one takes, s; empty: not known."""
        return {"since": self._since, "pace": statistics.median(self._lasted)} if self._lasted else {}
