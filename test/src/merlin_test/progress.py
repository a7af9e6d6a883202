# SPDX-License-Identifier: Apache-2.0
"""What a run of many tests says while it runs: progress with an estimate, and each failure at once.

A pytest plugin of the process that starts the workers. ``test/durations.txt`` says how long each file takes;
the longest are begun first, so that the last worker does not end long after the others.
"""

import threading
import time
from pathlib import Path
from typing import Any, Dict, List, Optional, Tuple, Union

import pytest

#: s between two lines of progress.
INTERVAL = 20.0
#: s that a file of tests counts which is not in the list.
UNKNOWN = 1.0
#: Lines of a failure that are shown at once; junit has all of them.
MOST_LINES = 150


def read_durations(path: Path) -> Dict[str, float]:
    """The seconds of each file of tests, from lines ``seconds file``; empty without the list."""
    if not path.is_file():
        return {}
    rows = (line.split(None, 1) for line in path.read_text(encoding="utf-8").splitlines() if line)
    return {name: float(seconds) for seconds, name in rows}


def file_of(nodeid: str) -> str:
    """The file of a test's id."""
    return nodeid.split("::", 1)[0]


def longest_first(items: List[pytest.Item], durations: Dict[str, float]) -> None:
    """Sorts tests by how long their files take; the order within a file stays.

    Each worker has to come to the same order, so it depends on the list only.
    """
    items.sort(key=lambda item: -durations.get(file_of(item.nodeid), UNKNOWN))


def clock(seconds: float) -> str:
    """Seconds as minutes and seconds."""
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes}:{rest:02d}"


class Progress:
    """Follows a run and prints about it.

    :param durations: expected seconds of each file.
    :param workers: how many files run at once.
    :param target: file into which the measured seconds are written.
    """

    def __init__(self, durations: Dict[str, float], workers: int, target: Path) -> None:
        self._durations = durations
        self._workers = workers
        self._target = target
        self._lock = threading.Lock()  # of what follows
        self._terminal: Any = None
        self._ids: Dict[str, float] = {}  # test -> expected s
        self._running: Dict[str, float] = {}  # test -> since when
        self._taken: Dict[str, float] = {}  # file -> s
        self._finished: Dict[str, None] = {}
        self._failed = 0
        self._skipped = 0
        self._began = time.monotonic()
        self._first: Optional[float] = None  # when the first test began
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._report, name="test progress", daemon=True)

    @pytest.hookimpl(trylast=True)
    def pytest_sessionstart(self, session: pytest.Session) -> None:
        """Begins to print."""
        self._terminal = session.config.pluginmanager.get_plugin("terminalreporter")
        self._thread.start()

    @pytest.hookimpl(tryfirst=True)
    def pytest_report_teststatus(self, report: pytest.TestReport) -> Tuple[str, str, str]:
        """No letters: their place is taken by lines."""
        if report.when == "call" or report.skipped:
            return report.outcome, "", ""
        return ("" if report.passed else "error"), "", ""

    def pytest_collection_finish(self, session: pytest.Session) -> None:
        """Without workers, this process has the tests."""
        if session.items:
            self._expect([item.nodeid for item in session.items])

    @pytest.hookimpl(optionalhook=True)
    def pytest_xdist_node_collection_finished(self, node: Any, ids: List[str]) -> None:
        """Each worker has the same tests."""
        self._expect(ids)

    def _expect(self, ids: List[str]) -> None:
        files: Dict[str, int] = {}
        for each in ids:
            files[file_of(each)] = files.get(file_of(each), 0) + 1
        with self._lock:
            self._ids = {
                each: self._durations.get(file_of(each), UNKNOWN) / files[file_of(each)] for each in ids
            }

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        """A test begins."""
        now = time.monotonic()
        with self._lock:
            self._first = self._first or now
            self._running[nodeid] = now

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """A part of a test has ended; what failed is printed at once."""
        with self._lock:
            name = file_of(report.nodeid)
            self._taken[name] = self._taken.get(name, 0.0) + report.duration
            self._skipped += report.skipped
            self._failed += report.failed
        if report.failed:
            self._show(report)

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        """A file cannot be read, or workers found different tests in it: printed at once."""
        if report.failed:
            with self._lock:
                self._failed += 1
            self._show(report)

    def _show(self, report: Union[pytest.TestReport, pytest.CollectReport]) -> None:
        lines = report.longreprtext.splitlines()
        left_out = len(lines) - MOST_LINES
        if left_out > 0:
            lines = [f"… {left_out} lines are left out here", *lines[-MOST_LINES:]]
        self._write(f"FAILED {report.nodeid}", *lines)

    def pytest_runtest_logfinish(self, nodeid: str) -> None:
        """A test has ended."""
        with self._lock:
            self._running.pop(nodeid, None)
            self._finished[nodeid] = None

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        """Writes the measured durations; failures have been printed."""
        self._ended.set()
        self._thread.join()
        session.config.option.tbstyle = "no"
        self._write("")
        rows = sorted(self._taken.items(), key=lambda row: (-round(row[1], 1), row[0]))
        self._target.parent.mkdir(parents=True, exist_ok=True)
        self._target.write_text("".join(f"{seconds:.1f} {name}\n" for name, seconds in rows))

    def _report(self) -> None:
        while not self._ended.wait(INTERVAL):
            with self._lock:
                line = self.line(time.monotonic())
            self._write(line)

    def line(self, now: float) -> str:
        """How far the run is at a moment of the monotonic clock."""
        counts = f"{len(self._finished)} of {len(self._ids) or '?'} tests, {self._failed} failed"
        if self._skipped:
            counts += f", {self._skipped} skipped"
        parts = [f"{clock(now - self._began)} min: {counts}"]
        done = sum(self._ids.get(each, 0.0) for each in self._finished)
        done += sum(min(now - since, self._ids.get(each, 0.0)) for each, since in self._running.items())
        left = sum(self._ids.values()) - done
        if done > INTERVAL and self._first is not None:
            # A worker has to end the test that it runs, so the longest one is a lower bound.
            estimate = max(left * (now - self._first) / done, self._longest_left(now))
            parts.append(f"about {clock(estimate)} min left")
        if self._running:
            oldest = sorted(self._running.items(), key=lambda row: row[1])[: self._workers]
            parts.append(
                ", ".join(f"{Path(file_of(each)).name} {now - since:.0f} s" for each, since in oldest)
            )
        return "; ".join(parts)

    def _longest_left(self, now: float) -> float:
        left = [self._ids.get(each, 0.0) - (now - since) for each, since in self._running.items()]
        return max([0.0, *left])

    def _write(self, *lines: str) -> None:
        if self._terminal is not None:
            for line in lines:
                self._terminal.write_line(line)
            self._terminal.flush()  # into a file or a pipe, lines would wait for others
