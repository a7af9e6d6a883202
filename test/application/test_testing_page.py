# SPDX-License-Identifier: Apache-2.0
"""docs/testing.md, behaviour-trees.md, missions.md: their tests are written to files and run."""

import os
import re
import subprocess
import sys
from pathlib import Path

DOCS = Path(__file__).resolve().parents[2] / "docs"
NAMES = ("testing.md", "behaviour-trees.md", "missions.md")
PAGES = "".join((DOCS / name).read_text(encoding="utf-8") for name in NAMES)
BLOCK = re.compile(r"<!-- file: (\S+) -->\n```python\n(.*?)```", re.DOTALL)


def test_the_tests_of_the_pages_pass(tmp_path: Path) -> None:
    files = BLOCK.findall(PAGES)
    assert [name for name, _ in files] == [
        "conftest.py",
        "test_actions.py",
        "test_mission.py",
        "visit.py",
        "test_visit.py",
        "night.py",
        "test_night.py",
    ]
    for name, text in files:
        (tmp_path / name).write_text(text, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--durations=0"],
        env={**os.environ, "ROS_HOME": str(tmp_path / "ros")},
        cwd=str(tmp_path),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=1300,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-6000:]
    assert "17 passed" in done.stdout, done.stdout
