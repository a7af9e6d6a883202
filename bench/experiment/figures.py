# SPDX-License-Identifier: Apache-2.0
"""The figures of the report, and the lines of it that show those of the main runs."""

from pathlib import Path
from typing import Dict, List, Optional, Sequence, Tuple

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np

from experiment.analysis import Analysis, Ratio, Summary
from experiment.markdown import APPROACH_NAMES, section
from experiment.paper_results import DISTANCE, TIME, PaperFigure
from experiment.run_table import Row
from merlin_experiment.records.path_plot import MapPicture

COLORS = {"naive": "tab:orange", "merlin": "tab:blue", "oracle": "tab:green"}
PHASES = (
    ("deliberating_s", "deliberating", "tab:red"),
    ("navigating_s", "driving", "tab:blue"),
    ("speaking_s", "speaking", "tab:green"),
)


def draw_paths(path: Path, tracks: Dict[str, Path], title: str) -> None:
    """Figure 9: the ways of two runs on the map, side by side.

    :param path: the PNG.
    :param tracks: approach → track.npz.
    :param title: of the figure.
    """
    figure, all_axes = plt.subplots(1, len(tracks), figsize=(6.5 * len(tracks), 5.4), squeeze=False)
    for axes, (approach, file) in zip(all_axes[0], tracks.items()):
        with np.load(file) as data:
            picture = MapPicture(data["occupied"], float(data["resolution"]), tuple(data["origin"]))
            picture.draw(
                axes, {str(n): (float(x), float(y)) for n, (x, y) in zip(data["names"], data["points"])}
            )
            way = data["way"]
        axes.plot(way[:, 1], way[:, 2], color=COLORS[approach], linewidth=0.8)
        axes.set_title(APPROACH_NAMES[approach])
    figure.suptitle(title)
    _save(figure, path)


def draw_bars(
    path: Path,
    measured: Dict[Tuple[int, str], Summary],
    paper: Dict[Tuple[int, str], PaperFigure],
    missions: Sequence[int],
    label: str,
) -> None:
    """Figures 10 and 11: means with standard deviations, ours beside the paper's."""
    figure, all_axes = plt.subplots(1, len(missions), figsize=(3.6 * len(missions), 3.6), squeeze=False)
    for axes, mission in zip(all_axes[0], missions):
        for place, approach in enumerate(("naive", "merlin")):
            summary, reference = measured.get((mission, approach)), paper[mission, approach]
            if summary is not None:
                axes.bar(place - 0.2, summary.mean, 0.38, yerr=summary.sd, capsize=4, color=COLORS[approach])
            error = None if np.isnan(reference.sd) else reference.sd
            axes.bar(
                place + 0.2, reference.mean, 0.38, yerr=error, capsize=4, color=COLORS[approach], alpha=0.35
            )
        axes.set_xticks([0, 1], ["Naive", "MERLIN"])
        axes.set_title(f"Mission {mission}")
    all_axes[0][0].set_ylabel(label)
    figure.suptitle("solid: here, pale: the paper; bars of one standard deviation", fontsize=9)
    _save(figure, path)


def draw_timeline(path: Path, runs: Dict[str, List[Row]], title: str) -> None:
    """What each task of a pair of runs spent its time on, with the moments of the cancels.

    :param path: the PNG.
    :param runs: approach → rows of tasks.csv of one run.
    :param title: of the figure.
    """
    figure, all_axes = plt.subplots(
        len(runs), 1, figsize=(10, 1.6 + 1.3 * len(runs)), sharex=True, squeeze=False
    )
    for axes, (approach, tasks) in zip(all_axes[:, 0], runs.items()):
        for task in tasks:
            at = task["sent"]
            for column, _, color in PHASES:
                axes.barh(0, task[column] or 0.0, left=at, color=color, height=0.6)
                at += task[column] or 0.0
            height = 0.42 + 0.2 * (task["task"] % 2)  # a cancelled task is shorter than its name
            axes.text(task["sent"], height, f" {task['task']:.0f} {task['poi']}", fontsize=7)
            axes.axvline(task["sent"], color="black", linewidth=0.6)
            if task["cancel_sent"] is not None:
                axes.plot(task["cancel_sent"], 0, "kv", markersize=6)
        axes.set_yticks([0], [APPROACH_NAMES[approach]])
        axes.set_ylim(-0.4, 0.85)
    all_axes[-1, 0].set_xlabel("s of simulated time; ▼ cancel sent")
    handles = [plt.Rectangle((0, 0), 1, 1, color=color) for _, _, color in PHASES]
    figure.legend(
        handles, [name for _, name, _ in PHASES], ncol=3, loc="upper right", frameon=False, fontsize=8
    )
    figure.suptitle(title, x=0.1, ha="left", fontsize=10)
    _save(figure, path)


def draw_cancelled_task(path: Path, tracks: Dict[str, Tuple[Path, Row]]) -> None:
    """The speed of the robot around the cancel of one task, in each approach.

    :param path: the PNG.
    :param tracks: approach → track.npz and the row of the task.
    """
    figure, axes = plt.subplots(figsize=(8, 3.2))
    for approach, (file, task) in tracks.items():
        with np.load(file) as data:
            way = data["way"]
        since = way[:, 0] - way[0, 0] - task["sent"]
        part = (since >= 0) & (since <= task["time_s"] + 1.0)
        axes.plot(since[part], way[part, 4], color=COLORS[approach], label=APPROACH_NAMES[approach])
        axes.plot(task["time_s"], 0.0, "s", color=COLORS[approach], label=f"{APPROACH_NAMES[approach]}: idle")
        axes.axvline(task["cancel_sent"] - task["sent"], color="black", linewidth=0.8)
    axes.set_xlabel("s after the task was sent; black: cancel sent")
    axes.set_ylabel("speed (m/s)")
    axes.legend(fontsize=8, loc="center right")
    _save(figure, path)


def draw_sweep(
    path: Path, points: Dict[str, List[Tuple[float, Ratio]]], oracle: List[Tuple[float, float]], label: str
) -> None:
    """Ratios MERLIN / Naive over a setting, with those of the single pairs.

    :param path: the PNG.
    :param points: `time` and `distance` → value of the setting and the ratio there.
    :param oracle: value of the setting and the oracle's ratio of times.
    :param label: of the setting.
    """
    figure, axes = plt.subplots(figsize=(6, 4))
    for (name, entries), color in zip(points.items(), ("tab:blue", "tab:purple")):
        x = [value for value, _ in entries]
        y = [ratio.value for _, ratio in entries]
        axes.plot(x, y, marker="o", color=color, label=name)
        for value, ratio in entries:
            axes.plot([value] * ratio.pairs, ratio.each, ".", markersize=4, alpha=0.6, color=color)
    axes.plot(*zip(*oracle), "--", color=COLORS["oracle"], label="oracle / Naive, time")
    axes.axhline(1.0, color="black", linewidth=0.6)
    axes.set_xlabel(label)
    axes.set_ylabel("MERLIN / Naive")
    axes.legend(frameon=False)
    _save(figure, path)


def _save(figure: "plt.Figure", path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110, bbox_inches="tight")
    plt.close(figure)


#: Whose paths are drawn, as in the paper's Figure 9; the first there is when it was not run.
SHOWN_MISSION = 2
SHOWN_TASKS = 10


def figures_section(results: Path, analysis: Analysis) -> str:
    """Draws them below `<results>/figures`."""
    folder, missions = results / "figures", analysis.missions()
    times, ways = analysis.summaries("time_s"), analysis.summaries("distance_m")
    draw_bars(folder / "times.png", times, TIME, missions, "time (s)")
    draw_bars(folder / "distances.png", ways, DISTANCE, missions, "distance (m)")
    lines = [_shown("Figure 10: times", "times"), _shown("Figure 11: distances", "distances")]
    shown = SHOWN_MISSION if SHOWN_MISSION in missions else missions[0]
    pairs = analysis.only(mission=float(shown)).pairs()
    if pairs:
        lines += _pair_figures(results, analysis, shown, *pairs[0])
    return section("Figures", *lines)


def _pair_figures(results: Path, analysis: Analysis, mission: int, merlin: Row, naive: Row) -> List[str]:
    folder, both = results / "figures", {"naive": naive, "merlin": merlin}
    title = f"Mission {mission}, seed {merlin['seed']:.0f}"
    tracks = {approach: results / "runs" / row["run"] / "track.npz" for approach, row in both.items()}
    draw_paths(folder / "paths.png", tracks, title)
    first = {approach: _tasks(analysis, row)[:SHOWN_TASKS] for approach, row in both.items()}
    draw_timeline(folder / "timeline.png", first, f"{title}: the first tasks")
    lines = [_shown(f"Figure 9: paths of {title}", "paths"), _shown(f"{title}: time line", "timeline")]
    cancelled = _cancelled_in_both(analysis, both)
    if cancelled:
        chosen = {approach: (tracks[approach], cancelled[approach]) for approach in both}
        draw_cancelled_task(folder / "cancelled_task.png", chosen)
        lines.append(
            _shown(f"A cancelled task: {cancelled['merlin']['task']:.0f} of {title}", "cancelled_task")
        )
    return lines


def _cancelled_in_both(analysis: Analysis, both: Dict[str, Row]) -> Optional[Dict[str, Row]]:
    """The first task that was cancelled under both approaches."""
    merlin, naive = _tasks(analysis, both["merlin"]), _tasks(analysis, both["naive"])
    for ours, theirs in zip(merlin, naive):
        if ours["cancel_sent"] is not None and theirs["cancel_sent"] is not None:
            return {"merlin": ours, "naive": theirs}
    return None


def _tasks(analysis: Analysis, run: Row) -> List[Row]:
    return [task for task in analysis.tasks if (task["set"], task["run"]) == (run["set"], run["run"])]


def _shown(caption: str, name: str) -> str:
    return f"![{caption}](figures/{name}.png)\n\n*{caption}*"
