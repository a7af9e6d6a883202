# SPDX-License-Identifier: Apache-2.0
"""docs/hello.md, from its first command to its last: all of it is run, in one shell, as a reader would."""

import re
from pathlib import Path

import pytest
from terminal import LIMIT, ROOT, run_in_shell

PAGE = (ROOT / "docs" / "hello.md").read_text(encoding="utf-8")
BLOCK = re.compile(r"(?:<!-- (file|run): (\S+) -->\n)?```(sh|python)\n(.*?)```", re.DOTALL)
OTHER_TERMINAL = "# in another terminal"
#: test_new_application.py runs this, too.
FIRST_RUN = "rosrun merlin run my_robot my_robot.launch on:=servers\n"
WRITE = "python - <<'END_OF_BLOCK'\n{code}\nEND_OF_BLOCK\n"


def step(kind: str, file: str, language: str, text: str) -> str:
    """The shell's words for one block of the page."""
    if language == "sh" and OTHER_TERMINAL in text:
        first, rest = text.split("\n", 1)
        # The reader sees when it is ready; `send` says that nothing runs until then.
        ready = (
            'until rosrun merlin send "(greet_done hall)"; do\n'
            "  kill -0 $other && [ $((tries += 1)) -lt 500 ] || { cat other.out; exit 1; }\n"
            "  sleep 0.5\ndone"
        )
        run = first.replace(OTHER_TERMINAL, "")
        return (
            f"{run} > other.out & other=$!\ntries=0\n{ready}\n{rest}\nkill -INT $other; wait $other || true\n"
        )
    if language == "sh":
        # The quickest simulation; and what the page shows on a screen is not to wait for a free port.
        return text.replace("my_robot my_robot.launch\n", "my_robot my_robot.launch rtf:=0\n").replace(
            "check my_robot my_robot.launch rtf:=0", "check my_robot my_robot.launch"
        )
    if kind == "file":
        return f"cat > {file} <<'END_OF_BLOCK'\n{text}END_OF_BLOCK\n"
    code = (
        "import re, pathlib\n"
        f"file = pathlib.Path({file!r})\n"
        f"text = {text!r}\n"
        'old = re.compile(r"    def run\\(self\\).*?\\n(?=\\n\\n|\\Z)", re.DOTALL)\n'
        "new, count = old.subn(lambda _: text, file.read_text())\n"
        "assert count == 1\n"
        "file.write_text(new)\n"
    )
    return WRITE.format(code=code)


@pytest.mark.timeout(LIMIT + 60)
@pytest.mark.parametrize("first_run", [False, pytest.param(True, marks=pytest.mark.long)])
def test_every_step_of_the_page_works(tmp_path: Path, first_run: bool) -> None:
    blocks = BLOCK.findall(PAGE)
    assert [language for _, _, language, _ in blocks].count("sh") == 6
    script = "\n".join(step(*block) for block in blocks)
    # The reader's terminal is in MERLIN's folder, where the new workspace would stay behind.
    script = script.replace("rosrun merlin new", f"cd {tmp_path}; rosrun merlin new")
    assert script.count(FIRST_RUN) == 1
    said = run_in_shell(script if first_run else script.replace(FIRST_RUN, ""), tmp_path, ROOT)
    assert "I changed my mind" in said
    assert 's  robot   says "Hello, kitchen."' in said
    assert "edited: my_robot.actions.greet" in said
    assert "ALREADY_TRUE" in said
    assert "3 passed" in said
    assert "3 tests, 0 errors, 0 failures" in said
