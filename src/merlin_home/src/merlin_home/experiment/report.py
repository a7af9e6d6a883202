"""Writes report.md: every number in it comes from the tables beside it."""

import os
import platform
from pathlib import Path
from typing import Dict, List, Optional, Sequence, Tuple

from . import figures
from .analysis import Analysis
from .paper_results import DISTANCE, TIME, PaperFigure, paper_ratio
from .run_plan import Run
from .run_table import Row
from .statistics import Ratio, Summary

EFFICIENCY_GOAL = 0.95
COMPLETED_GOAL = 0.90
EXCESS_GOAL = 0.03
NAMES = figures.NAMES


def write_report(
    results: Path, planned: Sequence[Run], run_rows: List[Row], task_rows: List[Row], command: str
) -> Path:
    """Writes the report and its figures.

    Parameters:
        results: folder.
        planned: the runs that were asked for.
        run_rows: of the finished ones.
        task_rows: of their tasks.
        command: that made it.

    Returns:
        The path of report.md.
    """
    everything = Analysis(run_rows, task_rows)
    main = everything.only(set="main")
    parts = [
        _head(planned, everything, command),
        _table_1(main),
        _ratios(main),
        _efficiency(main),
        _where_time_goes(main),
        _figures(results, main),
        _failures(everything),
        _check(everything),
        _sweep(results, everything, "cancel_after", "cancel_after", "cancel after (s)"),
        _sweep(results, everything, "share", "marked_share", "share of cancelled tasks"),
        _early_cancels(everything),
    ]
    path = results / "report.md"
    path.write_text("\n\n".join(part for part in parts if part) + "\n")
    return path


def _head(planned: Sequence[Run], analysis: Analysis, command: str) -> str:
    first = analysis.runs[0]
    return "\n".join(
        [
            "# The paper's experiment",
            "",
            f"Made by `{command}`: {len(analysis.runs)} of {len(planned)} runs finished; "
            f"{os.cpu_count()} processor cores, {platform.machine()}; {first['versions']}.",
            "",
            "Settings, fixed before any run: four points of interest; lists of 6, 20 and 120 of them with "
            "different neighbours; exactly half of the tasks marked; a marked task is cancelled "
            f"{first['cancel_after']:g} s after it was sent if it still runs (the paper does not state its time; this is "
            "the value of its successor's public code). Naive and MERLIN run the same lists (same seed) from the same "
            f"start. The simulation runs at factor {first['real_time_factor']:g}, policy {first['rtf_policy']}: factor 1 "
            "from a goal to its first action and from a second before a cancel until the Executor is idle. All times are "
            "simulated seconds; time and distance are sums over the tasks, each from its sending until the Executor is "
            "idle; positions are ground truth.",
            "",
            "Naive is ROSPlan's real behaviour: the action runs to its natural end, then the cancel is read.",
        ]
    )


def _table_1(analysis: Analysis) -> str:
    lines = [
        "## Table 1",
        "",
        "| mission | approach | runs | time s: mean | median | sd | cv | paper | distance m: mean | median | sd | cv | paper |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    times, ways = analysis.summaries("time_s"), analysis.summaries("distance_m")
    for mission in analysis.missions():
        for approach in ("naive", "merlin"):
            key = (mission, approach)
            if key in times:
                cells = [str(mission), NAMES[approach], str(times[key].n)]
                cells += [
                    *_summary(times[key]),
                    _paper(TIME[key]),
                    *_summary(ways[key]),
                    _paper(DISTANCE[key]),
                ]
                lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _ratios(analysis: Analysis) -> str:
    lines = [
        "## MERLIN / Naive",
        "",
        "Ratio of the means over the pairs, with the 95 % confidence interval of the ratio estimator.",
        "",
        "| mission | pairs | time | paper | distance | paper | oracle / Naive, time | excess over the oracle |",
        "|---|---|---|---|---|---|---|---|",
    ]
    remarks = []
    for mission in analysis.missions():
        part = analysis.only(mission=float(mission))
        time, way, oracle = part.ratio("time_s"), part.ratio("distance_m"), part.oracle_ratio()
        if time is None or way is None or oracle is None:
            continue
        excess = time.value / oracle.value - 1.0
        verdict = "met" if excess <= EXCESS_GOAL else "missed"
        lines.append(
            f"| {mission} | {time.pairs} | {_ratio(time)} | {paper_ratio(TIME, mission):.3f} | {_ratio(way)} "
            f"| {paper_ratio(DISTANCE, mission):.3f} | {_ratio(oracle)} | {excess:+.1%} (goal ≤ {EXCESS_GOAL:.0%}: {verdict}) |"
        )
        remarks += _difference(part, mission, time, way)
    return "\n".join(lines + ["", *remarks])


def _difference(part: Analysis, mission: int, time: Ratio, way: Ratio) -> List[str]:
    """Why a ratio is not the paper's."""
    differing = [
        f"{name} {ratio.value:.3f} against {paper:.3f}"
        for name, ratio, paper in (
            ("time", time, paper_ratio(TIME, mission)),
            ("distance", way, paper_ratio(DISTANCE, mission)),
        )
        if ratio.low is None or ratio.high is None or not ratio.low <= paper <= ratio.high
    ]
    naive, merlin = part.task_means("naive"), part.task_means("merlin")
    if not differing or None in (naive["marked"], naive["unmarked"], merlin["marked"]):
        return []
    paper_task = TIME[mission, "naive"].mean / {1: 6, 2: 20, 3: 120}[mission]
    # The paper gives no cancel time; its two means give the mean time of a cancelled task, if the completed ones
    # take as long under MERLIN as under Naive.
    saved = (TIME[mission, "naive"].mean - TIME[mission, "merlin"].mean) / {1: 3, 2: 10, 3: 60}[mission]
    return [
        f"- Mission {mission}: {', '.join(differing)}. Here a cancelled task takes {naive['marked']:.1f} s under Naive "
        f"and {merlin['marked']:.1f} s under MERLIN, which saves {naive['marked'] - merlin['marked']:.1f} s of each; a "
        f"completed one takes {naive['unmarked']:.1f} s. In the paper a Naive task takes {paper_task:.1f} s on average "
        f"and a cancel saves {saved:.1f} s. So the difference is that of cancel time to leg time (and, for Mission 1, "
        f"that the paper's five lists are few: its standard deviations say how far they spread)."
    ]


def _efficiency(analysis: Analysis) -> str:
    lines = [
        "## Efficiency: oracle / measured",
        "",
        "| mission | approach | all tasks: mean | cv | completed: mean | cv | cancelled: mean | cv |",
        "|---|---|---|---|---|---|---|---|",
    ]
    columns = [
        analysis.summaries(name) for name in ("efficiency", "efficiency_completed", "efficiency_cancelled")
    ]
    verdicts = []
    for mission in analysis.missions():
        for approach in ("naive", "merlin"):
            found = [column.get((mission, approach)) for column in columns]
            if any(found):
                cells = [cell for summary in found for cell in _mean_and_cv(summary)]
                lines.append(f"| {mission} | {NAMES[approach]} | {' | '.join(cells)} |")
        for name, column, goal in (
            ("all tasks", columns[0], EFFICIENCY_GOAL),
            ("completed ones", columns[1], COMPLETED_GOAL),
        ):
            summary = column.get((mission, "merlin"))
            if summary:
                word = "met" if summary.mean >= goal else "missed"
                verdicts.append(
                    f"- Mission {mission}, MERLIN, {name}: {summary.mean:.3f}, goal ≥ {goal}: {word}."
                )
    return "\n".join(lines + ["", *verdicts])


def _where_time_goes(analysis: Analysis) -> str:
    lines = [
        "## Where the time goes",
        "",
        "Mean simulated seconds of a run. *After cancel* lies within the others: from sending a cancel to idle.",
        "",
        "| mission | approach | all | driving | speaking | deliberating | between and after actions | after cancel |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for (mission, approach), sums in analysis.shares().items():
        names = ("time_s", "navigating_s", "speaking_s", "deliberating_s", "other_s", "after_cancel_s")
        cells = [f"{sums[name]:.1f}" for name in names]
        lines.append(f"| {mission} | {NAMES[approach]} | {' | '.join(cells)} |")
    for approach in ("naive", "merlin"):
        means = analysis.task_means(approach)
        if means["stopping"] is not None and means["deliberating"] is not None:
            lines.append(
                f"\n{NAMES[approach]}: {means['deliberating']:.3f} s from a goal to its first action, "
                f"{means['stopping']:.2f} s from a cancel to idle, on average."
            )
    return "\n".join(lines)


def _figures(results: Path, analysis: Analysis) -> str:
    folder, lines = results / "figures", ["## Figures", ""]
    missions = analysis.missions()
    for name, column, paper, label, caption in (
        ("times.png", "time_s", TIME, "time (s)", "Figure 10: time"),
        ("distances.png", "distance_m", DISTANCE, "distance (m)", "Figure 11: distance"),
    ):
        figures.draw_bars(folder / name, analysis.summaries(column), paper, missions, label)
        lines.append(f"![{caption}](figures/{name})")
    shown = 2 if 2 in missions else missions[0]
    pairs = analysis.only(mission=float(shown)).pairs()
    if pairs:
        merlin, naive = pairs[0]
        both = {"naive": naive, "merlin": merlin}
        title = f"Mission {shown}, seed {merlin['seed']:.0f}"
        tracks = {approach: results / "runs" / row["run"] / "track.npz" for approach, row in both.items()}
        figures.draw_paths(folder / "paths.png", tracks, title)
        lines.append(f"![Figure 9: paths of {title}](figures/paths.png)")
        tasks = {approach: _tasks(analysis, row)[:10] for approach, row in both.items()}
        figures.draw_timeline(folder / "timeline.png", tasks, f"{title}: the first tasks")
        lines.append("![Timeline](figures/timeline.png)")
        cancelled = _cancelled_in_both(analysis, both)
        if cancelled:
            chosen = {approach: (tracks[approach], cancelled[approach]) for approach in both}
            figures.draw_cancelled_task(folder / "cancelled_task.png", chosen)
            number = cancelled["merlin"]["task"]
            lines.append(f"![Task {number:.0f} of {title}, cancelled](figures/cancelled_task.png)")
    return "\n\n".join(lines)


def _cancelled_in_both(analysis: Analysis, both: Dict[str, Row]) -> Optional[Dict[str, Row]]:
    """The first task that was cancelled under both approaches."""
    merlin, naive = _tasks(analysis, both["merlin"]), _tasks(analysis, both["naive"])
    for ours, theirs in zip(merlin, naive):
        if ours["cancel_sent"] is not None and theirs["cancel_sent"] is not None:
            return {"merlin": ours, "naive": theirs}
    return None


def _tasks(analysis: Analysis, run: Row) -> List[Row]:
    return [task for task in analysis.tasks if (task["set"], task["run"]) == (run["set"], run["run"])]


def _failures(analysis: Analysis) -> str:
    odd = [task for task in analysis.tasks if not task["right"]]
    lines = [
        "## Tasks that did not end as listed",
        "",
        f"{len(odd)} of {len(analysis.tasks)}; they are in the data.",
    ]
    if odd:
        lines += ["", "| run | task | point | outcome | stage | reason |", "|---|---|---|---|---|---|"]
        for task in odd:
            cells = [
                task["run"],
                f"{task['task']:.0f}",
                task["poi"],
                task["outcome"],
                task["stage"],
                task["reason"],
            ]
            lines.append(f"| {' | '.join(str(cell) for cell in cells)} |")
    return "\n".join(lines)


def _check(analysis: Analysis) -> str:
    """The adaptive factor against factor 1 throughout, on the same lists."""
    check = analysis.only(set="check")
    if not check.runs:
        return ""
    lines = [
        "## The adaptive factor, checked at factor 1",
        "",
        "| mission | approach | seed | time s adaptive | at factor 1 | difference | distance m adaptive | at factor 1 |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for slow in check.runs:
        key = {name: slow[name] for name in ("mission", "approach", "seed")}
        fast = analysis.only(set="main", **key).runs
        if fast:
            change = fast[0]["time_s"] / slow["time_s"] - 1.0
            lines.append(
                f"| {slow['mission']:.0f} | {NAMES[slow['approach']]} | {slow['seed']:.0f} | {fast[0]['time_s']:.1f} "
                f"| {slow['time_s']:.1f} | {change:+.1%} | {fast[0]['distance_m']:.2f} | {slow['distance_m']:.2f} |"
            )
    return "\n".join(lines)


def _sweep(results: Path, analysis: Analysis, name: str, column: str, label: str) -> str:
    part = analysis.only(set=name)
    if not part.pairs():
        return ""
    points: Dict[str, List[Tuple[float, Ratio]]] = {"time": [], "distance": []}
    oracle: List[Tuple[float, float]] = []
    lines = [
        f"## Sensitivity to the {label}",
        "",
        f"![Sensitivity](figures/{name}.png)",
        "",
        f"| {label} | pairs | time | distance | oracle / Naive, time |",
        "|---|---|---|---|---|",
    ]
    for value in sorted({row[column] for row in part.runs}):
        at = part.only(**{column: value})
        time, way, best = at.ratio("time_s"), at.ratio("distance_m"), at.oracle_ratio()
        if time is None or way is None or best is None:
            continue
        points["time"].append((value, time))
        points["distance"].append((value, way))
        oracle.append((value, best.value))
        lines.append(f"| {value:.3g} | {time.pairs} | {_ratio(time)} | {_ratio(way)} | {best.value:.3f} |")
    figures.draw_sweep(results / "figures" / f"{name}.png", points, oracle, label)
    return "\n".join(lines)


def _early_cancels(analysis: Analysis) -> str:
    lines = [
        "## Early cancels",
        "",
        "| when | approach | marked tasks | as listed | of them cancelled before an action | mean time s | mean metres |",
        "|---|---|---|---|---|---|---|",
    ]
    found = False
    for name, words in (("at_once", "at once"), ("while_planning", "while planning")):
        for approach in ("naive", "merlin"):
            part = analysis.only(set=name, approach=approach)
            marked = [task for task in part.tasks if task["marked"]]
            if not marked:
                continue
            found = True
            cells = [
                words,
                NAMES[approach],
                str(len(marked)),
                f"{sum(task['right'] for task in marked):.0f}",
                str(sum(task["first_dispatch"] is None for task in marked)),
                f"{sum(task['time_s'] for task in marked) / len(marked):.2f}",
                f"{sum(task['distance_m'] for task in marked) / len(marked):.2f}",
            ]
            lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) if found else ""


def _summary(summary: Summary) -> List[str]:
    return [
        f"{summary.mean:.2f}",
        f"{summary.median:.2f}",
        _optional(summary.sd, 2),
        _optional(summary.variation, 3),
    ]


def _mean_and_cv(summary: Optional[Summary]) -> List[str]:
    return ["-", "-"] if summary is None else [f"{summary.mean:.3f}", _optional(summary.variation, 3)]


def _paper(figure: PaperFigure) -> str:
    if figure.sd != figure.sd:  # one run: no spread
        return f"{figure.mean:.0f}"
    return f"{figure.mean:.2f} [{figure.median:.2f}] ± {figure.sd:.2f}"


def _ratio(ratio: Ratio) -> str:
    if ratio.low is None or ratio.high is None:
        return f"{ratio.value:.3f} (one pair)"
    return f"{ratio.value:.3f} ({ratio.low:.3f} to {ratio.high:.3f})"


def _optional(value: Optional[float], decimals: int) -> str:
    return "-" if value is None else f"{value:.{decimals}f}"
