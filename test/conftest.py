# SPDX-License-Identifier: Apache-2.0
"""Lets pytest collect rostest suites: every ``*.test`` file runs under its own master.

Those whose name ends in ``_long`` are marked as long.
"""

import atexit
import contextlib
import fcntl
import gc
import itertools
import os
import shutil
import signal
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any, Dict, Generator, Iterator, List, Tuple

import pytest
from hypothesis import HealthCheck, settings
from hypothesis.internal.conjecture import providers
from hypothesis.internal.scrutineer import SITE_PACKAGES_DIRS

from merlin.local_names import launch_tool, use_loopback

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "bench"))  # tools, not part of the robot

from chaos.under_test import processes

from merlin_test.compiled_tests import compile_tests
from merlin_test.failure_texts import ends_of_logs
from merlin_test.progress import Progress, longest_first, read_durations

# A busy machine is slow, not wrong; how fast things are is for bench/ to say. The same examples each time:
# a change is judged by what it changes. make soak looks for others.
PATIENT: Dict[str, Any] = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow]}
settings.register_profile("merlin", derandomize=True, **PATIENT)
settings.register_profile("search", **PATIENT)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "merlin"))
# Hypothesis tries the constants of modules that are loaded, and these differ from worker to worker: with
# them no two runs would try the same. Only a search has those of our modules; Debian's and those made of
# messages are a thousand more for each worker to read.
if settings().derandomize:
    providers.is_local_module_file = lambda path: False  # to ask where each module is takes 0.3 s
else:
    SITE_PACKAGES_DIRS.update(Path(each).resolve() for each in sys.path if each.endswith("-packages"))

#: What another workspace, or the robot that the user works with, has set in this shell; and what has the
#: processes of tests print at once and compile what they import, unlike those of a user.
FOREIGN = (
    "ROS_IP",
    "ROS_HOSTNAME",
    "ROS_NAMESPACE",
    "ROS_LOG_DIR",
    "ROSCONSOLE_FORMAT",
    "ROSCONSOLE_CONFIG_FILE",
    "PYTHONUNBUFFERED",
    "PYTHONDONTWRITEBYTECODE",
)

LIMIT = 1300.0  # s, below that of pytest.ini, so that the processes of the suite are ended here
#: How long each file of tests takes; ``make test`` writes a new list into results/test/durations.txt.
DURATIONS = Path(__file__).parent / "durations.txt"


def pytest_addoption(parser: pytest.Parser) -> None:
    """An option of ``make test``."""
    parser.addoption("--progress", action="store_true", help="lines with an estimate; failures at once")


def pytest_configure(config: pytest.Config) -> None:
    """Tests begin as in a new shell; where the machine's names have no addresses, they run on 127.0.0.1.

    A shell starts what is in the background deaf to Ctrl-C, and so would be every process of the tests.
    Processes of tests buffer what they print, as a user's do: one that is awaited has to flush.
    """
    if config.getoption("progress") and not hasattr(config, "workerinput"):
        target = Path(config.rootpath) / "results" / "test" / "durations.txt"
        workers = config.getoption("numprocesses", None) or 1
        config.pluginmanager.register(Progress(read_durations(DURATIONS), workers, target))
    for name in FOREIGN:
        os.environ.pop(name, None)
    # Else each process of a test compiles all messages, again and again.
    sys.dont_write_bytecode = False
    if hasattr(config, "workerinput"):
        # Python would look through all that was collected, and kairos' bindings would print what is left.
        atexit.register(os._exit, 0)
    else:
        os.environ[processes.SUITE_MARK] = str(os.getpid())
    if config.getoption("numprocesses", None):
        compile_tests(config, (Path(each.split("::", 1)[0]) for each in config.args))
    use_loopback()
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """What is collected stays: the search for garbage need not look at it again and again."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_unconfigure(config: pytest.Config) -> None:
    """No process outlives an interrupted run; without the rest kairos' bindings would print what is left."""
    if not hasattr(config, "workerinput"):
        processes.kill_marked(str(os.getpid()), processes.SUITE_MARK)
        gc.unfreeze()  # a worker ends before they can


def pytest_collection_modifyitems(config: pytest.Config, items: List[pytest.Item]) -> None:
    """Begins with the files that take longest."""
    if config.getoption("progress"):
        longest_first(items, read_durations(DURATIONS))


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> "RosTestFile":
    """Collects launch files that end in .test."""
    if file_path.suffix == ".test":
        return RosTestFile.from_parent(parent, path=file_path)
    return None


class RosTestFile(pytest.File):
    """One rostest launch file."""

    def collect(self) -> Iterator[pytest.Item]:
        """One item: a launch file starts its processes once for all its cases."""
        item = RosTestItem.from_parent(self, name=self.path.stem)
        if self.path.stem.endswith("_long"):
            item.add_marker(pytest.mark.long)
        yield item


class RosTestFailure(Exception):
    """A rostest suite that failed; carries what it printed."""


class RosTestItem(pytest.Item):
    """Runs one rostest suite in a session of its own and fails with what it printed."""

    def runtest(self) -> None:
        """Runs the suite in a folder of its own; whatever it leaves behind is killed."""
        with _own(Path(self.config.rootpath) / "results" / "test" / self.name) as home:
            self._run(home)

    def _run(self, home: Path) -> None:
        env = dict(os.environ, ROS_HOME=str(home), ROS_LOG_DIR=str(home / "log"))
        env[processes.MARK] = f"{os.getpid()}.{self.name}"
        env.pop("ROS_MASTER_URI", None)
        results = home / "test_results"
        env["ROS_TEST_RESULTS_DIR"] = str(results)
        for old in results.glob("**/*.xml"):
            old.unlink()
        # What a robot keeps for good would be there for the suite's next run.
        shutil.rmtree(str(home / "merlin"), ignore_errors=True)
        process = subprocess.Popen(
            [*launch_tool("rostest"), str(self.path)],
            env=env,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            start_new_session=True,
        )
        try:
            output, _ = process.communicate(timeout=LIMIT)
        except subprocess.TimeoutExpired:
            raise RosTestFailure(f"no end after {LIMIT:.0f} s\n{_stopped(process)[-8000:]}") from None
        finally:
            # Its nodes have sessions of their own, and outlive it when it is killed.
            processes.kill_marked(env[processes.MARK])
        cases, failed = _read(results)
        if process.returncode or failed or not cases:
            counts = f"exit code {process.returncode}, {cases} cases, {len(failed)} failed"
            raise RosTestFailure("\n".join([counts, *failed, output[-12000:], *ends_of_logs(home / "log")]))

    def repr_failure(self, excinfo: pytest.ExceptionInfo) -> str:
        """What the suite printed is the whole story."""
        if isinstance(excinfo.value, RosTestFailure):
            return f"rostest {self.path}: {excinfo.value}"
        return str(super().repr_failure(excinfo))

    def reportinfo(self) -> tuple:
        """Where the suite is."""
        return self.path, None, f"rostest {self.path.name}"


@contextlib.contextmanager
def _own(wanted: Path) -> Iterator[Path]:
    """The folder of a suite; while another run has it, one beside it, ``<suite>.2``."""
    for number in itertools.count(1):
        folder = wanted if number == 1 else wanted.with_name(f"{wanted.name}.{number}")
        folder.mkdir(parents=True, exist_ok=True)
        with (folder / "in_use").open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            yield folder
            return


def _read(results: Path) -> Tuple[int, List[str]]:
    """How many cases a suite has run, and each that failed with its text."""
    cases: int = 0
    failed: List[str] = []
    for report in results.glob("**/*.xml"):
        try:
            root = ElementTree.parse(str(report)).getroot()
        except ElementTree.ParseError:  # it was killed while it wrote, and its output says why
            failed.append(f"{report.name} is cut off")
            continue
        cases += sum(int(suite.get("tests", 0)) for suite in root.iter("testsuite"))
        for case in root.iter("testcase"):
            texts = [(found.text or "").strip() for found in (*case.iter("failure"), *case.iter("error"))]
            failed += [f"{case.get('classname')}.{case.get('name')}: {text}" for text in texts]
    return cases, failed


def _stopped(process: subprocess.Popen) -> str:
    """Ends a suite as Ctrl-C does; returns what it printed."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGINT)
    try:
        return str(process.communicate(timeout=15)[0])
    except subprocess.TimeoutExpired:
        process.kill()
        return str(process.communicate()[0])
