# SPDX-License-Identifier: Apache-2.0
"""Every command of the documents can be started: its package, file, executable, arguments and target exist.

What a command does is for the tests of its package; this finds the ones that a rename has left behind.
"""

import functools
import re
import shlex
from pathlib import Path
from typing import Dict, Iterator, List, Optional, Tuple

import pytest
import roslaunch.rlutil
import roslib.packages
import rospkg

from merlin.launch_request import known_arguments
from merlin_test.node_path import node_path

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted(
    [ROOT / "README.md", *(ROOT / "docs").glob("*.md")]
    + [*(ROOT / "src").glob("*/README.md"), *(ROOT / "extras").glob("*/README.md")]
)
TOOLS = ("roslaunch", "rosrun", "make", "rostest", "python")
#: Packages that a page makes, or that its reader has.
OTHERS = ("my_robot", "museum", "my_package", "actionlib", "smach_viewer", "rqt_graph", "topic_tools", "tf")
PACKAGES = rospkg.RosPack()
RUNNERS = (("merlin", "run"), ("merlin", "check"))


def commands(page: Path) -> Iterator[str]:
    """Commands in blocks of shell, and in backticks."""
    text = page.read_text(encoding="utf-8").replace("\\\n", " ")
    blocks = re.findall(r"```(?:sh|bash|console)\n(.*?)```", text, re.DOTALL)
    lines = [line for block in blocks for line in block.splitlines()]
    inline = re.findall(r"`([^`\n]+)`", re.sub(r"```.*?```", "", text, flags=re.DOTALL))
    for line in [*lines, *inline]:
        for part in re.split(r"&&|\|\||;|\||&", re.sub(r"(^|\s)#.*", "", line)):
            yield part.strip()


def documented() -> List[Tuple[str, str]]:
    """Page and command, of the tools that are checked here."""
    found = []
    for page in PAGES:
        for command in commands(page):
            words = re.sub(r"^([A-Z_]+=\S+\s+|tools/in_workspace.sh\s+)+", "", command).split()
            if words[:1] == ["python"] and not " ".join(words[1:]).startswith("bench/"):
                continue  # of a page's reader
            if len(words) > 1 and words[0] in TOOLS and not re.search(r"[…<>]|\.\.\.", " ".join(words)):
                found.append((str(page.relative_to(ROOT)), " ".join(words)))
    return list(dict.fromkeys(found))


@pytest.mark.parametrize(("page", "command"), documented(), ids=lambda text: text[:60])
def test_the_command_can_be_started(page: str, command: str) -> None:
    tool, *words = shlex.split(command)
    if tool == "make":
        targets = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
        for word in words:
            assert word in targets or "=" in word or word == "|", f"{page}: no target {word}"
        return
    if tool == "python":
        check_benchmark(page, *words)
        return
    words = [word for word in words if not word.startswith("--")]
    if words[0] in OTHERS:
        return
    if words[0].endswith((".launch", ".test")):
        check_launch(page, str(ROOT / words[0]), words[1:])
        return
    package, name, *arguments = words
    PACKAGES.get_path(package)
    if tool == "rosrun":
        assert node_path(package, name), page
        written = arguments and arguments[0].startswith("./")  # by the page, whose own test runs it
        if (package, name) in RUNNERS and arguments and not written and arguments[0] not in OTHERS:
            own = not arguments[0].endswith(".launch")  # of the package that it names
            home, file_name, *given = arguments if own else ["merlin", *arguments]
            (file,) = roslib.packages.find_resource(home, file_name)
            check_launch(page, file, given)
        return
    (file,) = roslaunch.rlutil.resolve_launch_arguments([package, name])
    check_launch(page, file, arguments)


def check_benchmark(page: str, path: str, *arguments: str) -> None:
    script = ROOT / path
    assert script.is_file() or (script / "__main__.py").is_file(), f"{page}: no file {path}"
    if path == "bench/run.py":
        for topic in arguments:
            found = topic == "--docs" or any((ROOT / "bench").glob(f"*/bench_{topic}.py"))
            assert found, f"{page}: no benchmark {topic}"


@functools.lru_cache(maxsize=None)
def arguments_of(file: str) -> Dict[str, Optional[str]]:
    """The arguments of a launch file, which several pages name, and their defaults; None: it is required."""
    return known_arguments(Path(file))


def check_launch(page: str, file: str, words: List[str]) -> None:
    declared = arguments_of(file)
    given = {word.partition(":=")[0] for word in words if ":=" in word} - {"port", "linger"}
    assert given <= set(declared), f"{page}: {Path(file).name} has no argument {given - set(declared)}"
    missing = {name for name, default in declared.items() if default is None} - given
    assert not missing, f"{page}: {Path(file).name} needs {missing}"
