# SPDX-License-Identifier: Apache-2.0
"""What a mission shows while it runs: one line per task, rewritten in place on a terminal, and a table."""

import sys
import threading
import time
from pathlib import Path
from typing import Iterable, List, Optional, Sequence

from merlin_experiment.records.task_record import RunRecord, TaskRecord, efficiency, total

#: Shortest wall time between two rewritings of the live line, s.
REFRESH = 0.25


class ProgressView:
    """Writes to standard output; safe for several threads."""

    def __init__(self) -> None:
        self._terminal = sys.stdout.isatty()
        self._lock = threading.Lock()  # guards standard output and the fields below
        self._shown = ""
        self._refreshed = 0.0

    def live(self, text: str) -> None:
        """Shows what is going on, where there is a terminal."""
        with self._lock:
            moment = time.monotonic()
            if not self._terminal or text == self._shown or moment - self._refreshed < REFRESH:
                return
            self._shown, self._refreshed = text, moment
            print(f"\r\x1b[K{text}", end="", flush=True)

    def line(self, text: str) -> None:
        """Writes a line that stays."""
        with self._lock:
            start = "\r\x1b[K" if self._shown else ""
            self._shown = ""
            print(f"{start}{text}", flush=True)


def task_head(record: TaskRecord, count: int) -> str:
    """Number, point of interest and mark of a task."""
    width = len(str(count))
    mark = "cancel" if record.task.marked else ""
    return f"{record.task.number:{width}}/{count}  {record.task.poi:<10} {mark:<6}"


def live_line(record: TaskRecord, count: int, doing: str, elapsed: float, metres: float) -> str:
    """A task under way; s of ROS time and m."""
    return f"{task_head(record, count)}  {doing:<26} {elapsed:6.1f} s {metres:7.2f} m"


def ended_line(record: TaskRecord, count: int) -> str:
    """A task that has ended."""
    word = {"SUCCEEDED": "done", "CANCELLED": "cancelled"}.get(record.outcome, record.outcome.lower())
    line = f"{task_head(record, count)}  {word:<26} {record.time:6.1f} s {record.distance:7.2f} m"
    return line if record.right else f"{line}  NOT AS LISTED: {record.reason or word}"


def closing_lines(run: RunRecord, written: Iterable[Path], notes: Sequence[str] = ()) -> List[str]:
    """What is said when a mission is over: the table, and where the files are."""
    return ["", *result_table(run), "", *notes, *(f"written: {path}" for path in written)]


def result_table(run: RunRecord) -> List[str]:
    """The table at the end of a mission."""
    rows = [("task", "point", "marked", "outcome", "time s", "metres", "oracle s", "efficiency")]
    rows += [
        (
            str(record.task.number),
            record.task.poi,
            "yes" if record.task.marked else "",
            record.outcome.lower() + ("" if record.right else " (!)"),
            f"{record.time:.1f}",
            f"{record.distance:.2f}",
            _number(record.oracle_time, 1),
            _number(record.efficiency, 3),
        )
        for record in run.tasks
    ]
    rows.append(
        (
            "all",
            "",
            str(sum(record.task.marked for record in run.tasks)),
            f"{sum(record.right for record in run.tasks)} as listed",
            f"{sum(record.time for record in run.tasks):.1f}",
            f"{sum(record.distance for record in run.tasks):.2f}",
            _number(total([record.oracle_time for record in run.tasks]), 1),
            _number(efficiency(run.tasks), 3),
        )
    )
    return _aligned(rows, left=4)


def _number(value: Optional[float], decimals: int) -> str:
    return "-" if value is None else f"{value:.{decimals}f}"


def _aligned(rows: Sequence[Sequence[str]], left: int) -> List[str]:
    widths = [max(map(len, column)) for column in zip(*rows)]
    return [
        "  ".join(
            cell.ljust(width) if index < left else cell.rjust(width)
            for index, (cell, width) in enumerate(zip(row, widths))
        ).rstrip()
        for row in rows
    ]
