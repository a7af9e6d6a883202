# SPDX-License-Identifier: Apache-2.0
"""Reads the tables that runs left, and joins them."""

import csv
from pathlib import Path
from typing import Any, Dict, List, Optional, Sequence, Tuple

from experiment.run_plan import ExperimentRun
from merlin_experiment.records.result_files import write_table
from merlin_experiment.records.task_record import RUN_COLUMNS, TASK_COLUMNS

Row = Dict[str, Any]


def read_table(path: Path) -> List[Row]:
    """Rows of a table; numbers as float, empty cells as None.

    :raises OSError: when the file does not exist.
    """
    with path.open(newline="") as file:
        return [{name: _value(text) for name, text in row.items()} for row in csv.DictReader(file)]


def finished(folder: Path) -> Optional[Row]:
    """The row of a run that went through its whole list; None otherwise."""
    try:
        rows = read_table(folder / "runs.csv")
    except OSError:
        return None
    return rows[0] if len(rows) == 1 and rows[0]["ended"] == "complete" else None


def collect(results: Path, runs: Sequence[ExperimentRun]) -> Tuple[List[Row], List[Row]]:
    """Rows of all finished runs, and of their tasks, each with the columns `set` and `run`."""
    run_rows, task_rows = [], []
    for run in runs:
        row = finished(results / "runs" / run.name)
        if row is None:
            continue
        mark = {"set": run.set, "run": run.name}
        run_rows.append({**mark, **row})
        tasks = read_table(results / "runs" / run.name / "tasks.csv")
        task_rows += [{**mark, **task} for task in tasks]
    return run_rows, task_rows


def write_joined(results: Path, run_rows: List[Row], task_rows: List[Row]) -> List[Path]:
    """Writes runs.csv and tasks.csv of the whole experiment; returns their paths."""
    paths = [results / "runs.csv", results / "tasks.csv"]
    write_table(paths[0], ("set", "run", *RUN_COLUMNS), run_rows)
    write_table(paths[1], ("set", "run", *TASK_COLUMNS), task_rows)
    return paths


def _value(text: Optional[str]) -> Any:
    if text is None or text == "":
        return None
    try:
        return float(text)
    except ValueError:
        return text
