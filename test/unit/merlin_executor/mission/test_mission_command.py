# SPDX-License-Identifier: Apache-2.0
"""The commands of the documents that run a mission by its name."""

import re
import shlex
from pathlib import Path
from typing import Any, List

import pytest

from merlin_test.node_path import node_path

pytestmark = pytest.mark.processes

ROOT = Path(__file__).resolve().parents[4]
PAGES = ("docs/tutorial.md", "src/merlin_home/README.md", "src/merlin_restaurant/README.md")


# Prints what each part says of itself.
HEARTBEAT = """
import rospy
from diagnostic_msgs.msg import DiagnosticArray
from merlin_test.topic_links import init_node
init_node("heartbeat")
def told(message):
    for status in message.status:
        print(f"{status.name}: {status.message}", flush=True)
rospy.Subscriber("/diagnostics", DiagnosticArray, told)
rospy.spin()
"""


def commands() -> List[str]:
    text = "\n".join((ROOT / page).read_text() for page in PAGES)
    return sorted(set(re.findall(r"rosrun merlin_executor mission mission:=[\w.]+:\w+(?: _\w+:=\S+)*", text)))


def arguments(command: str) -> List[str]:
    """What `rosrun` hands to the executable."""
    return shlex.split(command)[3:]


def test_each_page_has_one() -> None:
    assert len(commands()) == 3


@pytest.mark.parametrize("command", commands())
def test_without_a_robot_it_ends_with_one_line(master: Any, command: str, tmp_path: Path) -> None:
    master.api.setParam("/test", "/world/points_of_interest", {"hall": {}, "kitchen": {}})
    words = [*arguments(command), "_startup_timeout:=1"]
    if "restaurant" in command:
        words.append(f"_results:={tmp_path / 'results'}")
    mission = master.spawn(node_path("merlin_executor", "mission"), *words)
    mission.expect("mission: no knowledge base /rosplan_knowledge_base after 1 s")
    assert mission.ended() == 2
    assert "Traceback" not in mission.output


def test_a_mission_is_heard_as_long_as_its_process_goes_on(master: Any) -> None:
    master.api.setParam("/test", "/world/points_of_interest", {"hall": {}, "kitchen": {}})
    (command,) = [command for command in commands() if "home_mission" in command][:1]
    listener = master.node(HEARTBEAT)
    mission = master.spawn(node_path("merlin_executor", "mission"), *arguments(command))
    listener.expect("mission: mission: starting")
    mission.end()


@pytest.mark.parametrize(
    ("words", "why"),
    [
        ([], "no mission is named; give mission:=package.module:Class or the parameter ~mission"),
        (["_mission:=merlin_home.home_mission:Mission"], "merlin_home.home_mission has no Mission"),
        (["mission:=merlin_home.actions.ask:Ask"], "is not a mission; derive it from GoalDispatcher"),
    ],
)
def test_a_name_that_is_missing_or_wrong_is_one_line(master: Any, words: List[str], why: str) -> None:
    mission = master.spawn(node_path("merlin_executor", "mission"), *words)
    assert mission.ended() == 2
    (line,) = [line for line in mission.output.splitlines() if line.startswith("mission: ")]
    assert why in line
    assert "Traceback" not in mission.output
