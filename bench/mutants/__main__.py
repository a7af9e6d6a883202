# SPDX-License-Identifier: Apache-2.0
"""Changes modules of the cores in small ways, one at a time, and counts which changes no unit test notices.

Usage: python bench/mutants [--sample 4] [--seed 1] [--seconds 10] [--minutes 0] [module ...]
A module is a pattern like `merlin_pddl/*` or `merlin_executor/core/agenda.py`; without one, those of CORES.
Only unit tests that import the module run, the nearest first, until one fails.
Prints a table and each change that survives; all changes go to results/mutants.csv.
"""

import argparse
import signal
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "bench"))

from mutants.measurement import Table, measure, selected  # noqa: E402
from mutants.trial import Bench  # noqa: E402

CORES = (
    "merlin_pddl/*",
    "merlin_rosplan/dispatch/*",
    "merlin_rosplan/knowledge/*",
    "merlin_executor/core/*",
    "merlin_actions/core/*",
    "merlin_ros/actions/lease*",
    "merlin_ros/actions/ownership.py",
    "merlin_ros/actions/serial_action_server.py",
    "merlin_ros/work/*",
)
EXIT_INTERRUPTED = 130


def main() -> int:
    """Measures, prints the table, also when it is ended early; returns the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("modules", nargs="*")
    parser.add_argument("--sample", type=int, default=4, help="mutants per module")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=10.0, help="of tests per mutant")
    parser.add_argument("--minutes", type=float, default=0.0, help="in all; 0: until all are done")
    options = parser.parse_args()
    for number in (signal.SIGINT, signal.SIGTERM):  # a shell starts what is in the background deaf to Ctrl-C
        signal.signal(number, signal.default_int_handler)
    modules = selected(options.modules or CORES, ROOT)
    if not modules:
        parser.error(f"no module matches {' '.join(options.modules)}")
    table, code = Table(modules, ROOT), 0
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        try:
            measure(modules, table, Bench(Path(folder), ROOT), options, ROOT)
        except KeyboardInterrupt:
            print("ended early", file=sys.stderr)
            code = EXIT_INTERRUPTED
    table.write(ROOT / "results" / "mutants.csv")
    print("\n".join(table.lines()))
    return code


if __name__ == "__main__":
    sys.exit(main())
