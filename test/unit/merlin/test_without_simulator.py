# SPDX-License-Identifier: Apache-2.0
"""Launch files on a computer with the profile robot: they start, or one sentence says what to do."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Dict, Sequence

import pytest
import rospkg
import yaml

pytestmark = pytest.mark.processes

ROOT = Path(__file__).resolve().parents[3]
POINTS = ROOT / "pddl" / "home" / "points_of_interest.yaml"
#: Reads launch files, each with its arguments, and prints the nodes of each, or why there are none.
READER = """
import json, sys
from merlin.launch_config import LaunchConfig
from merlin.launch_request import LaunchError, LaunchRequest
found = {}
for words in json.loads(sys.argv[1]):
    try:
        config = LaunchConfig(LaunchRequest.from_command_line(words))
        found[" ".join(words)] = sorted(node.package for node in config.nodes)
    except LaunchError as error:
        found[" ".join(words)] = str(error)
print(json.dumps(found))
"""
OF_ROBOT = ("domain_path:=/d", "problem_path:=/p", f"points_of_interest:={POINTS}", "actions:=[]")
WORKS: Sequence[Sequence[str]] = [
    ["home.launch", "simulator:=false", "measure:=false"],
    ["include/home_robot.launch", "simulated:=false"],
    ["include/robot.launch", *OF_ROBOT],
    ["robots/tiago.launch", *OF_ROBOT],
    ["include/robot.launch", *OF_ROBOT, "robots:=ann,bob"],
    ["include/application.launch", "on:=robot", f"world_file:={POINTS}"],
    ["include/application.launch", "on:=servers"],
    ["include/application.launch", "on:=servers", "robots:=ann,bob"],
    ["include/navigation.launch", "description:=false"],
    ["include/speech.launch"],
    ["include/listen.launch"],
    ["include/recognition.launch"],
    ["include/guard.launch"],
]
BUILD = "make build PROFILE=simulation"
SAYS: Dict[str, str] = {
    "home.launch": f"{BUILD}; or simulator:=false",
    "home.launch simulator:=false": f"{BUILD}; or measure:=false",
    "restaurant.launch": BUILD,
    "experiment.launch": BUILD,
    "include/simulator.launch": BUILD,
    "include/home_robot.launch": f"{BUILD}; or simulated:=false",
    "include/navigation.launch": f"{BUILD}; or description:=false",
    "include/application.launch": f"{BUILD}; or on:=robot, or on:=servers",
    "include/application.launch on:=robot": "give world_file:=",
}


@pytest.fixture(scope="module")
def read(tmp_path_factory: pytest.TempPathFactory) -> Dict[str, object]:
    """What a workspace of the profile robot makes of each of the files."""
    left_out = subprocess.run(
        [str(ROOT / "tools" / "packages.sh"), "--left-out", "robot"],
        capture_output=True,
        text=True,
        check=True,
    )
    packages = tmp_path_factory.mktemp("packages")
    rospack = rospkg.RosPack()
    for name in set(rospack.list()) - set(left_out.stdout.split()):
        (packages / name).symlink_to(rospack.get_path(name))
    env = {**os.environ, "ROS_PACKAGE_PATH": str(packages), "CMAKE_PREFIX_PATH": ""}
    files = [*WORKS, *(words.split() for words in SAYS)]
    done = subprocess.run(
        [sys.executable, "-c", READER, json.dumps(files)],
        env=env,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return dict(json.loads(done.stdout.splitlines()[-1]))


@pytest.mark.parametrize("words", WORKS, ids=" ".join)
def test_what_is_for_a_robot_needs_no_simulator(read: Dict[str, object], words: Sequence[str]) -> None:
    packages = read[" ".join(words)]
    assert isinstance(packages, list), packages
    assert packages and not {"merlin_sim", "merlin_experiment"} & set(packages)


@pytest.mark.parametrize(("words", "said"), SAYS.items())
def test_what_needs_more_says_what_to_build_or_to_set(read: Dict[str, object], words: str, said: str) -> None:
    text = read[words]
    assert isinstance(text, str) and said in text and "\n" not in text and "ROS path" not in text


def test_the_places_of_simulated_servers_are_those_of_the_apartment() -> None:
    world = Path(rospkg.RosPack().get_path("merlin_sim")) / "worlds" / "apartment.yaml"
    places, simulated = (
        yaml.safe_load(file.read_text(encoding="utf-8"))["points_of_interest"] for file in (POINTS, world)
    )
    assert places == simulated
