# SPDX-License-Identifier: Apache-2.0
"""launch/robots: the names of each robot reach guard, drives and speech, also of an application."""

import re
from pathlib import Path
from typing import Any, Dict, NamedTuple, Optional, Tuple

import pytest
import rospkg
from rosgraph.names import resolve_name

from merlin.launch_config import LaunchConfig
from merlin.launch_request import LaunchError, LaunchRequest

ROOT = Path(__file__).resolve().parents[3]
FOLDER = Path(rospkg.RosPack().get_path("merlin")) / "launch" / "robots"
POINTS = str(ROOT / "test" / "data" / "points_of_interest.yaml")
OF_ROBOT = ("domain_path:=/d", "problem_path:=/p", f"points_of_interest:={POINTS}", "actions:=[]")
APPLICATION = f"file:={FOLDER.parent}/include/application.launch"


class Names(NamedTuple):
    """What docs/real-robot.md says of a robot."""

    row: str
    velocity: str
    drive: str
    speech: Optional[Tuple[str, str, str]] = None


ROBOTS = {
    "tiago": Names(
        "TIAGo", "/nav_vel", "/move_base", ("/tts", "pal_interaction_msgs/TtsAction", "rawtext.text")
    ),
    "hsr": Names(
        "HSR",
        "/hsrb/command_velocity",
        "/move_base/move",
        ("/talk_request_action", "tmc_msgs/TalkRequestAction", "data.sentence"),
    ),
    "fetch": Names("Fetch", "/cmd_vel", "/move_base"),
    "rb1": Names("RB-1", "/robot/move_base/cmd_vel", "/robot/move_base"),
    "turtlebot2": Names("TurtleBot 2", "/cmd_vel_mux/input/navi", "/move_base"),
    "turtlebot3": Names("TurtleBot 3", "/cmd_vel", "/move_base"),
    "pepper": Names("Pepper", "/cmd_vel", "/move_base", ("/speech", "std_msgs/String", "data")),
}


def config_of(robot: str, *words: str) -> LaunchConfig:
    return LaunchConfig(LaunchRequest.from_command_line([str(FOLDER / f"{robot}.launch"), *words]))


def node_of(config: LaunchConfig, kind: str) -> Any:
    (node,) = (each for each in config.nodes if each.type == kind)
    return node


def resolved(node: Any, name: str) -> str:
    return str(resolve_name(dict(node.remap_args).get(name, name), f"{node.namespace}{node.name}"))


def test_each_robot_is_tried_here() -> None:
    assert {file.stem for file in FOLDER.glob("*.launch")} == set(ROBOTS)


@pytest.mark.parametrize("words", [OF_ROBOT, (APPLICATION, f"world_file:={POINTS}")], ids=["robot", "app"])
@pytest.mark.parametrize(("robot", "names"), ROBOTS.items(), ids=list(ROBOTS))
def test_the_names_reach_guard_drives_and_speech(robot: str, names: Names, words: Tuple[str, ...]) -> None:
    config = config_of(robot, *words, "max_speed:=0.4")
    guard, host = node_of(config, "guard"), node_of(config, "fsm_host")
    assert resolved(guard, "cmd_vel") == names.velocity
    assert resolved(guard, "cmd_vel_in") == f"{guard.namespace}cmd_vel_in"
    own = f"{guard.namespace}merlin_guard"
    servers = config.param(f"{own}/motion_servers")
    assert [resolve_name(server, own) for server in servers] == [names.drive]
    assert config.param(f"{own}/max_speed") == 0.4 and config.param("/use_sim_time") is False
    assert resolved(host, "move_base") == names.drive
    if names.speech:
        says = "/speech_relay"
        assert tuple(config.param(f"{says}/{key}") for key in ("to", "type", "field")) == names.speech
    assert ("sound_play" in config.servers("/")) == bool(names.speech)


@pytest.mark.parametrize(("robot", "names"), ROBOTS.items(), ids=list(ROBOTS))
def test_they_are_those_of_the_page(robot: str, names: Names) -> None:
    page = (ROOT / "docs" / "real-robot.md").read_text(encoding="utf-8")
    link = re.escape(f"[{names.row}](../launch/robots/{robot}.launch)")
    (row,) = re.findall(rf"^\| {link} \|.*$", page, re.M)
    said = set(re.findall(r"`(/[^`]+)`", row))
    assert {names.velocity, names.drive, *(names.speech or ())[:1]} <= said


@pytest.mark.parametrize("robot", ["rb1", "turtlebot2", "turtlebot3"])
def test_a_robot_without_speech_may_speak_through_this_computer(robot: str) -> None:
    config = config_of(robot, *OF_ROBOT, "speech:=true")
    host = node_of(config, "fsm_host")
    assert "sound_play" in config.servers(host.namespace)


def test_fields_of_the_speech_arrive_as_they_are() -> None:
    fields: Dict[str, Dict[str, Any]] = {
        "tiago": {"rawtext.lang_id": "en_GB"},
        "hsr": {"data.language": 1},
    }
    for robot, wanted in fields.items():
        assert config_of(robot, *OF_ROBOT).param("/speech_relay/fields") == wanted


def guards_of(*words: str) -> Dict[str, Tuple[LaunchConfig, Any]]:
    """The guard of each of two robots with its launch, by namespace."""
    file = FOLDER.parent / "include" / "application.launch"
    request = LaunchRequest.from_command_line(
        [str(file), "on:=robot", "robots:=ria,tom", f"world_file:={POINTS}", *words]
    )
    config = LaunchConfig(request)
    return {node.namespace: (config, node) for node in config.nodes if node.type == "guard"}


def test_of_several_robots_the_names_reach_each_guard() -> None:
    guards = guards_of(
        "cmd_vel:=base/cmd_vel",
        "cmd_vel_in:=nav_vel",
        "motion_servers:=[move_base, 'dock']",
        "stop_button:=4",
    )
    assert list(guards) == ["/ria/", "/tom/"]
    for namespace, (config, guard) in guards.items():
        assert resolved(guard, "cmd_vel") == f"{namespace}base/cmd_vel"
        assert resolved(guard, "cmd_vel_in") == f"{namespace}nav_vel"
        assert config.param(f"{namespace}merlin_guard/motion_servers") == ["move_base", "dock"]
        assert config.param(f"{namespace}merlin_guard/stop_button") == 4


@pytest.mark.parametrize(
    "word",
    ["cmd_vel:=/base/cmd_vel", "cmd_vel_in:=/nav_vel", "motion_servers:=[move_base, '/dock']"],
)
def test_several_robots_do_not_share_one_base(word: str) -> None:
    with pytest.raises(LaunchError, match="several robots, and one base: .*give names without a slash"):
        guards_of(word)
