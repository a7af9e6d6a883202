# SPDX-License-Identifier: Apache-2.0
"""Writes report.md: every number in it comes from the tables beside it."""

import os
import platform
from pathlib import Path
from typing import List, Sequence

from experiment.analysis import Analysis, Key, Ratio
from experiment.markdown import (
    APPROACH_NAMES,
    four_figures,
    mean_and_variation,
    number,
    paper_cell,
    ratio_cell,
    section,
    table,
)
from experiment.paper_results import DISTANCE, TIME, paper_ratio
from experiment.run_plan import APPROACHES, ExperimentRun
from experiment.run_table import Row
from experiment.sensitivity import (
    check_section,
    early_cancel_section,
    killed_section,
    sweep_section,
    worlds_section,
)
from merlin_experiment.mission.real_time_factor import SPEECH_AHEAD
from merlin_home.mission_list import MISSION_TASKS

EFFICIENCY_GOAL = 0.95
COMPLETED_GOAL = 0.90
EXCESS_GOAL = 0.03
_REASONS = """What a cancel saves is what was left of the way when it was sent, and the way back from where it
would have led. It grows with the length of the ways and falls with the cancel time; neither Naive nor MERLIN
speaks in a task that was cancelled on the way."""


def write_report(
    results: Path, planned: Sequence[ExperimentRun], run_rows: List[Row], task_rows: List[Row], command: str
) -> Path:
    """Writes the report and its figures.

    :param results: folder; what its file ``note.md`` says of the conditions, if there is one, is part of the
        report.
    :param planned: the runs that were asked for.
    :param run_rows: of the finished ones; at least one.
    :param task_rows: of their tasks.
    :param command: that made it.
    :return: The path of report.md.
    """
    everything = Analysis(run_rows, task_rows)
    main = everything.only(set="main")
    note = results / "note.md"
    parts = [_head(planned, everything, command, note.read_text().strip() if note.is_file() else "")]
    if main.runs:
        parts += [_table_1(main), _ratios(main), _efficiency(main), _where_time_goes(main)]
        from experiment.figures import figures_section  # with matplotlib, which all else does without

        parts += [figures_section(results, main)]
    parts += [
        _failures(everything),
        check_section(everything),
        sweep_section(results, everything, "cancel_after", "cancel_after", "cancel time (s)"),
        sweep_section(results, everything, "share", "marked_share", "share of cancelled tasks"),
        early_cancel_section(everything),
        killed_section(everything),
        worlds_section(everything),
    ]
    path = results / "report.md"
    path.write_text("\n\n".join(filter(None, parts)) + "\n")
    return path


def _head(planned: Sequence[ExperimentRun], analysis: Analysis, command: str, note: str) -> str:
    first = analysis.runs[0]
    conditions = f"\n\n{note}" if note else ""
    return f"""# The paper's experiment

Made by `{command}`: {len(analysis.runs)} of {len(planned)} runs finished; {os.cpu_count()} processor cores,
{platform.machine()}; {first["versions"]}.{conditions}

Settings, fixed before any run: four points of interest; lists of 6, 20 and 120 of them with different
neighbours; exactly half of the tasks marked; a marked task is cancelled {first["cancel_after"]:g} s after it
was sent if it still runs (the paper does not state its time; this is the value of its successor's public
code). Naive and MERLIN run the same lists (same seed) from the same start. The simulation runs at factor
{first["real_time_factor"]:g}, policy {first["rtf_policy"]} (adaptive: factor 1 from a goal until a second
after its first action was dispatched, from half a metre before the point of interest until a second after the
next dispatch, from {SPEECH_AHEAD:g} s before the end of the question, and from a second before a cancel until
the Executor is idle; lowered where the machine does not keep up). All times are simulated seconds. Time and
distance of a mission are sums over its tasks, each from its sending until the Executor is idle; positions are
ground truth.

Naive is ROSPlan's real behaviour: the action runs to its natural end, then the cancel is read.

The oracle is what the best possible robot takes for each task from the pose and motion in which it was sent:
turning to the shortest path while setting off, driving along it at the limits of speed and acceleration, and
the true length of the question; at most the cancel time for a marked task. The path is the shortest that a
disc of the robot's true radius can take without touching the true geometry of walls and furniture (exact
shapes, no raster, no safety distance). Nothing else takes time, and no robot can be faster."""


def _table_1(analysis: Analysis) -> str:
    times, ways = analysis.summaries("time_s"), analysis.summaries("distance_m")
    rows = [
        [
            *(key[0], APPROACH_NAMES[key[1]], times[key].n),
            *(*four_figures(times[key]), paper_cell(TIME[key])),
            *(*four_figures(ways[key]), paper_cell(DISTANCE[key])),
        ]
        for key in _keys(analysis)
        if key in times
    ]
    header = (
        "mission | approach | runs | time s: mean | median | sd | cv | paper: mean [median] ± sd "
        "| distance m: mean | median | sd | cv | paper"
    )
    return section("Table 1", table(header, rows))


def _ratios(analysis: Analysis) -> str:
    rows, remarks = [], []
    for mission in analysis.missions():
        part = analysis.only(mission=float(mission))
        time, way, oracle = part.ratio("time_s"), part.ratio("distance_m"), part.oracle_ratio()
        if time is None or way is None or oracle is None:
            continue
        excess = time.value / oracle.value - 1.0
        rows.append(
            [
                *(mission, time.pairs),
                *(ratio_cell(time), number(paper_ratio(TIME, mission), 3)),
                *(ratio_cell(way), number(paper_ratio(DISTANCE, mission), 3)),
                *(ratio_cell(oracle), f"{excess:+.1%}", _verdict(excess <= EXCESS_GOAL)),
            ]
        )
        remarks += _difference(part, mission, time, way)
    header = (
        "mission | pairs | time | paper | distance | paper | oracle / Naive, time "
        f"| excess over the oracle | at most {EXCESS_GOAL:.0%}"
    )
    method = "Ratio of the means over the pairs, with the 95 % confidence interval of the ratio estimator."
    if remarks:
        remarks.insert(0, "Where the paper's ratio is outside our interval, and why:\n")
        remarks.append(f"\n{_REASONS}")
    return section("MERLIN / Naive", method, table(header, rows), "\n".join(remarks)) if rows else ""


def _difference(part: Analysis, mission: int, time: Ratio, way: Ratio) -> List[str]:
    """Why a ratio is not the paper's."""
    both = (
        ("time", time, paper_ratio(TIME, mission)),
        ("distance", way, paper_ratio(DISTANCE, mission)),
    )
    differing = [
        f"{name} {ratio.value:.3f} against {paper:.3f}"
        for name, ratio, paper in both
        if ratio.low is None or ratio.high is None or not ratio.low <= paper <= ratio.high
    ]
    naive, merlin = part.task_means("naive"), part.task_means("merlin")
    if not differing:
        return []
    tasks = MISSION_TASKS[mission]
    lines = []
    for words, unit, table_of, column in (("time", "s", TIME, ""), ("distance", "m", DISTANCE, "_m")):
        whole, theirs, ours = naive["unmarked" + column], naive["marked" + column], merlin["marked" + column]
        if whole is None or theirs is None or ours is None:
            return []
        of_naive, of_merlin = table_of[mission, "naive"].mean, table_of[mission, "merlin"].mean
        lines.append(
            f"  - {words}: a task that is not cancelled takes {whole:.1f} {unit}, a cancelled one "
            f"{theirs:.1f} {unit} under Naive and {ours:.1f} {unit} under MERLIN: a cancel saves "
            f"{theirs - ours:.1f} {unit}. In the paper a Naive task takes {of_naive / tasks:.1f} {unit} on "
            f"average, and its means say that "
            f"a cancel saves {(of_naive - of_merlin) / (tasks / 2):.1f} {unit}."
        )
    return [f"- Mission {mission}: {', '.join(differing)}.", *lines]


def _efficiency(analysis: Analysis) -> str:
    names = ("efficiency", "efficiency_completed", "efficiency_cancelled")
    columns = [analysis.summaries(name) for name in names]
    rows = [
        [
            key[0],
            APPROACH_NAMES[key[1]],
            *(c for column in columns for c in mean_and_variation(column.get(key))),
        ]
        for key in _keys(analysis)
    ]
    verdicts = []
    for mission in analysis.missions():
        for words, column, goal in (
            ("all tasks", columns[0], EFFICIENCY_GOAL),
            ("completed ones", columns[1], COMPLETED_GOAL),
        ):
            found = column.get((mission, "merlin"))
            if found:
                word = _verdict(found.mean >= goal)
                verdicts.append(
                    f"- Mission {mission}, MERLIN, {words}: {found.mean:.3f}, goal {goal}: {word}."
                )
    header = "mission | approach | all tasks: mean | cv | completed: mean | cv | cancelled: mean | cv"
    return section("Efficiency: oracle / measured", table(header, rows), "\n".join(verdicts))


def _where_time_goes(analysis: Analysis) -> str:
    names = ("time_s", "navigating_s", "speaking_s", "deliberating_s", "other_s", "after_cancel_s")
    rows = [
        [mission, APPROACH_NAMES[approach], *(number(sums[name], 1) for name in names)]
        for (mission, approach), sums in analysis.shares().items()
    ]
    notes = []
    for approach in APPROACHES:
        means = analysis.task_means(approach)
        if means["stopping"] is not None and means["deliberating"] is not None:
            notes.append(
                f"- {APPROACH_NAMES[approach]}: {means['deliberating']:.3f} s from a goal to its first "
                f"action, {means['stopping']:.2f} s from a cancel to idle, on average over all missions."
            )
    for mission in sorted({int(row["mission"]) for row in analysis.runs}):
        lost = analysis.only(mission=mission).beyond_oracle("merlin")
        if lost is not None:
            driving = lost["time"] - lost["deliberating"] - lost["between"]
            notes.append(
                f"- A completed task of Mission {mission} takes MERLIN {lost['time']:.2f} s longer than the "
                f"oracle: {lost['deliberating']:.2f} s until its first action, {lost['between']:.2f} s "
                f"between actions, and {driving:.2f} s of driving and speaking, on a way of "
                f"{lost['distance_m']:.2f} m more."
            )
    header = "mission | approach | all | driving | speaking | deliberating | between actions | after cancel"
    method = "Mean simulated seconds of a run. *After cancel* lies within the others: from a cancel to idle."
    return section("Where the time goes", method, table(header, rows), "\n".join(notes))


def _failures(analysis: Analysis) -> str:
    odd = [task for task in analysis.tasks if not task["right"]]
    rows = [
        [t["run"], f"{t['task']:.0f}", t["poi"], t["outcome"], t["stage"], t["reason"] or ""] for t in odd
    ]
    count = f"{len(odd)} of {len(analysis.tasks)}; they are in the data."
    listed = table("run | task | point | outcome | stage | reason", rows) if rows else ""
    return section("Tasks that did not end as listed", count, listed)


def _keys(analysis: Analysis) -> List[Key]:
    """Missions and approaches with a run, in the order of the paper's table."""
    present = {(int(row["mission"]), row["approach"]) for row in analysis.runs}
    return [(mission, name) for mission in (1, 2, 3) for name in APPROACHES if (mission, name) in present]


def _verdict(met: bool) -> str:
    return "met" if met else "missed"
