# SPDX-License-Identifier: Apache-2.0
"""Where a robot keeps its files for good."""

import os
import pwd
from pathlib import Path

import pytest
import rospkg
from roslaunch.config import ROSLaunchConfig
from roslaunch.xmlloader import XmlLoader

from merlin.launch_config import Loader

LAUNCH = Path(rospkg.RosPack().get_path("merlin")) / "launch" / "include" / "robot.launch"
DATA = Path(__file__).parents[2] / "data" / "points_of_interest.yaml"
OWN = os.path.join(pwd.getpwuid(os.getuid()).pw_dir, ".ros")


@pytest.mark.parametrize(
    ("home", "ros_home", "kept", "loader"),
    [
        ("/home/me", "/somewhere", "/somewhere", XmlLoader),
        ("/home/me", None, "/home/me/.ros", XmlLoader),
        (None, "/somewhere", "/somewhere", XmlLoader),
        (None, None, OWN, Loader),  # of rosrun merlin run and check
    ],
)
def test_a_robot_keeps_its_knowledge_below_ros_home(monkeypatch, home, ros_home, kept, loader):
    for name, value in (("HOME", home), ("ROS_HOME", ros_home)):
        monkeypatch.setenv(name, value or "")  # so that it is put back
        if value is None:
            monkeypatch.delenv(name)
    config = ROSLaunchConfig()
    arguments = {
        "domain_path": "/d.pddl",
        "problem_path": "/p.pddl",
        "points_of_interest": DATA,
        "actions": "[]",
        "robot": "ann",
    }
    inner = "".join(f'<arg name="{name}" value="{value}"/>' for name, value in arguments.items())
    loader(resolve_anon=False).load_string(
        f'<launch><include file="{LAUNCH}">{inner}</include></launch>', config
    )
    assert config.params["/rosplan_knowledge_base/state_file"].value == f"{kept}/merlin/ann/knowledge.sqlite"
