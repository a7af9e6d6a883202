# SPDX-License-Identifier: Apache-2.0
"""Runs tests again and again beside a load on the processors, and prints how often each failed.

`make repeat TESTS=test/rostest/guard TIMES=20 LOAD=8`. In results/repeat is the report of each run, in
junit's format, and its output. Exit code 0: nothing failed.
"""

import argparse
import os
import signal
import subprocess
import sys
import time
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Dict, List, Optional, Set

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "bench"))
from measuring.load import load  # noqa: E402

RESULTS = ROOT / "results" / "repeat"
EXIT_FAILED, EXIT_USAGE, EXIT_INTERRUPTED = 1, 2, 130
#: Exit codes of pytest after which its report is complete: all passed, some failed.
COMPLETE = (0, 1)


def failed_in(report: Path) -> Set[str]:
    """The tests that a report calls failed."""
    cases = ElementTree.parse(str(report)).getroot().iter("testcase")
    return {
        f"{case.get('classname')}::{case.get('name')}"
        for case in cases
        if case.find("failure") is not None or case.find("error") is not None
    }


class Run:
    """Runs of pytest one after the other, which an interrupt ends."""

    def __init__(self) -> None:
        self.interrupted = False
        self._process: Optional[subprocess.Popen[bytes]] = None
        # Not an exception, which could come while a process begins that nothing would end.
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, self._interrupt)

    def _interrupt(self, _number: int, _frame: object) -> None:
        self.interrupted = True
        if self._process is not None:
            self._process.send_signal(signal.SIGINT)

    def once(self, number: int, words: List[str], results: Path) -> Set[str]:
        """One run; returns what failed, or nothing when it was interrupted.

        :raises SystemExit: no test could be run; pytest has said why.
        """
        report, output = results / f"{number}.xml", results / f"{number}.txt"
        command = [sys.executable, "-m", "pytest", f"--junitxml={report}", "-rs", *words]
        with output.open("w", encoding="utf-8") as file:
            # Of its own group: a terminal's Ctrl-C would reach it twice.
            self._process = subprocess.Popen(
                command,
                cwd=str(ROOT),
                stdin=subprocess.DEVNULL,
                stdout=file,
                stderr=subprocess.STDOUT,
                preexec_fn=_begin,
            )
            if self.interrupted:
                self._process.send_signal(signal.SIGINT)
            code = self._process.wait()
            self._process = None
        if self.interrupted:
            return set()
        if code < 0:  # the rarest failure; the stacks of all threads are in the output
            return {f"pytest itself, killed by {signal.Signals(-code).name}"}
        if code not in COMPLETE:
            last = output.read_text(encoding="utf-8")[-3000:]
            print(f"repeat: pytest ended with {code}:\n{last}", file=sys.stderr)
            raise SystemExit(EXIT_USAGE)
        return failed_in(report)


def _begin() -> None:
    os.setpgrp()
    signal.signal(signal.SIGINT, signal.default_int_handler)


def arguments(words: List[str]) -> argparse.Namespace:
    """Reads the command line."""
    parser = argparse.ArgumentParser(prog="repeat", description=__doc__)
    parser.add_argument(
        "tests", nargs="+", help="files, folders or ids of tests; options of pytest behind --"
    )
    parser.add_argument("--times", type=int, default=20)
    parser.add_argument("--load", type=int, default=0, help="processes that keep processors busy")
    parser.add_argument("--results", type=Path, default=RESULTS, help="folder of reports and outputs")
    options = parser.parse_args(words)
    if options.times < 1 or options.load < 0:
        parser.error("--times is at least 1, --load at least 0")
    return options


def main(words: List[str]) -> int:
    """Prints a line for each run and a table; returns the exit code."""
    options = arguments(words)
    options.results.mkdir(parents=True, exist_ok=True)
    for old in options.results.glob("[0-9]*.*"):
        old.unlink()
    counts: Dict[str, int] = {}
    began, done, runs = time.monotonic(), 0, Run()
    with load(options.load):
        for number in range(1, options.times + 1):
            failed = runs.once(number, options.tests, options.results)
            if runs.interrupted:
                break
            for name in failed:
                counts[name] = counts.get(name, 0) + 1
            done = number
            each = (time.monotonic() - began) / number
            left = each * (options.times - number) / 60.0
            result = ", ".join(sorted(failed)) or "passed"
            print(f"{number}: {each:.1f} s each, {left:.0f} min left: {result}", flush=True)
    print(f"\n{done} runs at load {options.load} on {os.cpu_count()} processors")
    for name, count in sorted(counts.items(), key=lambda row: -row[1]):
        print(f"{100.0 * count / done:5.1f} %  {count} of {done}  {name}")
    if counts:
        print(f"the outputs are in {options.results}")
    elif done:
        print("nothing failed")
    if runs.interrupted:
        return EXIT_INTERRUPTED
    return EXIT_FAILED if counts else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
