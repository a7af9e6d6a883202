"""docs/testing.md: its tests are written to files and run, as a reader would."""

import os
import re
import subprocess
import sys
from pathlib import Path

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "testing.md").read_text(encoding="utf-8")
BLOCK = re.compile(r"<!-- file: (\S+) -->\n```python\n(.*?)```", re.DOTALL)


def test_the_tests_of_the_page_pass(tmp_path: Path) -> None:
    files = BLOCK.findall(PAGE)
    assert [name for name, _ in files] == ["conftest.py", "test_actions.py", "test_mission.py"]
    for name, text in files:
        (tmp_path / name).write_text(text, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--durations=0"],
        env={**os.environ, "ROS_HOME": str(tmp_path / "ros")},
        cwd=str(tmp_path),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-6000:]
    assert "6 passed" in done.stdout, done.stdout
