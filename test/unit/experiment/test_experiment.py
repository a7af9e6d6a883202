# SPDX-License-Identifier: Apache-2.0
"""The experiment: which runs, their statistics, and a report whose numbers come from the tables."""

import fcntl
from pathlib import Path
from typing import Dict, List

import numpy as np
import pytest
from experiment.__main__ import parse, planned, publish
from experiment.analysis import Ratio, Summary
from experiment.experiment_runner import ExperimentRunner, duration_text
from experiment.generated_world import write_world
from experiment.report import write_report
from experiment.run_plan import ExperimentRun, check_runs, main_runs, sweep_runs, world_runs
from experiment.run_table import collect, finished, read_table, write_joined

from merlin_experiment.records.result_files import write_run
from merlin_experiment.records.task_record import RunRecord, TaskRecord
from merlin_home.mission_list import make_mission
from merlin_pddl.domain_reader import read_domain
from merlin_pddl.problem_reader import read_problem
from merlin_sim.world.poi_distances import poi_distances
from merlin_sim.world.world_file import load_world

HOME_DOMAIN = Path(__file__).resolve().parents[3] / "pddl" / "home" / "domain.pddl"
POINTS = ["dorm_room", "bathroom", "kitchen", "main_door"]


def test_pairs_run_the_same_list() -> None:
    runs = main_runs([1, 2, 3], ["naive", "merlin"], {1: 5, 2: 5, 3: 1}, seed=7, factor=5.0)
    assert len(runs) == 22
    for naive, merlin in zip(runs[::2], runs[1::2]):
        assert (naive.approach, merlin.approach) == ("naive", "merlin")
        assert (naive.mission, naive.seed) == (merlin.mission, merlin.seed)


def test_every_run_has_a_folder_of_its_own() -> None:
    both = ["naive", "merlin"]
    runs = main_runs([1, 2, 3], both, {1: 5, 2: 5, 3: 1}, 1, 5.0)
    runs += check_runs(both, 1) + sweep_runs(both, 3, 1, 5.0)
    settings = {(r.mission, r.approach, r.seed, r.factor, r.cancel_after, r.share, r.killed_in) for r in runs}
    # The sweeps pass through the main settings; these runs are shared, not repeated.
    assert len({run.name for run in runs}) == len(settings) < len(runs)


def test_the_command_line_narrows() -> None:
    runs = planned(
        parse(["--mission", "1", "--approach", "merlin", "--runs", "5", "--seed", "7", "--rtf", "3"])
    )
    assert [run.seed for run in runs] == [7, 8, 9, 10, 11]
    assert {(run.mission, run.approach, run.factor) for run in runs} == {(1, "merlin", 3.0)}
    assert len(planned(parse(["--runs", "30", "10", "3"]))) == 2 * 43


def test_worlds_by_themselves_are_a_pair_in_each() -> None:
    runs = planned(parse(["--worlds", "3", "--seed", "4"]))
    assert [(run.world, run.seed, run.approach) for run in runs] == [
        (world, world, approach) for world in (4, 5, 6) for approach in ("naive", "merlin")
    ]
    assert {(run.set, run.mission) for run in runs} == {("worlds", 1)}
    assert len({run.name for run in [*runs, *main_runs([1], ["naive", "merlin"], {1: 3}, 4, 5.0)]}) == 12


def test_worlds_come_to_the_runs_that_are_named() -> None:
    runs = planned(parse(["--runs", "1", "--worlds", "2"]))
    assert [run.set for run in runs] == ["main"] * 6 + ["worlds"] * 4


def test_a_generated_world_has_durations_of_its_own(tmp_path: Path) -> None:
    files = write_world(tmp_path, 3)
    world = load_world(files.world)
    problem = read_problem(files.problem, read_domain(HOME_DOMAIN))
    times = {value.args: value.value for value in problem.values}
    assert len(world.points_of_interest) == 4
    for pair, length in poi_distances(world).items():
        assert times[pair] == pytest.approx(length / 0.3 + 3.0, abs=0.06)
    assert {end for start, end in times if start == "anywhere"} == set(world.points_of_interest)
    again = write_world(tmp_path, 3)
    assert again.world.read_text() == files.world.read_text()
    assert write_world(tmp_path, 4).problem.read_text() != files.problem.read_text()


def test_a_run_in_a_generated_world_is_given_its_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    commands: List[List[str]] = []

    class Launched:
        returncode = 1

        def __init__(self, command: List[str], **_: object) -> None:
            commands.append(command)

        def wait(self) -> int:
            return self.returncode

    monkeypatch.setattr("experiment.experiment_runner.subprocess.Popen", Launched)
    (run,) = world_runs(["merlin"], 1, 2, 5.0)
    assert ExperimentRunner(tmp_path).run_all([run]) == [run]  # it leaves no row
    (words,) = commands
    given = dict(word.split(":=", 1) for word in words if ":=" in word)
    for name, ending in (("world_file", "yaml"), ("problem", "pddl")):
        assert Path(given[name]) == tmp_path / "runs" / run.name / f"world_2.{ending}"
        assert Path(given[name]).is_file()


@pytest.mark.parametrize(
    "words",
    [
        ["--worlds", "-1"],
        ["--seed", "0", "--worlds", "2"],
        ["--mission", "4"],
        ["--runs", "0"],
        ["--runs", "1", "2"],
        ["--rtf", "-1"],
        ["--approach", "clever"],
    ],
)
def test_bad_command_lines_end(words: List[str], capsys: pytest.CaptureFixture) -> None:
    with pytest.raises(SystemExit) as ended:
        parse(words)
    assert ended.value.code == 2
    assert words[0] in capsys.readouterr().err


def test_summary_by_hand() -> None:
    summary = Summary.of([2.0, 4.0, 9.0])
    assert (summary.n, summary.mean, summary.median) == (3, 5.0, 4.0)
    assert summary.sd == pytest.approx(13.0**0.5)
    assert summary.variation == pytest.approx(13.0**0.5 / 5.0)
    assert Summary.of([3.0]).sd is None


def test_ratio_by_hand() -> None:
    # means 3 and 6; residuals 1 - 0.5 * 4 = -1, 0, 1: sd 1, error 1 / sqrt(3) / 6; t for 2 degrees is 4.303
    ratio = Ratio.of([1.0, 3.0, 5.0], [4.0, 6.0, 8.0])
    assert ratio.value == 0.5
    assert ratio.high - ratio.value == pytest.approx(4.3027 / 3**0.5 / 6, rel=1e-3)
    assert Ratio.of([1.0], [2.0]).low is None
    with pytest.raises(ValueError, match="not pairs"):
        Ratio.of([1.0], [1.0, 2.0])


def test_the_interval_covers_a_known_ratio_about_as_often_as_it_says() -> None:
    draw, covered = np.random.default_rng(1), 0
    for _ in range(400):
        naive = draw.normal(180.0, 10.0, 8)
        ratio = Ratio.of(list(0.6 * naive + draw.normal(0.0, 5.0, 8)), list(naive))
        covered += ratio.low <= 0.6 <= ratio.high
    assert 0.92 <= covered / 400 <= 0.98


def record(run: ExperimentRun) -> RunRecord:
    """A run as a mission would have recorded it: naive tasks of 30 s, MERLIN's cancelled after 10.2 s."""
    settings = {
        "mission": run.mission,
        "approach": run.approach,
        "seed": run.seed,
        "real_time_factor": run.factor,
        "rtf_policy": run.policy,
        "cancel_after": run.cancel_after,
        "marked_share": run.share,
    }
    records, now = [], 0.0
    for task in make_mission(POINTS, run.tasks, run.seed, run.share):
        time = 30.0 + run.seed
        if task.marked:
            time = 25.0 if run.approach == "naive" else 10.2
        outcome = "CANCELLED" if task.marked else "SUCCEEDED"
        entry = TaskRecord(task, [0.0, 0.0, 0.0], sent=now, first_dispatch=now + 0.05, idle=now + time)
        entry.outcome, entry.distance, entry.navigating = outcome, time * 0.25, time - 5.0
        entry.cancel_sent = now + 10.0 if task.marked else None
        entry.oracle_time, entry.oracle_distance = (10.0, 2.5) if task.marked else (28.0, 7.0)
        records.append(entry)
        now += time
    return RunRecord(settings, records, versions="merlin test")


def leave(results: Path, runs: List[ExperimentRun]) -> None:
    """Writes what the runs would have left."""
    for run in runs:
        folder = results / "runs" / run.name
        made = record(run)
        write_run(folder, made)
        way = np.array([[t, t * 0.01, 1.0, 0.0, 0.3, 0.0] for t in range(int(made.tasks[-1].idle))])
        np.savez_compressed(
            folder / "track.npz",
            way=way,
            occupied=np.eye(20, dtype=bool),
            resolution=0.5,
            origin=np.zeros(2),
            names=np.array(POINTS),
            points=np.ones((4, 2)),
        )


def cells(report: str, heading: str) -> List[Dict[str, str]]:
    """The rows of the table in a section."""
    lines = [
        line
        for line in report.split(f"## {heading}\n")[1].split("\n## ")[0].splitlines()
        if line.startswith("|")
    ]
    names, _, *rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return [dict(zip(names, row)) for row in rows]


def test_the_report_says_what_the_tables_say(tmp_path: Path) -> None:
    both = ["naive", "merlin"]
    runs = (
        main_runs([1, 2], both, {1: 3, 2: 2}, 1, 5.0) + check_runs(both, 1)[:2] + sweep_runs(both, 1, 1, 5.0)
    )
    leave(tmp_path, runs)
    rows, tasks = collect(tmp_path, runs)
    assert len(rows) == len(runs)
    paths = write_joined(tmp_path, rows, tasks)
    assert len(read_table(paths[1])) == sum(run.tasks for run in runs)
    (tmp_path / "note.md").write_text("Two runs at a time.\n")
    report = write_report(tmp_path, runs, rows, tasks, "the command").read_text()
    assert "\n\nTwo runs at a time.\n\n" in report
    table = {(row["mission"], row["approach"]): row for row in cells(report, "Table 1")}
    # Naive, Mission 1: 3 * (30 + seed) + 3 * 25 = 168, 171, 174
    assert table["1", "Naive"]["time s: mean"] == "171.00"
    assert (
        table["1", "Naive"]["sd"] == "0.75"
    )  # the last column of that name: the distance's, a quarter of 3 s
    ratio = cells(report, "MERLIN / Naive")[0]
    expected = (3 * (32.0 + 10.2)) / 171.0
    assert ratio["time"].startswith(f"{expected:.3f}")
    assert ratio["pairs"] == "3"
    # The paper's means: (178.20 - 104.46) / 3 and (46.65 - 21.72) / 3.
    assert "a cancel saves 14.8 s" in report and "a cancel saves 24.6 s" in report
    assert "a cancel saves 3.7 m" in report and "a cancel saves 8.3 m" in report
    assert ratio["at most 3%"] == ("met" if expected / ((3 * 38.0) / 171.0) <= 1.03 else "missed")
    assert "0 of" in report.split("## Tasks that did not end as listed")[1][:10]
    for figure in ("times", "distances", "paths", "timeline", "cancelled_task", "cancel_after", "share"):
        assert f"(figures/{figure}.png)" in report
        assert (tmp_path / "figures" / f"{figure}.png").stat().st_size > 1000
    assert "checked at factor 1" in report and "Early cancels" in report
    # Completed tasks took 2 s + seed longer than the oracle's 28 s: seeds 1 to 3, and 1 to 2.
    assert "Mission 1 takes MERLIN 4.00 s longer than the oracle: 0.05 s until" in report
    assert "Mission 2 takes MERLIN 3.50 s longer than the oracle: 0.05 s until" in report
    page = publish(tmp_path, tmp_path / "docs")[0].read_text()
    assert "(experiment/times.png)" in page
    assert {path.name for path in (tmp_path / "docs" / "experiment").iterdir()} >= {"runs.csv", "times.png"}
    assert cells(report, "Navigation killed in mid-mission")[0]["tasks as listed"] == "6 of 6"


def test_figures_over_worlds_are_least_median_and_largest(tmp_path: Path) -> None:
    runs = world_runs(["naive", "merlin"], 3, 1, 5.0)
    leave(tmp_path, runs)
    odd = record(runs[-1])
    odd.tasks[0].outcome = "ACTION_FAILED"
    write_run(tmp_path / "runs" / runs[-1].name, odd)
    rows, tasks = collect(tmp_path, runs)
    table = cells(write_report(tmp_path, runs, rows, tasks, "the command").read_text(), "Generated worlds")
    by_figure = {row["figure"]: (row["worlds"], row["min"], row["median"], row["max"]) for row in table}
    ratios = sorted(3 * (30.0 + seed + 10.2) / (3 * (30.0 + seed + 25.0)) for seed in (1, 2, 3))
    assert by_figure["MERLIN / Naive, time"] == ("3", *(f"{ratio:.3f}" for ratio in ratios))
    assert by_figure["tasks of Naive not as listed, of 6"] == ("3", "0", "0", "0")
    assert by_figure["tasks of MERLIN not as listed, of 6"] == ("3", "0", "0", "1")


def test_tasks_not_as_listed_are_in_the_report(tmp_path: Path) -> None:
    (run,) = main_runs([1], ["merlin"], {1: 1}, 1, 5.0)
    broken = record(run)
    broken.tasks[0].outcome, broken.tasks[0].reason = "ACTION_FAILED", "move_base: no way"
    write_run(tmp_path / "runs" / run.name, broken)
    rows, tasks = collect(tmp_path, [run])
    report = write_report(tmp_path, [run], rows, tasks, "the command").read_text()
    assert cells(report, "Tasks that did not end as listed")[0]["reason"] == "move_base: no way"


def test_what_is_done_is_not_done_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    runs = main_runs([1], ["naive", "merlin"], {1: 2}, 1, 5.0)
    leave(tmp_path, runs[:2])
    interrupted = record(runs[2])
    interrupted.ended = "interrupted"
    write_run(tmp_path / "runs" / runs[2].name, interrupted)
    done: List[str] = []

    def carry_out(self: ExperimentRunner, run: ExperimentRun) -> object:
        done.append(run.name)
        leave(tmp_path, [run])
        return finished(tmp_path / "runs" / run.name)

    monkeypatch.setattr(ExperimentRunner, "_carry_out", carry_out)
    assert ExperimentRunner(tmp_path).run_all(runs) == []
    assert done == [run.name for run in runs[2:]]
    assert ExperimentRunner(tmp_path).run_all(runs) == []
    assert len(done) == 2


def test_what_another_process_works_on_is_left_to_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    theirs, ours = main_runs([1], ["naive", "merlin"], {1: 1}, 1, 5.0)
    done: List[ExperimentRun] = []

    def carry_out(self: ExperimentRunner, run: ExperimentRun) -> object:
        done.append(run)
        leave(tmp_path, [run])
        return finished(tmp_path / "runs" / run.name)

    monkeypatch.setattr(ExperimentRunner, "_carry_out", carry_out)
    folder = tmp_path / "runs" / theirs.name
    folder.mkdir(parents=True)
    with (folder / ".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        ExperimentRunner(tmp_path).run_all([theirs, ours])
    assert done == [ours]
    assert "another process" in capsys.readouterr().out


@pytest.mark.parametrize(("seconds", "text"), [(40, "40 s"), (600, "10 min"), (3900, "1 h 05 min")])
def test_durations_are_readable(seconds: float, text: str) -> None:
    assert duration_text(seconds) == text
