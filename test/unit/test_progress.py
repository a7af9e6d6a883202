# SPDX-License-Identifier: Apache-2.0
"""A run of many tests: its estimate, each failure at once, what it keeps, and which examples it tries."""

import importlib.util
import os
import sys
import time
from pathlib import Path
from types import ModuleType
from typing import List

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from merlin_test.compiled_tests import compile_tests
from merlin_test.progress import Progress, longest_first, read_durations

FILES = {"a_test.py": 10.0, "b_test.py": 30.0}


class Screen:
    def __init__(self) -> None:
        self.lines: List[str] = []

    def write_line(self, line: str) -> None:
        self.lines.append(line)

    def flush(self) -> None:
        pass


class Session:
    """As much of pytest's session as the plugin looks at."""

    def __init__(self, ids: List[str]) -> None:
        self.screen = Screen()
        self.items = [Item(each) for each in ids]
        self.config = self.pluginmanager = self.option = self
        self.tbstyle = "auto"

    def get_plugin(self, name: str) -> Screen:
        return self.screen


class Item:
    def __init__(self, nodeid: str) -> None:
        self.nodeid = nodeid


def report(nodeid: str, outcome: str, text: str = "") -> pytest.TestReport:
    return pytest.TestReport(nodeid, ("", 0, ""), {}, outcome, text, "call", duration=2.0)


@pytest.fixture
def session(tmp_path: Path) -> Session:
    return Session(["a_test.py::one", "a_test.py::two", "b_test.py::three"])


@pytest.fixture
def progress(session: Session, tmp_path: Path) -> Progress:
    made = Progress(FILES, 2, tmp_path / "new" / "durations.txt")
    made.pytest_sessionstart(session)
    made.pytest_collection_finish(session)
    return made


def test_a_line_has_counts_an_estimate_and_what_runs(progress: Progress, session: Session) -> None:
    progress.pytest_runtest_logstart("b_test.py::three")
    now = time.monotonic()
    assert "0 of 3 tests, 0 failed" in progress.line(now)
    assert "left" not in progress.line(now), "nothing to go by yet"
    later = progress.line(now + 25)
    assert "b_test.py 25 s" in later
    # 25 s of 40 are done by one worker in 25 s.
    assert "about 0:15 min left" in later
    # What takes longer than it should says nothing about the others.
    assert "about 0:20 min left" in progress.line(now + 60)
    progress.pytest_sessionfinish(session)


def test_a_failure_is_shown_when_it_happens(progress: Progress, session: Session) -> None:
    progress.pytest_runtest_logstart("a_test.py::one")
    progress.pytest_runtest_logreport(report("a_test.py::one", "failed", "first\nlast"))
    assert session.screen.lines == ["FAILED a_test.py::one", "first", "last"]
    progress.pytest_runtest_logfinish("a_test.py::one")
    progress.pytest_runtest_logreport(report("a_test.py::two", "skipped"))
    progress.pytest_runtest_logfinish("a_test.py::two")
    assert "2 of 3 tests, 1 failed, 1 skipped" in progress.line(time.monotonic())
    progress.pytest_sessionfinish(session)
    assert session.tbstyle == "no", "pytest shows it again at the end otherwise"


def test_the_measured_durations_are_kept(progress: Progress, session: Session, tmp_path: Path) -> None:
    progress.pytest_runtest_logreport(report("a_test.py::one", "passed"))
    progress.pytest_runtest_logreport(report("b_test.py::three", "passed"))
    progress.pytest_runtest_logreport(report("b_test.py::three", "passed"))
    progress.pytest_sessionfinish(session)
    assert read_durations(tmp_path / "new" / "durations.txt") == {"b_test.py": 4.0, "a_test.py": 2.0}


def test_the_longest_files_come_first_and_stay_whole() -> None:
    items = [Item(each) for each in ("a_test.py::one", "new_test.py::x", "b_test.py::z", "a_test.py::two")]
    longest_first(items, FILES)  # type: ignore[arg-type]
    assert [item.nodeid.split("::")[1] for item in items] == ["z", "one", "two", "x"]


def test_a_file_that_cannot_be_read_is_shown_at_once(progress: Progress, session: Session) -> None:
    progress.pytest_collectreport(pytest.CollectReport("c_test.py", "failed", "no such module", []))
    assert session.screen.lines[-2:] == ["FAILED c_test.py", "no such module"]
    assert "1 failed" in progress.line(time.monotonic())


@pytest.mark.everywhere
def test_what_is_compiled_is_kept_for_other_workers_and_the_next_run() -> None:
    assert not sys.dont_write_bytecode
    assert "PYTHONDONTWRITEBYTECODE" not in os.environ


def test_workers_find_tests_compiled(tmp_path: Path, request: pytest.FixtureRequest) -> None:
    test = tmp_path / "part" / "test_a.py"
    test.parent.mkdir()
    test.write_text("assert (value := 3) == 3\n", encoding="utf-8")
    wrong = tmp_path / "test_wrong.py"
    wrong.write_text("def\n", encoding="utf-8")
    compile_tests(request.config, [tmp_path])
    (compiled,) = tmp_path.rglob("*.pyc")
    before = compiled.stat()
    hook = request.config.pluginmanager.rewrite_hook
    spec = importlib.util.spec_from_file_location("test_a_compiled", test, loader=hook)
    module = importlib.util.module_from_spec(spec)
    hook.exec_module(module)
    assert module.value == 3
    assert compiled.stat() == before, "pytest has compiled it anew"
    test.write_text("value = 4\n", encoding="utf-8")
    compile_tests(request.config, [test])
    (compiled,) = tmp_path.rglob("*.pyc")
    assert compiled.stat().st_ino != before.st_ino


@pytest.mark.skipif(not settings().derandomize, reason="this run searches other examples")
def test_a_module_that_is_loaded_changes_no_example(monkeypatch: pytest.MonkeyPatch) -> None:
    tried: List[object] = []

    @given(st.one_of(st.integers(), st.floats(), st.text()))
    @settings(max_examples=300)
    def run(value: object) -> None:
        tried.append(repr(value))

    run()
    before, tried[:] = list(tried), []
    loaded = ModuleType("loaded meanwhile")
    loaded.__file__ = str(Path(__file__).parents[2] / "bench" / "chaos" / "table.py")
    monkeypatch.setitem(sys.modules, loaded.__name__, loaded)
    run()
    assert tried == before
