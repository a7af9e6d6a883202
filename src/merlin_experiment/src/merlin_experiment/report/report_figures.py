# SPDX-License-Identifier: Apache-2.0
"""The figures of the main runs, and the lines of the report that show them."""

from pathlib import Path
from typing import Dict, List, Optional

from merlin_experiment.report import figures
from merlin_experiment.report.analysis import Analysis
from merlin_experiment.report.markdown import section
from merlin_experiment.report.paper_results import DISTANCE, TIME
from merlin_experiment.runs.run_table import Row

#: Whose paths are drawn, as in the paper's Figure 9; the first there is when it was not run.
SHOWN_MISSION = 2
SHOWN_TASKS = 10


def figures_section(results: Path, analysis: Analysis) -> str:
    """Draws them below `<results>/figures`."""
    folder, missions = results / "figures", analysis.missions()
    times, ways = analysis.summaries("time_s"), analysis.summaries("distance_m")
    figures.draw_bars(folder / "times.png", times, TIME, missions, "time (s)")
    figures.draw_bars(folder / "distances.png", ways, DISTANCE, missions, "distance (m)")
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
    figures.draw_paths(folder / "paths.png", tracks, title)
    first = {approach: _tasks(analysis, row)[:SHOWN_TASKS] for approach, row in both.items()}
    figures.draw_timeline(folder / "timeline.png", first, f"{title}: the first tasks")
    lines = [_shown(f"Figure 9: paths of {title}", "paths"), _shown(f"{title}: time line", "timeline")]
    cancelled = _cancelled_in_both(analysis, both)
    if cancelled:
        chosen = {approach: (tracks[approach], cancelled[approach]) for approach in both}
        figures.draw_cancelled_task(folder / "cancelled_task.png", chosen)
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
