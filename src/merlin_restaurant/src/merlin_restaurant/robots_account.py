# SPDX-License-Identifier: Apache-2.0
"""What each robot of an evening did: a row per robot, from the actions that have ended and the odometry."""

import csv
import math
import threading
from pathlib import Path
from typing import Dict, List, Sequence, Tuple

from nav_msgs.msg import Odometry

from merlin_executor.core.robot_lines import Deed

#: Columns that count actions which ended well → the operator.
COUNTED = {
    "orders": "take_order",
    "delivered": "deliver_order",
    "guided": "guide_client",
    "tables_checked": "check_table",
}
#: Of the table per robot.
COLUMNS = ("robot", *COUNTED, "actions", "failed", "busy_s", "driven_m")
STEP = 0.05  # m between two places that count, so that a standing robot drives nothing


class Mileage:
    """The metres that robots drive, by their odometry. Safe to use from several threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()  # guards the two below
        self._last: Dict[str, Tuple[float, float]] = {}
        self._metres: Dict[str, float] = {}

    def move(self, message: Odometry, robot: str) -> None:
        """Takes where a robot is."""
        position = message.pose.pose.position
        here = (position.x, position.y)
        if not all(map(math.isfinite, here)):
            return  # it would be the place from which no distance counts
        with self._lock:
            step = math.dist(self._last.setdefault(robot, here), here)
            if step >= STEP:
                self._last[robot] = here
                self._metres[robot] = self._metres.get(robot, 0.0) + step

    def of(self, robot: str) -> float:
        """What a robot has driven so far, m."""
        with self._lock:
            return self._metres.get(robot, 0.0)


def robot_of(deed: Deed, robots: Sequence[str]) -> str:
    """The robot that carried an action out: of several, its first parameter."""
    words = deed.text.strip("()").split()
    return words[1] if len(words) > 1 and words[1] in robots else robots[0]


def robot_rows(deeds: Sequence[Deed], robots: Sequence[str], mileage: Mileage) -> List[Dict[str, object]]:
    """One row of COLUMNS per robot; an empty name is that of the only one."""
    return [
        _row(name, [deed for deed in deeds if robot_of(deed, robots) == name], mileage) for name in robots
    ]


def _row(robot: str, deeds: Sequence[Deed], mileage: Mileage) -> Dict[str, object]:
    done = [deed.text.strip("()").split()[0] for deed in deeds if not deed.reason]
    row: Dict[str, object] = {"robot": robot or "robot"}
    row.update({column: done.count(operator) for column, operator in COUNTED.items()})
    row["actions"], row["failed"] = len(deeds), len(deeds) - len(done)
    row["busy_s"] = round(_covered([(deed.begun, deed.ended) for deed in deeds]), 1)
    row["driven_m"] = round(mileage.of(robot), 1)
    return row


def _covered(spans: Sequence[Tuple[float, float]]) -> float:
    """The time that spans take, what several share counted once; s."""
    total, until = 0.0, -math.inf
    for begun, ended in sorted(spans):
        total += max(0.0, ended - max(begun, until))
        until = max(until, ended)
    return total


def robot_table(rows: Sequence[Dict[str, object]]) -> List[str]:
    """The table for the screen."""
    return aligned(
        [
            [column.replace("_", " ") for column in COLUMNS],
            *([str(row[column]) for column in COLUMNS] for row in rows),
        ]
    )


def aligned(lines: Sequence[Sequence[str]]) -> List[str]:
    """The lines of a table whose columns stand below each other."""
    widths = [max(map(len, column)) for column in zip(*lines)]
    return ["  ".join(cell.ljust(width) for cell, width in zip(line, widths)).rstrip() for line in lines]


def write_rows(path: Path, columns: Sequence[str], rows: Sequence[Dict[str, object]]) -> None:
    """Writes a CSV file."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns)
        writer.writeheader()
        writer.writerows(rows)
