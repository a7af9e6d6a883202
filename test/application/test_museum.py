# SPDX-License-Identifier: Apache-2.0
"""docs/museum.md, from its first command to its last: two robots that talk, without a look into the code."""

import re
from pathlib import Path

import pytest
from terminal import LIMIT, ROOT, run_in_shell

PAGE = (ROOT / "docs" / "museum.md").read_text(encoding="utf-8")
BLOCK = re.compile(r"(?:<!-- (\w+): (\S+) -->\n)?```(sh|python|lisp|yaml)\n(.*?)```", re.DOTALL)
#: Kind of block → what is replaced in a file; the block comes in its place.
REPLACED = {"predicate": r"(?<=\(:predicates\n)", "operator": r"  \(:durative-action tell.*\n(?=\Z)"}
SIMULATED = "rosrun merlin run museum museum.launch answers"
RUN_TESTS = "catkin_make run_tests && catkin_test_results"


def step(kind: str, file: str, language: str, text: str) -> str:
    """The shell's words for one block of the page."""
    if language == "sh":
        return text.replace(SIMULATED, f": {SIMULATED}")  # the other test runs it
    if kind == "file":
        return f"cat > {file} <<'END_OF_BLOCK'\n{text}END_OF_BLOCK\n"
    text = text if kind == "predicate" else text[:-1] + ")\n"  # the last parenthesis of the domain
    code = (
        f"import pathlib, re\nfile = pathlib.Path({file!r})\n"
        f"new, count = re.compile({REPLACED[kind]!r}, re.DOTALL).subn(lambda _: {text!r}, file.read_text())\n"
        "assert count == 1\nfile.write_text(new)\n"
    )
    return f"python - <<'END_OF_BLOCK'\n{code}END_OF_BLOCK\n"


def script(folder: Path, blocks: slice = slice(None)) -> str:
    words = "\n".join(step(*block) for block in BLOCK.findall(PAGE)[blocks])
    return words.replace("rosrun merlin new", f"cd {folder}; rosrun merlin new")


@pytest.mark.timeout(LIMIT + 60)
@pytest.mark.parametrize("rostest", [False, pytest.param(True, marks=pytest.mark.long)])
def test_every_step_of_the_page_works(tmp_path: Path, rostest: bool) -> None:
    """Its rostest runs the mission once more, on the same servers with the same answers."""
    words = script(tmp_path)
    assert RUN_TESTS in words
    said = run_in_shell(words if rostest else words.replace(RUN_TESTS, ""), tmp_path, ROOT)
    assert 'ria understands "yes"' in said and 'tom understands "no"' in said
    assert re.search(r'ria says "The [\w ]+ is three hundred years old."', said)
    assert re.search(r'tom says "Enjoy the [\w ]+\."', said)
    assert "4 passed" in said, said
    assert ("3 tests, 0 errors, 0 failures" in said) == rostest, said


@pytest.mark.long
@pytest.mark.timeout(LIMIT + 60)
def test_in_the_simulator_a_person_answers_each_robot(tmp_path: Path) -> None:
    words = script(tmp_path, slice(0, -2))
    words = words.replace(f": {SIMULATED}", SIMULATED.replace("answers", "rtf:=3 answers"))
    said = run_in_shell(words, tmp_path, ROOT)
    assert said.count('ria understands "yes"') == 2 and said.count('tom understands "no"') == 2
