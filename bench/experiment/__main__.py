# SPDX-License-Identifier: Apache-2.0
"""The paper's experiment, `make experiment`: `python bench/experiment --mission 1 --runs 5`."""

import argparse
import os
import shutil
import sys
from pathlib import Path
from typing import List, Optional

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from measuring.tables import end_as_by_ctrl_c

from experiment.experiment_runner import (
    ExperimentInterrupted,
    ExperimentRunner,
    say,
)
from experiment.report import write_report
from experiment.run_plan import (
    APPROACHES,
    DEFAULT_RUNS,
    ExperimentRun,
    check_runs,
    main_runs,
    sweep_runs,
    world_runs,
)
from experiment.run_table import collect, write_joined

EXIT_FAILED_RUNS = 1
EXIT_INTERRUPTED = 130
STOPPED = "stopped; the same command goes on where this one ended"
PAGE = "experiment"


def publish(results: Path, docs: Path) -> List[Path]:
    """Writes `<docs>/experiment.md` and `<docs>/experiment/`.

    :param results: folder of the experiment, with report.md, runs.csv and figures/.
    :param docs: folder of the documentation.
    :return: The paths written.
    """
    folder = docs / PAGE
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("*.png"):
        old.unlink()
    text = (results / "report.md").read_text().replace("](figures/", f"]({PAGE}/")
    page = docs / f"{PAGE}.md"
    page.write_text(f"{text}\nOne row per run: [{PAGE}/runs.csv]({PAGE}/runs.csv).\n")
    copied = [results / "runs.csv", *sorted((results / "figures").glob("*.png"))]
    return [page, *(Path(shutil.copy(path, folder)) for path in copied)]


def parse(words: Optional[List[str]] = None) -> argparse.Namespace:
    """Reads the command line."""
    parser = argparse.ArgumentParser(
        prog="experiment", description="The paper's experiment: runs what is not done yet, then reports."
    )
    parser.add_argument("--mission", type=int, choices=(1, 2, 3), help="only this one")
    parser.add_argument("--approach", choices=APPROACHES, help="only this one")
    parser.add_argument(
        "--runs",
        type=int,
        nargs="+",
        metavar="PAIRS",
        help="of all missions, or of 1, 2 and 3 (default: 5 5 1)",
    )
    parser.add_argument("--seed", type=int, default=1, help="of the first pair")
    parser.add_argument("--rtf", type=float, default=5.0, help="real-time factor while the robot moves")
    parser.add_argument("--check", action="store_true", help="also runs at factor 1 throughout")
    parser.add_argument("--sweeps", type=int, default=0, metavar="PAIRS", help="also the sensitivity sweeps")
    parser.add_argument(
        "--worlds",
        type=int,
        default=0,
        metavar="N",
        help="Mission 1 in N generated worlds; with no option that names other runs, only these",
    )
    parser.add_argument("--record", action="store_true", help="a bag of each run")
    parser.add_argument("--results", type=Path, default=Path("results/experiment"))
    parser.add_argument("--report-only", action="store_true", help="no runs: report on what there is")
    parser.add_argument("--docs", type=Path, help="also copy report, figures and runs.csv into this folder")
    arguments = parser.parse_args(words)
    if arguments.runs is not None and (len(arguments.runs) not in (1, 3) or min(arguments.runs) < 1):
        parser.error("--runs: give one number, or three (of Missions 1, 2 and 3), each 1 or more")
    if arguments.worlds < 0:
        parser.error(f"--worlds {arguments.worlds}: give 0 or more")
    if arguments.worlds and arguments.seed < 1:
        parser.error(f"--seed {arguments.seed}: the first generated world needs 1 or more")
    if not 0.0 <= arguments.rtf < float("inf"):
        parser.error(f"--rtf {arguments.rtf}: give 0 (as fast as possible) or more")
    return arguments


def planned(arguments: argparse.Namespace) -> List[ExperimentRun]:
    """The runs that a command line asks for."""
    missions = [arguments.mission] if arguments.mission else sorted(DEFAULT_RUNS)
    approaches = [arguments.approach] if arguments.approach else list(APPROACHES)
    given = arguments.runs or [DEFAULT_RUNS[mission] for mission in (1, 2, 3)]
    counts = dict(zip((1, 2, 3), given if len(given) == 3 else given * 3))
    worlds = world_runs(approaches, arguments.worlds, arguments.seed, arguments.rtf)
    if worlds and not (arguments.mission or arguments.runs or arguments.check or arguments.sweeps):
        return worlds
    runs = main_runs(missions, approaches, counts, arguments.seed, arguments.rtf)
    if arguments.check:
        runs += check_runs(approaches, arguments.seed)
    if arguments.sweeps:
        runs += sweep_runs(approaches, arguments.sweeps, arguments.seed, arguments.rtf)
    return runs + worlds


def main() -> int:
    """Entry point; returns the exit code."""
    arguments = parse()
    end_as_by_ctrl_c()
    os.environ.setdefault("PYTHONUNBUFFERED", "1")
    results = arguments.results.absolute()
    runs = planned(arguments)
    failed: List[ExperimentRun] = []
    code = 0
    try:
        if not arguments.report_only:
            failed = ExperimentRunner(results, arguments.record).run_all(runs)
    except (ExperimentInterrupted, KeyboardInterrupt):
        print(f"experiment: {STOPPED}", file=sys.stderr)
        code = EXIT_INTERRUPTED
    run_rows, task_rows = collect(results, runs)
    if not run_rows:
        print(f"experiment: no finished run below {results}", file=sys.stderr)
        return code or EXIT_FAILED_RUNS
    paths = write_joined(results, run_rows, task_rows)
    command = " ".join(["python bench/experiment", *sys.argv[1:]])
    paths.append(write_report(results, runs, run_rows, task_rows, command))
    if arguments.docs:
        paths += publish(results, arguments.docs.absolute())
    for path in paths:
        say(f"written: {path}")
    for run in failed:
        say(f"failed: {run.name}")
    return code or (EXIT_FAILED_RUNS if failed else 0)


if __name__ == "__main__":
    sys.exit(main())
