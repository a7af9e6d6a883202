#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Runs all benchmarks, each in its own process, writes results/bench.json and prints a table.

Usage: bench/run.py [--docs] [topic ...]     for example: bench/run.py knowledge dispatch
Without topics all but the long ones, which are the keys of LONG.
--docs puts the table into docs/benchmarks.md.
"""

import json
import os
import platform
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, Dict, Iterator, List, Optional, Tuple

from measuring.budgets import budget
from measuring.figures import figure
from measuring.processor import processor_ms

BENCH = Path(__file__).resolve().parent
RESULTS = BENCH.parent / "results" / "bench.json"
PAGE = BENCH.parent / "docs" / "benchmarks.md"
BEGIN, END = "<!-- table of make bench: begin -->", "<!-- table of make bench: end -->"
LIMIT = float(os.environ.get("LIMIT", 600.0))  # s for one benchmark
STOP = 90.0  # s for it to end its nodes
#: Topic → module of its benchmark: bench/<folder>/bench_<topic>.py.
TOPICS = {
    path.stem[len("bench_") :]: f"{path.parent.name}.{path.stem}"
    for path in sorted(BENCH.glob("*/bench_*.py"))
}
#: Topics that are run by their name only, and s for each.
LONG = {
    "day": 3600.0,
    "errands": 600.0,
    "errands_cancelled": 1800.0,
    "fleet": 3600.0,
    "joined_stress": 3600.0,
    "mission_together": 1800.0,
    "profile": 1200.0,
    "restaurant_lost": 3600.0,
    "robots_home": 3600.0,
}

# What a benchmark's process does: measure, and write the results to a given file.
_CHILD = """
import importlib, json, sys
sys.path.insert(0, sys.argv[1])
json.dump(importlib.import_module(sys.argv[2]).measure(), open(sys.argv[3], "w"))
"""


def run(topic: str) -> Tuple[Optional[Dict[str, Any]], str]:
    """Results of one benchmark and, when it failed, what it printed."""
    target = RESULTS.parent / f"bench_{topic}.json"
    target.unlink(missing_ok=True)
    limit = max(LIMIT, LONG.get(topic, 0.0))
    process = subprocess.Popen(
        [sys.executable, "-c", _CHILD, str(BENCH), TOPICS[topic], str(target)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        start_new_session=True,
    )
    try:
        output, _ = process.communicate(timeout=limit)
    except subprocess.TimeoutExpired:
        output = f"{_end(process)}\nended after {limit:.0f} s"
    except KeyboardInterrupt:
        _end(process)
        raise
    if process.returncode or not target.exists():
        return None, output
    results = json.loads(target.read_text())
    target.unlink()
    return results, output


def _end(process: "subprocess.Popen[str]") -> str:
    """Ends a benchmark with what it has started, which is in sessions of its own; returns what it printed."""
    process.send_signal(signal.SIGINT)
    try:
        return str(process.communicate(timeout=STOP)[0])
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        return str(process.communicate()[0])


def rows(results: Dict[str, Any], path: Tuple[str, ...] = ()) -> Iterator[Tuple[str, Any]]:
    """Names and values of all figures, those of nested ones joined by a blank."""
    for name, value in results.items():
        if isinstance(value, dict) and "median" not in value:
            yield from rows(value, (*path, name))
        else:
            yield " ".join((*path, name)), value


def table(results: Dict[str, Any]) -> str:
    """All figures as text."""
    lines = [f"{'':44}{'median':>12}{'p95':>12}{'p99':>12}{'n':>8}"]
    for name, value in rows(results):
        if isinstance(value, dict):
            cells = "".join(f"{value.get(key, ''):>12}" for key in ("median", "p95", "p99"))
            lines.append(f"{name:44}{cells}{value.get('n', ''):>8}")
        else:
            lines.append(f"{name:44}{value!s:>12}")
    return "\n".join(lines)


def markdown(results: Dict[str, Any]) -> str:
    """All figures as the table of docs/benchmarks.md."""
    lines = [
        BEGIN,
        f"`make bench` on {results['machine']}, load average {results['load_average']} at the start.",
        "",
        "| figure | budget | median | p95 | p99 | n |",
        "|---|---|---|---|---|---|",
    ]
    for name, value in rows(results):
        if isinstance(value, dict):
            cells = " | ".join(str(value.get(key, "")) for key in ("median", "p95", "p99", "n"))
            lines.append(f"| {name} | {budget(name)} | {cells} |")
        elif name not in ("machine", "load_average"):
            lines.append(f"| {name} | {budget(name)} | {value} | | | |")
    return "\n".join([*lines, END]) + "\n"


def put_into(page: Path, text: str) -> None:
    """Replaces the table of a page."""
    before, rest = page.read_text().split(BEGIN, 1)
    page.write_text(before + text.rstrip("\n") + rest.split(END, 1)[1])


def main(topics: List[str]) -> int:
    """Runs the benchmarks of these topics, or all; returns the exit code."""
    into_page = "--docs" in topics
    topics = [topic for topic in topics if topic != "--docs"]
    unknown = sorted(set(topics) - set(TOPICS))
    if unknown:
        print(f"no benchmark: {', '.join(unknown)}", file=sys.stderr)
        return 2
    RESULTS.parent.mkdir(exist_ok=True)
    collected: Dict[str, Any] = {}
    if topics and RESULTS.exists():  # a part is measured anew, the rest is kept
        collected = json.loads(RESULTS.read_text())
    failed = []
    speed = processor_ms()
    collected["load_average"] = round(os.getloadavg()[0], 1)
    for topic in topics or sorted(set(TOPICS) - set(LONG)):
        start = time.monotonic()
        print(f"bench_{topic} ...", end=" ", flush=True)
        results, output = run(topic)
        print(f"{time.monotonic() - start:.0f} s" if results is not None else "FAILED", flush=True)
        if results is None:
            failed.append(topic)
            print(output, file=sys.stderr)
        else:
            collected.update(results)
    collected["processor_ms"] = figure([*speed, *processor_ms()])  # before and after
    collected["machine"] = f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores"
    RESULTS.write_text(json.dumps(collected, indent=2, sort_keys=True) + "\n")
    RESULTS.with_suffix(".md").write_text(markdown(collected))
    if into_page:
        put_into(PAGE, markdown(collected))
    print(table(collected))
    print(f"\nwritten to {RESULTS} and {RESULTS.with_suffix('.md').name}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
