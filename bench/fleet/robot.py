# SPDX-License-Identifier: Apache-2.0
"""A robot of the demonstration: a whole MERLIN on simulated servers with a master of its own."""

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Callable, Dict, List, Optional

from chaos.judging.events import Event
from chaos.under_test.child import Child
from chaos.under_test.processes import MARK, marked, node_pid, send

HERE = Path(__file__).parent


class Robot:
    """Starts it.

    :param name: of the robot.
    :param arguments: of robot.launch.
    :param inside: puts a command line where the robot is.
    :param port: of its master.
    :param folder: takes its logs.
    :param on_event: told what its Executor does, in a thread of its own.
    :param environment: further variables of its processes.
    """

    def __init__(
        self,
        name: str,
        arguments: List[str],
        inside: Callable[[List[str]], List[str]],
        port: int,
        folder: Path,
        on_event: Callable[[Event], None],
        environment: Optional[Dict[str, str]] = None,
    ) -> None:
        self.name = name
        self.alive = True
        self._run = f"fleet{os.getpid()}_{name}"
        logs = folder / name
        logs.mkdir(exist_ok=True)
        address = {"ROS_MASTER_URI": f"http://127.0.0.1:{port}", "ROS_IP": "127.0.0.1"}
        env: Dict[str, str] = dict(os.environ, ROS_LOG_DIR=str(logs), ROS_HOME=str(logs), **address)
        env[MARK] = self._run
        env.pop("ROS_HOSTNAME", None)
        command = inside(["roslaunch", "-p", str(port), str(HERE / "robot.launch"), *arguments])
        self._witness: Optional[Child] = None
        with (logs / "roslaunch").open("ab") as log:
            self._launch = subprocess.Popen(
                command, env={**env, **(environment or {})}, stdout=log, stderr=log, start_new_session=True
            )
        command = inside([sys.executable, str(HERE / "witness.py")])
        self._witness = Child(f"witness_{name}", command, env, folder, on_event)

    @property
    def running(self) -> bool:
        """Whether its launch has not ended."""
        return self._launch.poll() is None

    def send(self, number: int, node: str = "") -> None:
        """Sends a signal to its processes; what looks at it beside them continues.

        :param node: only to this node's process, not to what starts it again.
        """
        assert self._witness is not None
        if node:
            pid = node_pid(self._run, node, [self._launch.pid])
            pids = set() if pid is None else {pid}
        else:
            pids = set(marked(self._run)) - {self._witness.process.pid}
        for pid in pids:
            send(pid, number)

    def forget(self) -> None:
        """Makes every room unchecked; what looks at it says when that is done."""
        assert self._witness is not None
        self._witness.tell(forget=True)

    def kill(self) -> None:
        """Ends all of its processes at once, as its battery does."""
        self.alive = False
        for _ in range(3):  # one of them may have begun another one meanwhile
            for pid in marked(self._run):
                try:
                    os.kill(pid, signal.SIGKILL)
                except ProcessLookupError:
                    continue
        self._launch.wait()

    def close(self) -> None:
        """Ends it."""
        self.kill()
        if self._witness is not None:
            self._witness.close()
