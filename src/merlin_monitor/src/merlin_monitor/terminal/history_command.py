# SPDX-License-Identifier: Apache-2.0
"""``rosrun merlin history``: what happened, read from the file that the monitor keeps. No node, no master."""

import argparse
import contextlib
import json
import re
import sqlite3
import sys
import time
from pathlib import Path
from typing import Any, Dict, Iterator, List, Mapping, Optional, Sequence

import rospkg

from merlin_monitor.history.event_log import EventLog
from merlin_monitor.history.history_file import FILE, HistoryError, open_for_reading
from merlin_monitor.state.history_events import KINDS
from merlin_monitor.terminal.terminal_view import printable

EXIT_MISTAKES = 2
_UNITS = {"s": 1.0, "m": 60.0, "h": 3600.0, "d": 86400.0}


def as_text(events: Sequence[Dict[str, Any]], robots: Mapping[int, str]) -> Iterator[str]:
    """One line for each event, below one for each run.

    :param robots: their namespaces by the numbers of runs; empty: of the only one.
    """
    run = None
    for event in sorted(events, key=lambda each: int(each["run"])):
        if event["run"] != run:
            run = event["run"]
            of = f", {robots[run]}" if robots.get(run) else ""
            yield f"run {run}, {time.strftime('%Y-%m-%d', time.localtime(event['wall']))}{of}"
        clock = time.strftime("%H:%M:%S", time.localtime(event["wall"]))
        yield f"  {clock}  {event['kind']:<9}  {printable(event['text'])}"


def seconds(text: str) -> float:
    """A time like ``90``, ``30s``, ``10m``, ``2h``, ``3d``, in s.

    :raises argparse.ArgumentTypeError: for something else.
    """
    match = re.fullmatch(r"(\d+(?:\.\d+)?)([smhd]?)", text)
    if not match:
        raise argparse.ArgumentTypeError(f"{text!r} is not a time like 30s, 10m, 2h or 3d")
    return float(match[1]) * _UNITS[match[2] or "s"]


def of_last_launch(runs: Sequence[Dict[str, Any]]) -> List[int]:
    """The newest run of each robot of the last launch, as several robots may share a file."""
    launch = runs[-1]["session"].partition(" ")[0]
    newest = {run["session"]: run["run"] for run in runs if launch == run["session"].partition(" ")[0]}
    return sorted(newest.values()) if launch else [runs[-1]["run"]]


def default_file() -> Path:
    """Where the monitor keeps its history unless a parameter names another folder."""
    return Path(rospkg.get_ros_home()) / "merlin" / FILE


def later_launch(logs: Path, wall: float) -> Optional[str]:
    """A sentence on a launch that began after the history's last event, None without such a launch.

    :param logs: folder of the newest launch.
    :param wall: time of the last event, s since 1970.
    """
    try:
        first = min(logs.glob("roslaunch-*.log"), key=lambda log: log.stat().st_mtime)
        with first.open(encoding="utf-8", errors="replace") as file:
            found = re.search(r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d", file.readline())
    except (OSError, ValueError):
        return None
    began = time.mktime(time.strptime(found[0], "%Y-%m-%d %H:%M:%S")) if found is not None else 0.0
    if began <= wall:
        return None
    clock = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(began))
    return f"the launch of {clock} ran without a monitor and has no history; its logs are in {logs.resolve()}"


def main() -> int:
    """Prints a history; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="rosrun merlin history",
        description="Prints what happened, from the file that the monitor keeps.",
    )
    parser.add_argument(
        "file", nargs="?", type=Path, default=default_file(), help="or its folder (%(default)s)"
    )
    parser.add_argument("--runs", action="store_true", help="list the runs")
    parser.add_argument("--run", type=int, help="number of a run; without it: that of the last launch")
    parser.add_argument("--all", action="store_true", help="all runs")
    parser.add_argument("--kind", action="append", choices=KINDS, default=[], help="these events; repeatable")
    parser.add_argument("--since", type=seconds, metavar="TIME", help="the last 30s, 10m, 2h, 3d")
    parser.add_argument("--json", action="store_true", help="a JSON list")
    given = parser.parse_args()
    try:
        with contextlib.closing(open_for_reading(given.file, events_only=True)) as file:
            for line in _answer(EventLog(file), given):
                print(line)
    except HistoryError as error:
        print(f"merlin history: {error}", file=sys.stderr)
        return EXIT_MISTAKES
    except sqlite3.Error as error:
        print(f"merlin history: {given.file} cannot be read: {error}", file=sys.stderr)
        return EXIT_MISTAKES
    return 0


def _answer(history: EventLog, given: argparse.Namespace) -> Iterator[str]:
    runs = history.runs()
    robots = {run["run"]: run["session"].partition(" ")[2].rpartition("/")[0] for run in runs}
    if given.runs:
        if given.json:
            yield json.dumps(runs, indent=1)
            return
        for run in runs:
            began = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(run["began"]))
            of = f", {robots[run['run']]}" if robots[run["run"]] else ""
            yield f"run {run['run']}, {began}, {run['events']} events{of}"
        return
    numbers = [run["run"] for run in runs]
    if given.run is not None and given.run not in numbers:
        known = f"{numbers[0]} to {numbers[-1]}" if numbers else "none"
        raise HistoryError(f"there is no run {given.run}; there are: {known}")
    wanted = [] if given.run is None else [given.run]
    if given.run is None and not given.all and given.since is None and numbers:
        wanted = of_last_launch(runs)
    since = time.time() - given.since if given.since is not None else 0.0
    events = history.find(wanted, given.kind, since)
    if given.json:
        yield json.dumps(events, indent=1)
        return
    yield from as_text(events, robots)
    latest = Path(rospkg.get_log_dir()) / "latest"
    last = max((event["wall"] for event in events), default=0.0)
    note = later_launch(latest, last) if events and given.file == default_file() else None
    if note is not None:
        yield note
