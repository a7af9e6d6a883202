#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Takes the monitor's pictures of the documentation, over a running home mission: `make screenshots`.

Usage: tools/in_workspace.sh python tools/monitor_screenshots.py [folder, default docs/images]
"""

import contextlib
import os
import re
import secrets
import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, Dict, Iterator

from merlin_monitor.access.operators import write_operators
from merlin_test.chromium import Visit, chromium

ROOT = Path(__file__).resolve().parent.parent
DESKTOP = {"width": 1360, "height": 1130}
PICTURES: Dict[str, Dict[str, Any]] = {
    "monitor.png": {"viewport": DESKTOP},
    "monitor-dark.png": {"viewport": DESKTOP, "color_scheme": "dark"},
    "monitor-laptop.png": {"viewport": {"width": 1440, "height": 900}},
    "monitor-phone.png": {"viewport": {"width": 390, "height": 844}, "device_scale_factor": 2},
}
DRIVING = """() => {
  const chain = document.getElementById("now-chain").textContent;
  return /task ([3-9]|1.) of/.test(chain) && chain.includes("DRIVE")
    && document.querySelectorAll(".node.active").length >= 2;
}"""
LIMIT = 240.0  # s for the mission to get where the pictures are taken
HELD = "monitor-held.png"  # taken on the phone, after a press of the button
STOP = 20.0  # s for the mission to end


def main() -> int:
    """Runs a mission and takes the pictures; returns the exit code."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs" / "images"
    folder.mkdir(parents=True, exist_ok=True)
    token = secrets.token_urlsafe()
    with tempfile.TemporaryDirectory(prefix="merlin_screenshots_") as results:
        write_operators(Path(results, "merlin", "operators.yaml"), {"Ana": token})
        with page_of("home.launch", "tasks:=20", "rtf:=1", results=results) as address, chromium() as browser:
            visits = {name: Visit(browser, address, **options) for name, options in PICTURES.items()}
            for visit in visits.values():
                visit.page.click("#operator")
                visit.page.fill("#token", token)
                visit.page.keyboard.press("Enter")
                visit.wait_text("#operator", "Ana")
            for name, visit in visits.items():
                # On the way to a later task's place, so that there is something to look back at.
                visit.wait(DRIVING, limit=LIMIT)
                visit.page.screenshot(path=folder / name)
                print(folder / name)
            visit.page.click("#stop")
            visit.wait_text("#now-doing", "stopped and held")
            visit.page.screenshot(path=folder / HELD)
            print(folder / HELD)
    return 0


@contextlib.contextmanager
def page_of(*words: str, results: str) -> Iterator[str]:
    """The address of the page of an application, which runs meanwhile.

    :param words: of `rosrun merlin run`.
    :param results: folder of all that it writes.
    :raises RuntimeError: it has ended without a page.
    """
    mission = subprocess.Popen(
        ["rosrun", "merlin", "run", *words, f"results:={results}/results"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env={**os.environ, "ROS_HOME": results},
    )
    try:
        yield _address(mission)
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(mission.pid, signal.SIGINT)
        try:
            mission.wait(STOP)
        except subprocess.TimeoutExpired:
            os.killpg(mission.pid, signal.SIGKILL)
            mission.wait()


def _address(mission: "subprocess.Popen[str]") -> str:
    assert mission.stderr is not None
    for line in mission.stderr:
        found = re.match(r"monitor: (http\S+)", line)
        if found:
            return found.group(1)
    raise RuntimeError("the mission has ended without a monitor")


if __name__ == "__main__":
    raise SystemExit(main())
