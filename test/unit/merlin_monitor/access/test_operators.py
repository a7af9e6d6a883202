# SPDX-License-Identifier: Apache-2.0
"""Operators and their tokens: the file, its changes, the command that writes it, and wrong tokens."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Dict, List, Tuple

import pytest
import rospkg
from served import TOKEN, WEB, Served, ask

from merlin_monitor.access import operators
from merlin_monitor.access.operators import Operators, OperatorsError, write_operators
from merlin_monitor.access.web_access import FORGET, LONGEST_DELAY, WrongTokens

ANA, BO = "token of ana", "token of bo, long"


def test_a_token_leads_to_a_name_and_changes_count_at_once(tmp_path: Path) -> None:
    path = tmp_path / "operators.yaml"
    operators = Operators(path)
    assert operators.names == [] and operators.name_of(ANA) is None
    write_operators(path, {"ana": ANA, "Bo 2": BO})
    assert operators.names == ["Bo 2", "ana"]
    assert (operators.name_of(ANA), operators.name_of(BO), operators.name_of("")) == ("ana", "Bo 2", None)
    write_operators(path, {"ana": ANA})
    assert operators.name_of(BO) is None
    path.unlink()
    assert operators.name_of(ANA) is None


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("- ana", "not a list of name: token"),
        ("ana: short", "12 or more"),
        ("ana: 123456789012345", "in quotes"),
        ('"": abcdefghijklmnop', "is not a name"),
        ("ana: [abcdefghijklmnop", "not YAML"),
        ("ana: abcdefghijklmnop\nbo: abcdefghijklmnop", "one token to two"),
    ],
)
def test_a_file_that_is_wrong_is_named_without_its_tokens(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "operators.yaml"
    path.write_text(text)
    path.chmod(0o600)
    with pytest.raises(OperatorsError, match=said) as raised:
        Operators(path)
    assert str(path) in str(raised.value) and "abcdefg" not in str(raised.value)


@pytest.mark.everywhere
def test_a_file_that_others_can_read_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "operators.yaml"
    write_operators(path, {"ana": ANA})
    path.chmod(0o640)
    with pytest.raises(OperatorsError, match=f"chmod 600 {path}"):
        Operators(path)


def test_a_file_that_breaks_while_it_is_used_changes_nothing(tmp_path: Path) -> None:
    path = tmp_path / "operators.yaml"
    write_operators(path, {"ana": ANA})
    operators = Operators(path)
    path.write_text("ana: [")
    assert operators.name_of(ANA) == "ana", "or the robot could not be stopped any more"
    assert "not YAML" in operators.trouble
    write_operators(path, {"bo": BO})
    assert operators.name_of(ANA) is None and operators.trouble == ""


def test_a_file_that_cannot_be_replaced_leaves_no_tokens_beside_it(tmp_path: Path) -> None:
    path = tmp_path / "operators.yaml"
    path.mkdir()
    for _ in range(2):
        with pytest.raises(IsADirectoryError):
            write_operators(path, {"ana": ANA})
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.everywhere
def test_the_file_of_the_readme_can_be_used(tmp_path: Path) -> None:
    readme = (WEB.parent / "README.md").read_text()
    (text,) = [block for block in re.findall(r"```yaml\n(.*?)```", readme, re.DOTALL) if "ana:" in block]
    path = tmp_path / "operators.yaml"
    path.write_text(text)
    path.chmod(0o600)
    assert Operators(path).names == ["ana"]


def command(monkeypatch: pytest.MonkeyPatch, path: Path, *words: str) -> int:
    monkeypatch.setattr("sys.argv", ["operator", *words, "--file", str(path)])
    return operators.main()


@pytest.mark.everywhere
def test_the_command_makes_and_removes_operators(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "merlin" / "operators.yaml"
    operators = Operators(path)
    assert command(monkeypatch, path, "ana") == 0
    token = capsys.readouterr().out.strip().rsplit(" ", 1)[1]
    assert operators.name_of(token) == "ana" and path.stat().st_mode & 0o777 == 0o600
    assert command(monkeypatch, path, "bo") == 0
    assert command(monkeypatch, path, "ana", "--remove") == 0
    assert operators.names == ["bo"] and operators.name_of(token) is None
    assert command(monkeypatch, path, "ana", "--remove") == 2
    assert command(monkeypatch, path, "a\nb") == 2
    assert os.listdir(path.parent) == [path.name]


@pytest.mark.processes
def test_an_empty_ros_home_is_none(tmp_path: Path) -> None:
    """As for the launch files, by which the monitor has its file."""
    home, here = tmp_path / "home", tmp_path / "here"
    here.mkdir()
    for package, words in (("merlin_monitor", ["operator", "ana"]), ("merlin", ["history"])):
        script = Path(rospkg.RosPack().get_path(package)) / "scripts" / words[0]
        environment = {**os.environ, "ROS_HOME": "", "HOME": str(home)}
        command = [sys.executable, str(script), *words[1:]]
        done = subprocess.run(command, env=environment, cwd=here, capture_output=True, text=True)
        assert done.returncode == (0 if package == "merlin_monitor" else 2)
    assert (home / ".ros" / "merlin" / "operators.yaml").is_file() and not list(here.iterdir())
    assert f"there is no history {home}/.ros/merlin/history.sqlite" in done.stderr


def test_wrong_tokens_of_an_address_cost_more_and_more_and_are_reported_with_their_number() -> None:
    reported: List[Tuple[str, int]] = []
    tokens = WrongTokens(lambda address, count: reported.append((address, count)))
    delays = [tokens.note("10.0.0.7", 100.0 + number) for number in range(8)]
    assert delays == sorted(delays) and delays[0] < delays[1] and delays[-1] == LONGEST_DELAY
    assert reported == [("10.0.0.7", 1), ("10.0.0.7", 6)]
    assert tokens.note("10.0.0.8", 108.0) == delays[0], "others are not slowed down"
    assert tokens.note("10.0.0.7", 108.0 + FORGET + 1.0) == delays[0]


@pytest.mark.everywhere
def test_a_wrong_token_is_in_the_history_and_the_right_one_does_not_wait(served: Served) -> None:
    bad: Dict[str, str] = {"X-Merlin-Token": "wrong"}
    assert ask(served.url, "control/who", "POST", bad).status == 403
    who = ask(served.url, "control/who", "POST", {"X-Merlin-Token": TOKEN})
    assert json.loads(who.said) == {"done": "Ana"}
    texts = [event["text"] for event in json.loads(ask(served.url, "history.json").said)]
    assert texts == ["wrong token from 127.0.0.1"]
