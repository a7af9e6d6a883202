# SPDX-License-Identifier: Apache-2.0
"""The fault campaign: `python bench/chaos --trials 20 --seed 1`. Exit code 0: nothing was violated."""

import argparse
import fnmatch
import os
import sys
from itertools import chain
from pathlib import Path
from typing import Callable, Dict, Iterator, List, Tuple

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import rospkg
import yaml
from measuring.tables import end_as_by_ctrl_c

from chaos import endurance, table
from chaos.campaign import Campaign
from chaos.faults import NODES, all_faults
from chaos.judging.evidence import PATIENCE
from chaos.moments import Moment
from chaos.trials import JOINS, Trial, draw, known_failures
from chaos.under_test.network import why_impossible, why_slow
from chaos.under_test.system import StartError
from merlin_ros.processes.process_tree import adopt_orphans

ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / "results" / "chaos"
EXIT_VIOLATED, EXIT_USAGE, EXIT_START, EXIT_INTERRUPTED = 1, 2, 3, 130


def points_of_interest() -> Dict[str, Tuple[float, float]]:
    """x, y of the apartment's points of interest."""
    world = Path(rospkg.RosPack().get_path("merlin_sim")) / "worlds" / "apartment.yaml"
    points = yaml.safe_load(world.read_text())["points_of_interest"]
    return {name: (float(point["x"]), float(point["y"])) for name, point in points.items()}


def absent_nodes() -> List[str]:
    """Nodes that the launch files of this checkout do not start."""
    folder = Path(rospkg.RosPack().get_path("merlin")) / "launch" / "include"
    text = "".join(path.read_text() for path in folder.glob("*.launch"))
    return [node for node in NODES if f'name="{node}"' not in text]


def arguments(words: List[str]) -> argparse.Namespace:
    """Reads the command line."""
    parser = argparse.ArgumentParser(prog="chaos", description=__doc__)
    parser.add_argument(
        "--trials", type=int, help="how many valid ones; default: each chosen known failure once, else 20"
    )
    parser.add_argument("--minutes", type=float, help="begin no trial after this time")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--faults", nargs="+", default=["*"], help="names or patterns; 'known': the known failures"
    )
    parser.add_argument(
        "--moments", nargs="+", default=[m.value for m in Moment], choices=[m.value for m in Moment]
    )
    parser.add_argument(
        "--respawn", choices=["both", "yes", "no"], default="both", help="do dead nodes come back"
    )
    parser.add_argument(
        "--joins",
        type=int,
        default=JOINS,
        metavar="N",
        help="one in N trials with a drive sends three requests that join (%(default)d)",
    )
    parser.add_argument(
        "--results",
        type=Path,
        nargs="+",
        default=[RESULTS],
        help="folder of the rows; several only for --markdown, which puts them together",
    )
    parser.add_argument(
        "--patience",
        type=float,
        default=PATIENCE,
        help="how many times a limit a starved machine may make of it (%(default)g)",
    )
    parser.add_argument("--fresh", action="store_true", help="a new system for every trial")
    parser.add_argument("--keep", action="store_true", help="add to the rows that are there")
    parser.add_argument(
        "--markdown",
        type=Path,
        nargs="?",
        const=Path("-"),
        metavar="PAGE",
        help="no trials: print the table of the rows that are there, or put it between the marks of a page",
    )
    parser.add_argument(
        "--goals", type=int, help="no faults: so many goals on one system; does anything grow"
    )
    parser.add_argument(
        "--why", action="store_true", help="ask the robot why each request failed: does it name the fault"
    )
    parser.add_argument("--list", action="store_true", help="print the names of all faults; no trials")
    options = parser.parse_args(words)
    if options.joins < 1:
        parser.error("--joins is how many trials there are for each one of that kind: 1 or more")
    return options


def main(words: List[str]) -> int:
    """Runs a campaign; returns the exit code."""
    options = arguments(words)
    if options.list:
        print("\n".join([*known_failures(), *all_faults()]))
        return 0
    if options.markdown:
        return _tabulate(options)
    if len(options.results) > 1:
        print("chaos: several folders of results are for --markdown only", file=sys.stderr)
        return EXIT_USAGE
    options.results = options.results[0]
    rows = options.results / "trials.csv"
    if options.goals:
        return _guarded(lambda: _endure(options))
    if not options.keep:
        rows.unlink(missing_ok=True)
    respawn = {"both": (True, False), "yes": (True,), "no": (False,)}[options.respawn]
    moments = [Moment(name) for name in options.moments]
    try:
        trials = draw(options.seed, options.faults, moments, respawn, absent_nodes(), options.joins)
        first = next(trials)
    except ValueError as error:
        print(f"chaos: {error}", file=sys.stderr)
        return EXIT_USAGE
    return _guarded(lambda: _run(options, rows, chain([first], trials), options.trials or _count(options)))


def _tabulate(options: argparse.Namespace) -> int:
    try:
        rows = [row for folder in options.results for row in table.read(folder / "trials.csv")]
        if options.markdown == Path("-"):
            print(table.markdown(rows))
        else:
            table.write_into(options.markdown, rows)
    except (OSError, ValueError) as error:
        print(f"chaos: {error}", file=sys.stderr)
        return EXIT_USAGE
    return 0


def _count(options: argparse.Namespace) -> int:
    names = known_failures()
    chosen = [
        name
        for name in names
        if "known" in options.faults
        or any(fnmatch.fnmatchcase(name, each) for each in options.faults if each != "*")
    ]
    return len(chosen) or (10**6 if options.minutes else 20)


def _run(options: argparse.Namespace, rows: Path, trials: Iterator[Trial], count: int) -> int:
    if why_impossible():
        print(f"chaos: no trials with a cut link: {why_impossible()}", file=sys.stderr)
    elif why_slow():
        print(f"chaos: after a cut of 30 s the next goal comes late: {why_slow()}", file=sys.stderr)
    campaign = Campaign(
        rows, points_of_interest(), sys.stdout, not options.fresh, options.patience, options.why
    )
    seconds = None if options.minutes is None else options.minutes * 60.0
    try:
        return EXIT_VIOLATED if campaign.run(trials, count, seconds) else 0
    finally:
        if campaign.rows:
            everything = table.read(rows)
            (options.results / "table.md").write_text(table.markdown(everything) + "\n")
            if options.why:
                print(f"\n{table.named(everything)}")
            print(f"\n{table.text(everything)}\n\nwritten to {rows} and table.md")


def _endure(options: argparse.Namespace) -> int:
    found = endurance.run(options.goals, points_of_interest(), options.results, sys.stdout)
    print("\n".join(found) or f"nothing grew in {options.goals} goals; {options.results / 'usage.csv'}")
    return EXIT_VIOLATED if found else 0


def _guarded(work: Callable[[], int]) -> int:
    """Does work that starts systems; an interrupt ends it cleanly."""
    # What a killed launcher leaves behind becomes a child of this process, which ends it.
    adopt_orphans()
    end_as_by_ctrl_c()
    try:
        return work()
    except StartError as error:
        print(f"chaos: the system does not start: {error}", file=sys.stderr)
        return EXIT_START
    except KeyboardInterrupt:
        print("chaos: interrupted", file=sys.stderr)
        return EXIT_INTERRUPTED


if __name__ == "__main__":
    status = main(sys.argv[1:])
    sys.stdout.flush()
    os._exit(status)  # threads of killed children may still wait
