# SPDX-License-Identifier: Apache-2.0
"""Trajectory, records, tables and the plot."""

import csv
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from merlin_experiment.records.result_files import write_run
from merlin_experiment.records.task_record import RUN_COLUMNS, TASK_COLUMNS, RunRecord, TaskRecord
from merlin_experiment.records.trajectory import Sample, Trajectory
from merlin_home.mission_list import MissionTask


def trajectory() -> Trajectory:
    """One second standing, then 1 m/s for two seconds, then standing."""
    track = Trajectory()
    for time, x, speed in [(0, 0, 0), (1, 0, 0), (2, 1, 1), (3, 2, 1), (4, 2, 0)]:
        track.add(Sample(float(time), float(x), 0.0, 0.0, float(speed), 0.0))
    return track


def test_hours_of_samples_are_megabytes() -> None:
    track, hour = Trajectory(), 3600 * 20  # samples
    tracemalloc.start()
    try:
        for index in range(hour):
            track.add(Sample(index / 20, index / 7, index / 3, index / 11, 0.3, index / 13))
        taken, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert taken / hour < 80.0  # bytes; seven numbers, and what arrays have in reserve
    assert track.last() == track.samples(0.0)[-1]


def test_distance_between_samples_is_interpolated() -> None:
    assert trajectory().distance(1.5, 2.25) == pytest.approx(0.75)
    assert trajectory().distance(-5, 50) == pytest.approx(2.0)


def test_standstill_is_the_first_sample_that_stands() -> None:
    assert trajectory().standstill_after(2.5) == 4.0
    assert trajectory().standstill_after(5.0) is None


def test_time_that_jumps_back_does_not_spoil_the_track() -> None:
    track = trajectory()
    track.add(Sample(2.0, 50.0, 0.0, 0.0, 0.0, 0.0))
    assert track.distance(0, 10) == pytest.approx(2.0)


def test_waiting_for_a_sample_ends() -> None:
    assert trajectory().wait_until(4.0, 0.0)
    assert not trajectory().wait_until(4.1, 0.01)


def record(marked: bool, outcome: str, **fields: object) -> TaskRecord:
    return TaskRecord(MissionTask(1, "kitchen", marked), outcome=outcome, **fields)


@pytest.mark.parametrize(
    ("task", "right"),
    [
        (record(False, "SUCCEEDED"), True),
        (record(False, "CANCELLED"), False),
        (record(False, "ACTION_FAILED"), False),
        (record(True, "CANCELLED", cancel_sent=10.0, idle=10.5), True),
        (record(True, "SUCCEEDED", idle=8.0), True),
        (record(True, "SUCCEEDED", cancel_sent=10.0, idle=10.05), True),
        (record(True, "SUCCEEDED", cancel_sent=10.0, idle=25.0), False),
        (record(True, "ACTION_FAILED", idle=8.0), False),
    ],
)
def test_right_is_what_the_list_says(task: TaskRecord, right: bool) -> None:
    assert task.right is right


def run() -> RunRecord:
    done = record(
        False,
        "SUCCEEDED",
        sent=0.0,
        first_dispatch=0.1,
        idle=20.0,
        distance=6.0,
        oracle_time=18.0,
        oracle_distance=5.5,
    )
    stopped = record(
        True,
        "CANCELLED",
        sent=20.0,
        first_dispatch=20.1,
        cancel_sent=30.0,
        idle=30.5,
        distance=2.5,
        oracle_time=10.0,
        oracle_distance=2.6,
        reason="cancelled by its sender",
    )
    settings = {
        "mission": 1,
        "approach": "merlin",
        "seed": 7,
        "real_time_factor": 3.0,
        "rtf_policy": "constant",
    }
    return RunRecord(settings, [done, stopped], wall=12.0, versions="merlin 0.1.0")


def test_a_run_adds_its_tasks_up() -> None:
    row = run().run_row()
    assert row["tasks"] == 2 and row["marked"] == 1 and row["cancelled"] == 1 and row["succeeded"] == 1
    assert row["time_s"] == pytest.approx(30.5)
    assert row["distance_m"] == pytest.approx(8.5)
    assert row["efficiency"] == pytest.approx(28.0 / 30.5)
    assert row["efficiency_completed"] == pytest.approx(0.9)
    assert row["efficiency_cancelled"] == pytest.approx(10.0 / 10.5)


def test_without_an_oracle_the_efficiency_is_unknown() -> None:
    broken = run()
    broken.tasks[0].oracle_time = None
    assert broken.run_row()["efficiency"] is None
    assert not RunRecord({}, [], ended="executor died").right


@pytest.mark.everywhere
def test_the_tables_have_their_columns(tmp_path: Path) -> None:
    paths = write_run(tmp_path / "new", run())
    with paths["runs.csv"].open() as file:
        (row,) = csv.DictReader(file)
    assert tuple(row) == RUN_COLUMNS
    assert row["time_s"] == "30.5" and row["ended"] == "complete"
    with paths["tasks.csv"].open() as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == TASK_COLUMNS
    assert rows[1]["stopping_s"] == "0.5" and rows[0]["cancel_sent"] == ""


@pytest.mark.everywhere
def test_a_table_that_cannot_be_written_leaves_nothing_behind(tmp_path: Path) -> None:
    record = TaskRecord(MissionTask(1, "kitchen", False), reason="half a character: \udce4")
    with pytest.raises(ValueError, match="utf-8"):
        write_run(tmp_path, RunRecord({}, [record]))
    assert [file.name for file in tmp_path.iterdir()] == ["runs.csv"]


@pytest.mark.everywhere
def test_the_plot_is_written(tmp_path: Path) -> None:
    from merlin_experiment.records.path_plot import MapPicture, plot_path  # other workers do without

    picture = MapPicture(np.eye(20, dtype=bool), 0.05, (0.0, 0.0))
    plot_path(
        tmp_path / "a" / "path.png", picture, {"kitchen": (0.5, 0.2)}, [(0.1, 0.1), (0.5, 0.2)], [(0.3, 0.1)]
    )
    assert (tmp_path / "a" / "path.png").read_bytes().startswith(b"\x89PNG")
