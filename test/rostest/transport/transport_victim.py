# SPDX-License-Identifier: Apache-2.0
"""Processes that the tests of the transport kill and stop."""

import subprocess
from pathlib import Path

from merlin_test.node_path import lean_script


def start_victim(name: str = "victim_server", *arguments: str) -> subprocess.Popen:
    return subprocess.Popen(lean_script(Path(__file__).with_name(f"{name}.py"), *arguments))
