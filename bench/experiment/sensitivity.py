# SPDX-License-Identifier: Apache-2.0
"""Sections of the report on other settings: factor 1, cancel times, shares, early cancels, worlds."""

from pathlib import Path
from statistics import median
from typing import Dict, List, Sequence, Tuple

from experiment import figures
from experiment.analysis import Analysis, Ratio
from experiment.generated_world import HEIGHT, ROOMS, WIDTH
from experiment.markdown import APPROACH_NAMES, number, section, spread_cell, table
from experiment.run_plan import APPROACHES, KILLED_IN
from experiment.run_table import Row


def check_section(analysis: Analysis) -> str:
    """The adaptive factor against factor 1 throughout, on the same lists."""
    rows = []
    for slow in analysis.only(set="check").runs:
        key = {name: slow[name] for name in ("mission", "approach", "seed")}
        fast = next(iter(analysis.only(set="main", **key).runs), None)
        if fast is not None:
            times = [number(row["time_s"], 1) for row in (fast, slow)]
            ways = [number(row["distance_m"], 2) for row in (fast, slow)]
            change = f"{fast['time_s'] / slow['time_s'] - 1.0:+.1%}"
            head = [int(slow["mission"]), APPROACH_NAMES[slow["approach"]], int(slow["seed"])]
            rows.append([*head, *times, change, *ways])
    header = (
        "mission | approach | seed | time s, adaptive | at factor 1 | difference | distance m, adaptive "
        "| at factor 1"
    )
    return section("The adaptive factor, checked at factor 1", table(header, rows)) if rows else ""


def sweep_section(results: Path, analysis: Analysis, name: str, column: str, label: str) -> str:
    """Ratios over a setting, with a figure; empty without runs.

    :param results: folder.
    :param analysis: everything.
    :param name: of the set of runs, and of the figure.
    :param column: of the runs that holds the setting.
    :param label: of the setting, for people.
    """
    part = analysis.only(set=name)
    points: Dict[str, List[Tuple[float, Ratio]]] = {"time": [], "distance": []}
    oracle: List[Tuple[float, float]] = []
    rows = []
    for value in sorted({row[column] for row in part.runs}):
        at = part.only(**{column: value})
        time, way, best = at.ratio("time_s"), at.ratio("distance_m"), at.oracle_ratio()
        if time is None or way is None or best is None:
            continue
        points["time"].append((value, time))
        points["distance"].append((value, way))
        oracle.append((value, best.value))
        rows.append(
            [
                *(f"{value:.3g}", time.pairs, spread_cell(time), spread_cell(way), number(best.value, 3)),
                f"{time.value / best.value - 1.0:+.1%}",
            ]
        )
    if not rows:
        return ""
    figures.draw_sweep(results / "figures" / f"{name}.png", points, oracle, label)
    method = "Ratio of the means over the pairs; in brackets, and as small marks, those of the single pairs."
    listed = table(f"{label} | pairs | time | distance | oracle / Naive, time | excess over the oracle", rows)
    return section(f"Sensitivity to the {label}", f"![{label}](figures/{name}.png)", method, listed)


def killed_section(analysis: Analysis) -> str:
    """What a navigation that dies in mid-mission and is started again costs."""
    rows = []
    for run in analysis.only(set="navigation_killed").runs:
        key = {name: run[name] for name in ("mission", "approach", "seed")}
        sound = next(iter(analysis.only(set="main", **key).runs), None)
        tasks = analysis.only(set="navigation_killed", **key).tasks
        hit = next((task for task in tasks if task["task"] == KILLED_IN), None)
        if hit is not None:
            rows.append(
                [
                    *(APPROACH_NAMES[run["approach"]], int(run["seed"])),
                    *(f"{run['right']:.0f} of {run['tasks']:.0f}", hit["outcome"], int(hit["replans"] or 0)),
                    *(number(hit["time_s"], 1), number(run["time_s"], 1)),
                    number(sound["time_s"] if sound else None, 1),
                ]
            )
    header = (
        "approach | seed | tasks as listed | outcome of the task | its replans | its time s | mission s "
        "| without the crash"
    )
    method = f"Navigation gets SIGKILL 5 s into task {KILLED_IN} and is started again by its launch file."
    return section("Navigation killed in mid-mission", method, table(header, rows)) if rows else ""


def early_cancel_section(analysis: Analysis) -> str:
    """What becomes of tasks that are cancelled at once, and while the planner works."""
    rows = []
    for name, words in (("at_once", "at once"), ("while_planning", "while planning")):
        for approach in APPROACHES:
            marked = [task for task in analysis.only(set=name, approach=approach).tasks if task["marked"]]
            if marked:
                count = len(marked)
                rows.append(
                    [
                        *(words, APPROACH_NAMES[approach], count, int(sum(t["right"] for t in marked))),
                        sum(t["first_dispatch"] is None for t in marked),
                        number(sum(t["time_s"] for t in marked) / count, 2),
                        number(sum(t["distance_m"] for t in marked) / count, 2),
                    ]
                )
    header = "when | approach | marked tasks | as listed | before an action | mean time s | mean metres"
    return section("Early cancels", table(header, rows)) if rows else ""


def worlds_section(analysis: Analysis) -> str:
    """Ratios, efficiency and tasks that did not end as listed, over generated worlds; empty without runs."""
    part = analysis.only(set="worlds")
    if not part.runs:
        return ""
    first = part.runs[0]
    figures_of: List[Tuple[str, int, List[float]]] = []
    for words, column in (("time", "time_s"), ("distance", "distance_m")):
        ratio = part.ratio(column)
        figures_of.append((f"MERLIN / Naive, {words}", 3, list(ratio.each) if ratio else []))
    for approach in APPROACHES:
        runs = part.only(approach=approach).runs
        name = APPROACH_NAMES[approach]
        for words, column in (("all tasks", "efficiency"), ("completed tasks", "efficiency_completed")):
            values = [row[column] for row in runs if row[column] is not None]
            figures_of.append((f"efficiency of {name}, {words}", 3, values))
        odd = [row["tasks"] - row["right"] for row in runs]
        figures_of.append((f"tasks of {name} not as listed, of {_tasks(runs)}", 0, odd))
    rows = [
        [words, len(values), *(number(of(values), decimals) for of in (min, median, max))]
        for words, decimals, values in figures_of
        if values
    ]
    method = (
        f"Mission 1 in generated floor plans of {WIDTH:g} x {HEIGHT:g} m with {ROOMS} furnished rooms and a "
        "point of interest in each; the durations of the drives in the planning problem are measured on the "
        f"map of that world. Factor {first['real_time_factor']:g}, policy {first['rtf_policy']}. "
        "A ratio is that of one pair."
    )
    return section("Generated worlds", method, table("figure | worlds | min | median | max", rows))


def _tasks(runs: Sequence[Row]) -> str:
    return " or ".join(sorted({f"{row['tasks']:.0f}" for row in runs}))
