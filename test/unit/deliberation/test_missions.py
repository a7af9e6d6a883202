# SPDX-License-Identifier: Apache-2.0
"""One mission for each problem, which the launch file starts by its number."""

import re
from pathlib import Path

from deliberation.mission import Battery, Containers, Doors, Fetch
from deliberation.problems import PROBLEMS

LAUNCH = Path(__file__).resolve().parents[3] / "examples" / "deliberation" / "launch" / "deliberation.launch"


def test_each_problem_has_its_mission() -> None:
    missions = (Fetch, Doors, Containers, Battery)
    assert [kind.number for kind in missions] == list(PROBLEMS)
    named = re.findall(r"'(\d)': '(\w+)'", LAUNCH.read_text(encoding="utf-8"))
    assert [(int(number), name) for number, name in named] == [(m.number, m.__name__) for m in missions]
