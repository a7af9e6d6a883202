# SPDX-License-Identifier: Apache-2.0
"""Unit tests over a package of which one module is changed. The change is made in a copy of the package."""

import contextlib
import multiprocessing
import os
import shutil
import signal
import sys
import time
from pathlib import Path
from typing import Dict, Iterable, List, Optional, Sequence, Tuple

import hypothesis  # noqa: F401  it takes as long to import as most tests run
import pytest
from chaos.under_test.processes import MARK, kill_marked

from mutants.changes import Mutant

#: Test files of a module that are looked at.
MOST_FILES = 10
#: A mutant may take this many times as long as the unchanged module, and these seconds more.
PATIENCE, GRACE = 3.0, 10.0
#: How a mutant ends. One that hangs would be noticed; one without tests would not.
KILLED, HUNG, SURVIVED, UNTESTED = "killed", "hung", "survived", "no test"
#: A child that has pytest imported begins in a fifth of the time of a new process. It imports MERLIN itself.
_FORK = multiprocessing.get_context("fork")


class Bench:
    """A copy of one package at a time, which tests import instead of the package."""

    def __init__(self, folder: Path, root: Path) -> None:
        self._folder, self._root = folder, root
        self._seconds: Dict[Path, Optional[float]] = {}
        #: s that pytest takes without a test.
        self.begin = self._timed(["--co", "test/unit/conftest.py"], 60.0)[1]

    def run(self, mutant: Mutant, tests: Sequence[Path]) -> Tuple[str, float]:
        """What the tests make of a mutant, and the seconds that they took."""
        package = mutant.module
        while package.parent.name != "src":
            package = package.parent
        copy = self._folder / package.name
        if not copy.exists():
            shutil.copytree(str(package), str(copy))
        changed = copy / mutant.module.relative_to(package)
        for compiled in changed.parent.glob(f"__pycache__/{changed.stem}.*"):
            compiled.unlink()  # the changed text may have the size and the second of the present one
        try:
            changed.write_text(mutant.text, encoding="utf-8")
            code, seconds = self._timed(tests, PATIENCE * self.time_of(tests) + GRACE)
        finally:
            shutil.copy2(str(mutant.module), str(changed))
        return {0: SURVIVED, None: HUNG}.get(code, KILLED), seconds

    def chosen(self, tests: Sequence[Path], seconds: float) -> List[Path]:
        """The first of these test files that pass without a change and together take no longer."""
        chosen: List[Path] = []
        for test in tests[:MOST_FILES]:
            if test not in self._seconds:
                code, taken = self._timed([test], seconds + self.begin)
                self._seconds[test] = max(0.0, taken - self.begin) if code == 0 else None
            if self._seconds[test] is not None and self.time_of([*chosen, test]) <= seconds + self.begin:
                chosen.append(test)
        return chosen

    def time_of(self, tests: Iterable[Path]) -> float:
        """Seconds that these files take without a change."""
        return self.begin + sum(self._seconds[test] or 0.0 for test in tests)

    def _timed(self, tests: Sequence[object], limit: float) -> Tuple[Optional[int], float]:
        """Exit code of the tests, None: not within the limit; and the seconds that they took."""
        run = f"mutants.{os.getpid()}"
        child = _FORK.Process(target=self._pytest, args=(list(map(str, tests)), run))
        begin = time.monotonic()
        child.start()
        assert child.pid is not None  # it has started
        try:
            child.join(limit)
            code = child.exitcode
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(child.pid, signal.SIGKILL)
            child.kill()  # it may not have a session yet
            child.join()
            kill_marked(run)
        return code, time.monotonic() - begin

    def _pytest(self, arguments: List[str], run: str) -> None:
        os.setsid()  # Ctrl-C is for the process that counts
        path = [str(self._folder), *os.environ.get("PYTHONPATH", "").split(os.pathsep)]
        os.environ.update({"PYTHONPATH": os.pathsep.join(path), "PYTHONDONTWRITEBYTECODE": "1", MARK: run})
        sys.path[:0], sys.dont_write_bytecode = path, True
        os.chdir(self._root)
        for stream in (0, 1, 2):
            os.dup2(os.open(os.devnull, os.O_RDWR), stream)
        sys.exit(pytest.main(["-x", *arguments]))
