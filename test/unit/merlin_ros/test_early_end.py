# SPDX-License-Identifier: Apache-2.0
"""An executable that gets a signal while it starts ends without a traceback, at whatever moment."""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from merlin_test import LONG

pytestmark = pytest.mark.processes

ROOT = Path(__file__).parents[3]
DOMAIN = ROOT / "pddl" / "home" / "domain.pddl"
EXECUTABLES = [
    ("merlin_rosplan", "planning_system"),
    ("merlin_rosplan", "knowledge_base"),
    ("merlin_rosplan", "planner_interface"),
    ("merlin_rosplan", "plan_dispatcher"),
    ("merlin_reactive", "navigation"),
    ("merlin_monitor", "monitor"),
]
ENDED = {signal.SIGINT: 0, signal.SIGTERM: 128 + signal.SIGTERM}
MOMENTS = 2.5  # s after the first import within which it gets the signal
# A node ends itself by force after seconds, which a busy machine may need: here only one that hangs does.
PATIENT = f"""
import threading
start = threading.Timer.start
def patient(timer):
    if timer.name == "end limit":
        timer.interval = {LONG}
    start(timer)
threading.Timer.start = patient
"""
SCRIPTS = sorted(
    path
    for folder in ("src", "extras", "examples")
    for path in (ROOT / folder).glob("**/scripts/*")
    if path.is_file() and path.read_text(encoding="utf-8").startswith("#!/usr/bin/env python3")
)
#: Ctrl-C at the first import of ours that is not of how the executable starts.
INTERRUPTED = """
import os, signal, sys
class Finder:
    def find_spec(self, name, path=None, target=None):
        if name.startswith("merlin") and name not in (
            "merlin_ros", "merlin_ros.lean_start", "merlin_ros.early_end"
        ):
            sys.meta_path.remove(self)
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Finder())
"""


def wait_until_signals_are_handled(process: Any) -> None:
    """Until SIGTERM is handled; before that nothing of ours has run."""
    end = time.monotonic() + LONG
    while time.monotonic() < end:
        for line in Path(f"/proc/{process.pid}/status").read_text().splitlines():
            if line.startswith("SigCgt") and int(line.split()[1], 16) >> (signal.SIGTERM - 1) & 1:
                return
        time.sleep(0.002)
    raise AssertionError("it never handled SIGTERM")


@pytest.mark.parametrize(
    ("package", "executable", "number"),
    [
        pytest.param(*executable, number, marks=[pytest.mark.long] if count % 2 else [])
        for number in (signal.SIGINT, signal.SIGTERM)
        for count, executable in enumerate(EXECUTABLES, number == signal.SIGTERM)
    ],
)
def test_it_ends_without_a_traceback(
    master: Any, tmp_path: Path, package: str, executable: str, number: int
) -> None:
    (tmp_path / "sitecustomize.py").write_text(PATIENT)
    master.env["PYTHONPATH"] = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    for scope in ("rosplan_knowledge_base", "knowledge_base"):
        master.api.setParam("/test", f"/{scope}/domain_path", str(DOMAIN))
    devel = os.environ["CMAKE_PREFIX_PATH"].split(":")[0]
    node = master.spawn(f"{devel}/lib/{package}/{executable}")
    wait_until_signals_are_handled(node.process)
    moment = random.uniform(0.0, MOMENTS)
    time.sleep(moment)  # the moment is what is tried
    code = node.end(number)
    assert "Traceback" not in node.output, f"signal after {moment:.2f} s:\n{node.output}"
    assert "by force" not in node.output, f"signal after {moment:.2f} s:\n{node.output}"
    assert code == ENDED[number], f"signal after {moment:.2f} s:\n{node.output}"


@pytest.mark.everywhere
@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: f"{path.parts[-3]}/{path.name}")
def test_an_executable_that_is_interrupted_while_it_imports_ends_quietly(
    script: Path, tmp_path: Path
) -> None:
    (tmp_path / "sitecustomize.py").write_text(INTERRUPTED)
    own = script.parents[1] / "src" if "examples" in script.parts else tmp_path  # they need no build
    path = os.pathsep.join([str(tmp_path), str(own), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, str(script), "--help"],
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
    )
    assert (done.stdout, done.stderr) == ("", "")
    assert done.returncode in (0, -signal.SIGINT)
