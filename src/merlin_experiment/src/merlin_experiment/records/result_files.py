# SPDX-License-Identifier: Apache-2.0
"""Writes the results of runs: runs.csv and tasks.csv, one row per run and per task."""

import csv
import os
from pathlib import Path
from typing import Any, Dict, Iterable, Sequence

from merlin_experiment.records.task_record import RUN_COLUMNS, TASK_COLUMNS, RunRecord

DECIMALS = 4


def write_run(folder: Path, run: RunRecord) -> Dict[str, Path]:
    """Writes the two tables of one run into a folder, which is made if it is missing.

    :return: The paths written, by file name.
    :raises OSError: the folder cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    paths = {name: folder / name for name in ("runs.csv", "tasks.csv")}
    write_table(paths["runs.csv"], RUN_COLUMNS, [run.run_row()])
    write_table(paths["tasks.csv"], TASK_COLUMNS, run.task_rows())
    return paths


def write_table(path: Path, columns: Sequence[str], rows: Iterable[Dict[str, Any]]) -> None:
    """Writes a table; a reader sees the old file or the whole new one, never half of it."""
    partial = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with partial.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, columns)
            writer.writeheader()
            writer.writerows({name: _text(row.get(name)) for name in columns} for row in rows)
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)  # it is there when the disk is full


def _text(value: Any) -> Any:
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:.{DECIMALS}f}".rstrip("0").rstrip(".")
    return value
