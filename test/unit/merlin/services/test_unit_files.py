# SPDX-License-Identifier: Apache-2.0
"""`rosrun merlin unit`: what it writes is what was asked for, and systemd takes it."""

import os
import shlex
import shutil
import subprocess
from pathlib import Path
from typing import Dict, List

import pytest
import rospkg

from merlin.services.command import main

DATA = Path(__file__).parents[3] / "data"
ROBOT = [
    "merlin",
    "robot.launch",
    f"points_of_interest:={DATA / 'points_of_interest.yaml'}",
    "domain_path:=/d.pddl",
    "problem_path:=/p.pddl",
    "actions:=[a.b:Fetch]",
]
LIMITS = ["max_speed:=0.8", "stop_button:=4", "cmd_vel:=base/cmd_vel", "motion_servers:=[move_base, dock]"]


@pytest.fixture(autouse=True)
def _own_master(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_MASTER_URI", "http://127.0.0.1:11399")


def written(folder: Path, *words: str) -> Dict[str, str]:
    """The units that are written for a command line, by name."""
    assert main([*ROBOT, "--folder", str(folder), "--user", "root", *words]) == 0
    return {file.stem: file.read_text() for file in folder.glob("*.service")}


def command(text: str) -> List[str]:
    """The words that a unit's shell runs in the workspace, as systemd and the shell read them."""
    line = next(line for line in text.splitlines() if line.startswith("ExecStart="))
    shell, option, script = shlex.split(line.partition("=")[2].replace("%%", "%").replace("$$", "$"))
    assert (shell, option) == ("/bin/bash", "-c")
    return shlex.split(script.partition("&& exec ")[2])


def started_first(text: str) -> List[str]:
    return next(line for line in text.splitlines() if line.startswith("Wants=")).partition("=")[2].split()


def test_the_guard_comes_after_the_master_and_before_the_rest(tmp_path: Path) -> None:
    units = written(tmp_path, *LIMITS)
    assert sorted(units) == ["merlin", "merlin-guard", "merlin-master"]
    assert command(units["merlin-master"]) == ["roscore", "-p", "11399"]
    assert started_first(units["merlin-guard"]) == ["merlin-master.service"]
    assert started_first(units["merlin"]) == ["merlin-master.service", "merlin-guard.service"]
    assert all('Environment="ROS_MASTER_URI=http://127.0.0.1:11399"' in text for text in units.values())


def test_the_guard_of_the_service_is_that_of_the_launch_file(tmp_path: Path) -> None:
    units = written(tmp_path, *LIMITS)
    guard = command(units["merlin-guard"])
    assert {"max_speed:=0.8", "stop_button:=4", "cmd_vel:=base/cmd_vel"} <= set(guard)
    assert 'motion_servers:=["move_base", "dock"]' in guard
    assert command(units["merlin"])[-1] == "guard:=elsewhere"


def test_what_a_shell_and_systemd_would_read_otherwise_arrives(tmp_path: Path) -> None:
    odd = "robot:=a%b $HOME \"c\" 'd' \\e"
    assert odd in command(written(tmp_path, odd)["merlin"])


def test_no_master_is_started_beside_that_of_another_computer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.setenv("ROS_MASTER_URI", "http://192.0.2.7:11311")
    assert sorted(written(tmp_path)) == ["merlin", "merlin-guard"]
    assert "http://192.0.2.7:11311" in capsys.readouterr().out


def test_without_a_guard_no_service_of_it_is_written(tmp_path: Path) -> None:
    assert sorted(written(tmp_path, "guard:=false", "--no-master", "--name", "ann")) == ["ann"]


def test_a_robot_in_a_namespace_has_its_guard_there(tmp_path: Path) -> None:
    inner = "".join('<arg name="{}" value="{}"/>'.format(*word.split(":=")) for word in ROBOT[2:])
    file = tmp_path / "ann.launch"
    file.write_text(
        '<launch><arg name="guard" default="true"/><group ns="ann">'
        f'<include file="{rospkg.RosPack().get_path("merlin")}/launch/include/robot.launch">'
        f'{inner}<arg name="guard" value="$(arg guard)"/></include></group></launch>'
    )
    assert main([str(file), "--folder", str(tmp_path), "--user", "root"]) == 0
    assert 'Environment="ROS_NAMESPACE=ann"' in (tmp_path / "merlin-guard.service").read_text()


def test_a_second_call_replaces_its_units_and_nothing_else(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    written(tmp_path)
    assert "max_speed:=0.5" in command(written(tmp_path, "max_speed:=0.5")["merlin"])
    other = tmp_path / "merlin.service"
    other.write_text("[Unit]\n")
    assert main([*ROBOT, "--folder", str(tmp_path), "--user", "root"]) == 2
    assert other.read_text() == "[Unit]\n" and str(other) in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "uri", "said"),
    [
        (["nothing.launch"], "", "there is no launch file 'nothing.launch'"),
        (["merlin", "robot.launch"], "", "robot.launch needs domain_path:=…"),
        ([*ROBOT, "max_sped:=1"], "", "did you mean 'max_speed'?"),
        ([*ROBOT, "port:=11312"], "", "port:= and linger:= are of 'run' only"),
        ([*ROBOT, "guard:=perhaps"], "", "perhaps is not a 'bool' type"),
        ([*ROBOT, "--user", "no-such-user"], "", "there is no user no-such-user"),
        ([*ROBOT, "--name", "../x"], "", "--name ../x is not a name"),
        ([*ROBOT, "--folder", "/proc/nothing"], "", "/proc/nothing cannot be written: "),
        (ROBOT, "nonsense", "ROS_MASTER_URI=nonsense is not an address"),
    ],
)
def test_what_cannot_be_is_one_sentence(
    words: List[str],
    uri: str,
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture,
) -> None:
    monkeypatch.chdir(tmp_path)
    if uri:
        monkeypatch.setenv("ROS_MASTER_URI", uri)
    assert main(words) == 2
    error = capsys.readouterr().err
    assert said in error and len(error.splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_without_a_workspace_it_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.setenv("CMAKE_PREFIX_PATH", str(tmp_path))
    assert main([*ROBOT, "--folder", str(tmp_path), "--user", "root"]) == 2
    assert "no workspace is sourced" in capsys.readouterr().err


@pytest.mark.processes
@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd-analyze: apt install systemd")
def test_systemd_takes_the_units(tmp_path: Path) -> None:
    units = written(tmp_path, *LIMITS, "robot:=a%b $HOME \"c\" 'd'")
    files = [str(tmp_path / f"{name}.service") for name in units]
    verified = subprocess.run(
        ["systemd-analyze", "verify", *files], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    ours = [line for line in verified.stdout.splitlines() if str(tmp_path) in line]
    assert verified.returncode == 0 and not ours, verified.stdout


def test_the_command_that_installs_them_can_be_pasted(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    folder = tmp_path / "my units"
    names = written(folder)
    line = next(line for line in capsys.readouterr().out.splitlines() if "sudo cp" in line)
    assert {Path(word).stem for word in shlex.split(line.partition("&&")[0])[2:-1]} == set(names)


def test_where_users_have_no_names_one_has_to_be_given(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    for name in ("LOGNAME", "USER", "LNAME", "USERNAME", "SUDO_USER"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(os, "getuid", lambda: 2**30)
    assert main([*ROBOT, "--folder", str(tmp_path)]) == 2
    assert "give one that exists: --user NAME" in capsys.readouterr().err
