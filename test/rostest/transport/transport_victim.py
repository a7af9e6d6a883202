# SPDX-License-Identifier: Apache-2.0
"""Processes that the tests of the transport kill and stop."""

import subprocess
import sys
from pathlib import Path


def start_victim(name: str = "victim_server", *arguments: str) -> subprocess.Popen:
    return subprocess.Popen([sys.executable, str(Path(__file__).with_name(f"{name}.py")), *arguments])
