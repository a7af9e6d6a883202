# SPDX-License-Identifier: Apache-2.0
"""The table of docs/check.md: each mistake is made in a copy of the guide; `check` says it once."""

import re
import shutil
from pathlib import Path
from typing import Any, Callable, List, NamedTuple

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


@pytest.fixture
def guide(check: Any, tmp_path: Path) -> Callable[..., Any]:
    """What `check` says of a copy of the guide, in which a text of a file is replaced."""

    def ask(file: str = "", old: str = "", new: str = "", *words: str) -> Any:
        folder = tmp_path / "guide"
        shutil.copytree(HERE / "guide", folder)
        if file:
            text = (folder / file).read_text()
            assert text.count(old) >= 1, f"{file} has no {old}"
            (folder / file).write_text(text.replace(old, new, 1))
        return check(folder, str(folder / "guide.launch"), *words)

    return ask


def test_the_guide_itself_fits(guide: Any) -> None:
    done = guide()
    assert (done.returncode, done.stderr) == (0, "")
    assert "2 operators, 2 classes, 2 points of interest fit" in done.stdout
    assert len(ROWS) == 40


@pytest.mark.parametrize("row", ROWS, ids=[row.mistake for row in ROWS])
def test_a_mistake_is_reported_once(row: Row, guide: Any) -> None:
    done = guide(row.file, row.old, row.new)
    said = done.stdout + done.stderr
    assert said.count(row.said) == 1, said
    assert done.returncode == (0 if row.said.startswith(("warning:", "not looked at:")) else 2)
    assert "Traceback" not in done.stderr


#: What no node of an application says when it starts.
UNSAID = (
    "a function without a value",
    "an entry of a function",
    "a word of a grammar",
    "a class of recognize",
    "a server that is not started",
    "a goal of the page",
    "an object of the sentences",
)


#: What one says; with it, the check beside it says it no second time.
SAID = ("an operator without a class", "a goal of a mission", "an operator of the sentences", "YAML")


@pytest.mark.parametrize(
    "row", [row for row in ROWS if row.mistake in (*UNSAID, *SAID)], ids=lambda row: row.mistake
)
def test_beside_a_run_it_says_what_no_node_says(row: Row, guide: Any) -> None:
    done = guide(row.file, row.old, row.new, "--at-start")
    assert done.stdout == ""
    assert (row.said in done.stderr) == (row.mistake in UNSAID), done.stderr
