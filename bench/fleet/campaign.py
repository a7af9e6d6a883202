# SPDX-License-Identifier: Apache-2.0
"""The fault campaign of a fleet: `python bench/fleet/campaign.py --trials 20`. Exit code 0: no violation.

Robots and links are those of `make fleet`, with three hubs. Each trial sends two goals, does one fault at a
random moment, and compares what the robots' Executors did with what the fleet says.
"""

import argparse
import json
import random
import statistics
import sys
from pathlib import Path
from typing import List, Optional, Sequence

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from chaos.under_test.network import NetworkError
from measuring.tables import markdown

from fleet.clocks import APART
from fleet.demonstration import make_folder
from fleet.faults import FAULTS
from fleet.setup import Say, play
from fleet.system import Fleet, Late
from fleet.trial import Row, run_trial
from merlin_fleet.fleet_client import FleetError

RESULTS = Path(__file__).resolve().parents[2] / "results" / "fleet_campaign"
ROBOTS = ["ann", "bob"]
DRIVE = 4.0  # s
#: Faults of a campaign that is not narrowed: the rows of docs/fleet-measurements.md.
USUAL = [name for name in FAULTS if name != "none"]
EXIT_WRONG = 1
HEADS = (
    *("fault", "trials", "goals", "lost", "executed by two", "results lost", "done again", "failed"),
    *("next owner p50 / max, s", "all well p50 / max, s"),
)


def violations(row: Row) -> int:
    """What must be 0."""
    return row.lost + row.twice + row.forgotten + (row.back is None)


def table(rows: Sequence[Row]) -> str:
    """The rows of each fault in one line."""
    lines = []
    for name, fault in FAULTS.items():
        of_fault = [row for row in rows if row.fault == name]
        if not of_fault:
            continue
        sums = [sum(getattr(row, what) for row in of_fault) for what in ("lost", "twice", "forgotten")]
        more = [sum(getattr(row, what) for row in of_fault) for what in ("again", "failed")]
        times = [_times([row.next_owner for row in of_fault]), _times([row.back for row in of_fault])]
        lines.append([fault.words, len(of_fault), 2 * len(of_fault), *sums, *more, *times])
    return markdown(HEADS, lines)


def _times(found: Sequence[Optional[float]]) -> str:
    known = [each for each in found if each is not None]
    return f"{statistics.median(known):.1f} / {max(known):.1f} ({len(known)})" if known else ""


def run(options: argparse.Namespace, say: Say) -> int:
    """Runs the campaign; returns the exit code."""
    folder = make_folder(options.results)
    say(f"logs and rows are in {folder}")
    chance = random.Random(options.seed)
    rows: List[Row] = []
    fleet = Fleet(ROBOTS, folder, DRIVE, APART if options.clocks == "apart" else None)
    try:
        for number in range(1, 1 + options.trials * len(options.faults)):
            name = options.faults[(number - 1) % len(options.faults)]
            row = run_trial(fleet, number, name, chance)
            rows.append(row)
            with (folder / "rows.jsonl").open("a") as file:
                file.write(json.dumps(row._asdict()) + "\n")
            verdict = "WRONG" if violations(row) else "well"
            times = f"next owner {row.next_owner} s, all well after {row.back} s"
            say(f"{number} {name} on {row.victim}: {verdict}; {times} {row.note}")
    except Late as late:
        say(f"WRONG: the fleet does not come back: {late}")
        return EXIT_WRONG
    finally:
        fleet.close()
        print(table(rows), flush=True)
    return EXIT_WRONG if any(map(violations, rows)) else 0


def main(arguments: List[str]) -> int:
    """Reads the command line, runs, ends everything; returns the exit code."""
    parser = argparse.ArgumentParser(prog="campaign", description=__doc__)
    parser.add_argument("--trials", type=int, default=20, help="of each fault (%(default)d)")
    parser.add_argument("--faults", nargs="+", default=USUAL, choices=list(FAULTS), metavar="FAULT")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--clocks", choices=["same", "apart"], default="same", help="of the robots (%(default)s)"
    )
    parser.add_argument("--results", type=Path, default=RESULTS)
    options = parser.parse_args(arguments)
    return play(lambda say: run(options, say), (FleetError, NetworkError, OSError, RuntimeError))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
