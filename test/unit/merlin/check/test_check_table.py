# SPDX-License-Identifier: Apache-2.0
"""The table of docs/check.md: each mistake is made in a copy of the guide; `check` says it once."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Dict, List, NamedTuple

import pytest

HERE = Path(__file__).parent
PAGE = HERE.parents[3] / "docs" / "check.md"

pytestmark = pytest.mark.processes


class Row(NamedTuple):
    mistake: str
    file: str
    old: str
    new: str
    said: str


def rows() -> List[Row]:
    lines = PAGE.read_text().partition("## 40 mistakes")[2].splitlines()
    cells = [re.sub("`", "", line).split(" | ") for line in lines if line.startswith("| ")]
    found = [Row(*(cell.strip(" |") for cell in row)) for row in cells]
    return [row._replace(new="" if row.new == "nothing" else row.new) for row in found[1:]]


ROWS = rows()


@pytest.fixture(scope="module")
def answers(tmp_path_factory: pytest.TempPathFactory) -> Dict[str, List[str]]:
    """What `check` says of the guide, and of a copy with each mistake."""
    folders = {"": HERE / "guide"}
    for number, row in enumerate(ROWS):
        folder = tmp_path_factory.mktemp(f"guide{number}") / "guide"
        shutil.copytree(HERE / "guide", folder)
        text = (folder / row.file).read_text()
        assert text.count(row.old) >= 1, f"{row.file} has no {row.old}"
        (folder / row.file).write_text(text.replace(row.old, row.new, 1))
        folders[row.mistake] = folder
    done = subprocess.run(
        [sys.executable, str(HERE / "check_many.py"), *map(str, folders.values())],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return dict(zip(folders, map(json.loads, done.stdout.splitlines())))


def test_the_guide_itself_fits(answers: Dict[str, List[str]]) -> None:
    code, out, err = answers[""]
    assert (code, err) == (0, "") and "2 operators, 2 classes, 2 points of interest fit" in out
    assert len(ROWS) == 40


@pytest.mark.parametrize("row", ROWS, ids=[row.mistake for row in ROWS])
def test_a_mistake_is_told_once(row: Row, answers: Dict[str, List[str]]) -> None:
    code, out, err = answers[row.mistake]
    known = ("warning:", "not looked at:")
    assert (out + err).count(row.said) == 1, out + err
    assert code == (0 if row.said.startswith(known) else 2)
    assert "Traceback" not in err
