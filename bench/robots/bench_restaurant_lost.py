# SPDX-License-Identifier: Apache-2.0
"""Evenings in the restaurant in which one of two robots is killed: how they end, and what becomes of guests.

HOW (host,all) names what is killed of ``robot_2``, MOMENT (order) when; see lose_robot.py. GUESTS (6),
HASTE (1), DISTURBANCES (5), SEED (4) and RTF (3) are those of the evening.
"""

import csv
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, Dict, List

LIMIT = 1500.0  # s of wall time for an evening
RUN = "from merlin.launch_runner import main; raise SystemExit(main())"
LOSE = Path(__file__).with_name("lose_robot.py")
LOST = "robot_2"


def evening(how: str, moment: str, folder: Path, *arguments: str) -> Dict[str, Any]:
    """One evening; what it printed is in ``evening.log`` of the folder.

    :param how, moment: as of lose_robot.py.
    :param arguments: of restaurant.launch.
    """
    folder.mkdir(parents=True, exist_ok=True)
    env = dict(os.environ, ROS_HOME=str(folder / "ros"), ROS_LOG_DIR=str(folder / "ros" / "log"))
    env.pop("ROS_MASTER_URI", None)
    words = ["restaurant.launch", "robots:=robot_1,robot_2", f"results:={folder}", *arguments]
    with open(folder / "evening.log", "w") as log:
        run = subprocess.Popen(
            [sys.executable, "-c", RUN, *words], env=env, stdout=subprocess.PIPE, stderr=log, text=True
        )
        assert run.stdout is not None
        lose = None
        for line in run.stdout:
            log.write(line)
            log.flush()
            if lose is None:  # the mission has begun
                command = [sys.executable, str(LOSE), LOST, "--how", how, "--moment", moment]
                lose = subprocess.Popen(command, env=env, stdout=log, stderr=log)
        code = run.wait(LIMIT)
        lost = lose.wait(LIMIT) if lose is not None else 1
    return {"exit_code": code, "lost": lost == 0, **_outcomes(folder)}


def _rows(file: Path) -> List[Dict[str, str]]:
    if not file.exists():
        return []
    with file.open() as text:
        return list(csv.DictReader(text))


def _outcomes(folder: Path) -> Dict[str, Any]:
    guests, robots = _rows(folder / "guests.csv"), _rows(folder / "robots.csv")
    return {
        "guests": {guest["guest"]: guest["outcome"] for guest in guests},
        "delivered": {robot["robot"]: int(robot["delivered"]) for robot in robots},
    }


def measure() -> Dict[str, Any]:
    """All evenings."""
    ways, moment = os.environ.get("HOW", "host,all").split(","), os.environ.get("MOMENT", "order")
    arguments = [
        f"{name}:={os.environ.get(name.upper(), default)}"
        for name, default in (("guests", 6), ("haste", 1), ("disturbances", 5), ("seed", 4), ("rtf", 3))
    ]
    with tempfile.TemporaryDirectory(prefix="merlin_bench_") as name:
        target = Path(os.environ.get("FOLDER", name))
        return {"restaurant_lost": {how: evening(how, moment, target / how, *arguments) for how in ways}}
