# SPDX-License-Identifier: Apache-2.0
"""autonomy:= of the launch files that start state machines, and the commands of a terminal."""

from pathlib import Path
from typing import Any, Dict

import pytest
import rospkg
from roslaunch.config import ROSLaunchConfig
from roslaunch.xmlloader import XmlLoader

from merlin import operator_commands
from merlin_ros.parameters import ParameterError
from merlin_sm.autonomy import LEVELS
from merlin_sm.holding import node_holds

LAUNCH = Path(rospkg.RosPack().get_path("merlin")) / "launch"
POINTS = str(Path(__file__).parents[2] / "data" / "points_of_interest.yaml")
ROBOT = {"domain_path": "/d.pddl", "problem_path": "/p.pddl", "points_of_interest": POINTS, "actions": "[]"}
TWO = {"robots": "ann,bob"}
#: Launch file, its arguments, and the hosts of state machines that it starts.
FILES = [
    ("home.launch", {}, ["/merlin_fsm_host"]),
    ("restaurant.launch", {}, ["/merlin_fsm_host"]),
    ("restaurant.launch", TWO, ["/ann/merlin_fsm_host", "/bob/merlin_fsm_host", "/merlin_fsm_host"]),
    ("include/application.launch", {}, ["/merlin_fsm_host"]),
    ("include/robot.launch", ROBOT, ["/merlin_fsm_host"]),
    (
        "include/robot.launch",
        {**ROBOT, **TWO},
        ["/ann/merlin_fsm_host", "/bob/merlin_fsm_host", "/merlin_fsm_host"],
    ),
    ("include/actions.launch", {"actions": "[]"}, ["/merlin_fsm_host"]),
    ("include/merlin_action.launch", {"name": "wave", "class": "a.b:Wave"}, ["/fsm_wave"]),
]


def levels(file: str, arguments: Dict[str, str]) -> Dict[str, Any]:
    """Host of state machines -> its autonomy level."""
    inner = "".join(f'<arg name="{name}" value="{value}"/>' for name, value in arguments.items())
    config = ROSLaunchConfig()
    text = f'<launch><include file="{LAUNCH / file}">{inner}</include></launch>'
    XmlLoader(resolve_anon=False).load_string(text, config)
    hosts = [f"{node.namespace}{node.name}" for node in config.nodes if node.type == "fsm_host"]
    return {host: config.params[f"{host}/autonomy"].value for host in hosts}


@pytest.mark.parametrize(("file", "arguments", "hosts"), FILES)
def test_every_host_of_machines_gets_the_level(file: str, arguments: Dict[str, str], hosts: Any) -> None:
    assert levels(file, arguments) == dict.fromkeys(hosts, "full")
    for level in LEVELS:  # roslaunch must not read off as false
        assert levels(file, {**arguments, "autonomy": level}) == dict.fromkeys(hosts, level)


@pytest.mark.parametrize(("value", "level"), [("off", 0), (False, 0), ("high", 2), (None, 3)])
def test_a_node_reads_its_level(value: Any, level: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rospy.get_param", lambda name, default: default if value is None else value)
    assert node_holds.usual_level() == level


@pytest.mark.parametrize("value", ["medium", True, 3, "", ["low"]])
def test_a_wrong_level_is_one_line(value: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rospy.get_param", lambda name, default: value)
    with pytest.raises(
        ParameterError, match="^parameter ~autonomy: '.*' is not an autonomy level; there are off"
    ):
        node_holds.usual_level()


@pytest.mark.parametrize(
    ("words", "said"),
    [(["medium"], "invalid choice: 'medium' (choose from"), ([], "the following arguments are required")],
)
def test_a_command_with_a_wrong_level_ends_with_2(
    words: Any, said: str, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    monkeypatch.setattr("sys.argv", ["autonomy", *words])
    with pytest.raises(SystemExit) as ended:
        operator_commands.autonomy()
    errors = capsys.readouterr().err
    assert ended.value.code == 2 and said in errors and "Traceback" not in errors


@pytest.mark.parametrize(
    ("command", "words"),
    [(operator_commands.autonomy, ["low"]), (operator_commands.leave, ["NAVIGATE/DRIVE", "aborted"])],
)
def test_a_command_without_a_robot_is_one_line(
    command: Any, words: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: Any
) -> None:
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    monkeypatch.setenv("ROS_MASTER_URI", "http://localhost:1")
    monkeypatch.setattr("sys.argv", ["command", *words])
    assert command() == 2
    errors = capsys.readouterr().err
    assert errors.count("\n") == 1 and errors.startswith(f"merlin {command.__name__}: ")
