"""A planner as a child process: in a group of its own, killed with everything it started."""

import contextlib
import os
import signal
import subprocess
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import List, Optional

MAX_OUTPUT = 64 * 1024 * 1024  # bytes of output that are read; a planner gone mad must not fill the memory


@dataclass(frozen=True)
class ProcessResult:
    """How a process ended.

    Parameters
    ----------
    returncode: exit code, or minus the signal that killed it.
    timed_out: it was killed because its time was over.
    cancelled: it was killed because somebody asked for it.
    seconds: of wall time.
    """

    returncode: int
    stdout: str
    stderr: str
    timed_out: bool
    cancelled: bool
    seconds: float


class PlannerProcess:
    """Runs one command once; :meth:`cancel` ends it from any thread, before or while it runs.

    Parameters
    ----------
    command: program and arguments.
    directory: where it runs and where its output is kept; must exist.
    limit: wall time after which it is killed, s; 0 means never.
    """

    def __init__(self, command: List[str], directory: Path, limit: float = 0.0) -> None:
        self._command = command
        self._directory = directory
        self._limit = limit
        self._lock = threading.Lock()  # guards the fields below; a kill never meets a reaped process
        self._process: Optional[subprocess.Popen] = None
        self._timed_out = False
        self._cancelled = False

    def cancel(self) -> None:
        """Kills it at once; if it has not started yet, it never will."""
        with self._lock:
            self._cancelled = True
            self._kill()

    def run(self) -> ProcessResult:
        """Runs the command to its end, however that comes.

        Raises
        ------
        OSError: the program cannot be started.
        """
        started = time.monotonic()
        # Files and no pipes: a grandchild that keeps a pipe open would keep us waiting.
        output, errors = self._directory / "stdout.txt", self._directory / "stderr.txt"
        with output.open("wb") as out, errors.open("wb") as err:
            with self._lock:
                if self._cancelled:
                    return ProcessResult(-signal.SIGKILL, "", "", False, True, 0.0)
                self._process = subprocess.Popen(
                    self._command,
                    cwd=str(self._directory),
                    stdin=subprocess.DEVNULL,
                    stdout=out,
                    stderr=err,
                    start_new_session=True,
                )
            timer = threading.Timer(self._limit, self._time_out) if self._limit > 0 else None
            if timer is not None:
                timer.name = "planner limit"
                timer.daemon = True
                timer.start()
            # A wait with a time-out would poll, and waiting before the group is dead would free its number.
            os.waitid(os.P_PID, self._process.pid, os.WEXITED | os.WNOWAIT)
            with self._lock:
                self._kill()
                returncode = self._process.wait()
                self._process = None
            if timer is not None:
                timer.cancel()
        return ProcessResult(
            returncode,
            _read(output),
            _read(errors),
            self._timed_out,
            self._cancelled,
            time.monotonic() - started,
        )

    def _time_out(self) -> None:
        with self._lock:
            if self._process is not None:
                self._timed_out = True
                self._kill()

    def _kill(self) -> None:
        if self._process is not None:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(self._process.pid, signal.SIGKILL)


def _read(path: Path) -> str:
    with path.open("rb") as file:
        return file.read(MAX_OUTPUT).decode(errors="replace")
