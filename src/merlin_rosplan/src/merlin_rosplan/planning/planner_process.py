# SPDX-License-Identifier: Apache-2.0
"""A planner as a child process, in a group of its own, with files for its output."""

import contextlib
import os
import signal
import subprocess
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import List, Optional

from merlin_rosplan.planning.planner_files import STDERR, STDOUT


@dataclass(frozen=True)
class ProcessResult:
    """How a process ended.

    :param returncode: exit code, or minus the signal that killed it.
    :param stdout, stderr: what it printed.
    :param timed_out: it was killed because its time was over.
    :param stopped: it was killed by :meth:`PlannerProcess.stop`.
    """

    returncode: int
    stdout: str
    stderr: str
    timed_out: bool
    stopped: bool


class PlannerProcess:
    """Runs one command once: :meth:`start`, then :meth:`wait`. :meth:`stop` ends it, from any thread.

    Only its process group is killed here. The supervising process ends what has left the group
    (:mod:`merlin_rosplan.supervision.planner_supervisor`), and sets the limits of memory and files.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()  # guards the fields below; a kill never meets a reaped process
        self._process: Optional[subprocess.Popen[bytes]] = None
        self._timed_out = False
        self._stopped = False
        # of the thread that starts it and waits for it
        self._output = self._errors = Path()
        self._timer: Optional[threading.Timer] = None

    def stop(self) -> None:
        """Kills it at once; if it has not started yet, it never will."""
        with self._lock:
            self._stopped = True
            self._kill()

    def start(self, command: List[str], directory: Path, limit: float = 0.0) -> None:
        """Starts the command.

        :param command: program and arguments.
        :param directory: where it runs and where its output is kept; must exist.
        :param limit: running time after which it is killed, s; 0 means never.
        :raises OSError: the program cannot be started.
        """
        # Files and no pipes: a grandchild that keeps a pipe open would keep us waiting.
        self._output, self._errors = directory / STDOUT, directory / STDERR
        with self._output.open("wb") as out, self._errors.open("wb") as err, self._lock:
            if self._stopped:
                return
            self._process = subprocess.Popen(
                command,
                cwd=str(directory),
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=err,
                start_new_session=True,
            )
        if limit > 0:
            self._timer = threading.Timer(limit, self._time_out)
            self._timer.name = "planner limit"
            self._timer.daemon = True
            self._timer.start()

    def wait(self) -> ProcessResult:
        """Waits for the end of the command, however that comes."""
        process = self._process
        if process is None:
            return ProcessResult(-signal.SIGKILL, "", "", False, True)
        # A wait with a time-out would poll, and waiting before the group is dead would free its number.
        os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
        with self._lock:
            self._kill()
            returncode = process.wait()
            self._process = None
        if self._timer is not None:
            self._timer.cancel()
        return ProcessResult(
            returncode,
            self._output.read_text(encoding="utf-8", errors="replace"),
            self._errors.read_text(encoding="utf-8", errors="replace"),
            self._timed_out,
            self._stopped,
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
