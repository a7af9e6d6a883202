"""A planner as a child process, in a group of its own, with files for its output."""

import contextlib
import os
import signal
import subprocess
import threading
import time
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
    :param seconds: of running time.
    """

    returncode: int
    stdout: str
    stderr: str
    timed_out: bool
    stopped: bool
    seconds: float


class PlannerProcess:
    """Runs one command once; :meth:`stop` ends it from any thread, before or while it runs.

    Only its process group is killed here. The supervising process ends what has left the group
    (:mod:`merlin_rosplan.supervision.planner_supervisor`), and sets the limits of memory and files.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()  # guards the fields below; a kill never meets a reaped process
        self._process: Optional[subprocess.Popen[bytes]] = None
        self._timed_out = False
        self._stopped = False

    def stop(self) -> None:
        """Kills it at once; if it has not started yet, it never will."""
        with self._lock:
            self._stopped = True
            self._kill()

    def run(self, command: List[str], directory: Path, limit: float = 0.0) -> ProcessResult:
        """Runs the command to its end, however that comes.

        :param command: program and arguments.
        :param directory: where it runs and where its output is kept; must exist.
        :param limit: running time after which it is killed, s; 0 means never.
        :raises OSError: the program cannot be started.
        """
        started = time.monotonic()
        # Files and no pipes: a grandchild that keeps a pipe open would keep us waiting.
        output, errors = directory / STDOUT, directory / STDERR
        with output.open("wb") as out, errors.open("wb") as err:
            with self._lock:
                if self._stopped:
                    return ProcessResult(-signal.SIGKILL, "", "", False, True, 0.0)
                self._process = subprocess.Popen(
                    command,
                    cwd=str(directory),
                    stdin=subprocess.DEVNULL,
                    stdout=out,
                    stderr=err,
                    start_new_session=True,
                )
            timer = threading.Timer(limit, self._time_out) if limit > 0 else None
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
            output.read_text(errors="replace"),
            errors.read_text(errors="replace"),
            self._timed_out,
            self._stopped,
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
