# SPDX-License-Identifier: Apache-2.0
"""A run of `rosrun merlin run` in a process of its own, and what is left of it."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Dict, List, Tuple

from merlin_test.node_path import LEAN

LIMIT = 200.0  # s for a run to end
MAIN = "raise SystemExit(supervision.main())"
RUN = f"{LEAN}from merlin import supervision; {MAIN}"


class Run:
    """One run in a session of its own."""

    def __init__(self, tmp_path: Path, *words: str, code: str = RUN, **variables: str) -> None:
        env = {**os.environ, "ROS_HOME": str(tmp_path), "ROS_LOG_DIR": str(tmp_path / "log"), **variables}
        env.pop("ROS_MASTER_URI", None)
        self._mark = f"MERLIN_TEST={tmp_path}"
        env["MERLIN_TEST"] = str(tmp_path)
        self.process = subprocess.Popen(
            [sys.executable, "-c", code, *words],
            env=env,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def end(self) -> Tuple[int, List[str], List[str]]:
        """Exit code, lines of standard output, lines of standard error."""
        out, err = self.process.communicate(timeout=LIMIT)
        return self.process.returncode, out.splitlines(), err.splitlines()

    def read_until(self, text: str) -> str:
        """Reads standard output up to the line that holds the text."""
        for line in self.process.stdout:
            if text in line:
                return line
        raise AssertionError(f"'{text}' never came: {self.process.communicate()}")

    def left(self) -> List[str]:
        """Command lines of living processes that inherited this run's environment."""
        return list(self.living().values())

    def living(self) -> Dict[int, str]:
        """The same by process."""
        found = {}
        for folder in Path("/proc").glob("[0-9]*"):
            with contextlib.suppress(OSError):  # ended meanwhile
                if self._mark.encode() in (folder / "environ").read_bytes():
                    found[int(folder.name)] = (folder / "cmdline").read_text().replace("\0", " ")
        return found

    def kill_wrapper(self) -> None:
        """Kills the one that runs, as soon as it does.

        A subshell of the script has the same command line, and the runner for its parent when the script was
        killed, but the script's session.
        """
        until, runner = time.monotonic() + LIMIT, self.runner()
        while time.monotonic() < until:
            for process, command in self.living().items():
                found = command.startswith("/bin/sh") and "/respawn" in command
                if found and parent_of(process) == runner and session_of(process) == process:
                    os.kill(process, signal.SIGKILL)
                    return
            time.sleep(0.05)
        raise AssertionError("no wrapper runs")

    def runner(self) -> int:
        """The child that carries out the run."""
        return int(Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children").read_text().split()[0])


def parent_of(process: int) -> int:
    """Process id of the parent; 0: the process has ended."""
    with contextlib.suppress(OSError):
        return int(Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[1])
    return 0


def session_of(process: int) -> int:
    """Process id of the leader of the session; 0: the process has ended."""
    with contextlib.suppress(OSError):
        return os.getsid(process)
    return 0
