# SPDX-License-Identifier: Apache-2.0
"""`fleet page` as a process, for tests."""

import os
import signal
import subprocess
import sys
from typing import Tuple

from merlin_test import LONG
from merlin_test.node_path import LEAN


class Command:
    """`fleet page` in a process of its own, without a master."""

    def __init__(self, endpoint: str, *arguments: str) -> None:
        program = "import sys; from merlin_fleet.commands.fleet_command import main; sys.exit(main())"
        words = ["page", "--hub", endpoint, "--fleet", "lab", *arguments]
        environment = {**os.environ, "ROS_MASTER_URI": "http://127.0.0.1:1"}
        self.process = subprocess.Popen(
            [sys.executable, "-c", LEAN + program, *words],
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert self.process.stdout is not None
        self.address = self.process.stdout.readline().split(" ")[0]

    def end(self) -> Tuple[int, str]:
        """Ctrl-C; exit code and what it said."""
        self.process.send_signal(signal.SIGINT)
        _, said = self.process.communicate(timeout=LONG)
        return self.process.returncode, said
