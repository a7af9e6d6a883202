# SPDX-License-Identifier: Apache-2.0
"""Where a robot keeps its files for good."""

from pathlib import Path

import rospkg
from roslaunch.config import ROSLaunchConfig
from roslaunch.xmlloader import XmlLoader

LAUNCH = Path(rospkg.RosPack().get_path("merlin")) / "launch" / "include" / "robot.launch"
DATA = Path(__file__).parents[2] / "data" / "points_of_interest.yaml"


def test_a_robot_keeps_its_knowledge_below_ros_home(monkeypatch):
    for home, set_to in (("/somewhere", "/somewhere"), ("/home/me/.ros", None)):
        monkeypatch.setenv("HOME", "/home/me")
        monkeypatch.delenv("ROS_HOME", raising=False)
        if set_to is not None:
            monkeypatch.setenv("ROS_HOME", set_to)
        config = ROSLaunchConfig()
        arguments = {
            "domain_path": "/d.pddl",
            "problem_path": "/p.pddl",
            "points_of_interest": DATA,
            "actions": "[]",
            "robot": "ann",
        }
        inner = "".join(f'<arg name="{name}" value="{value}"/>' for name, value in arguments.items())
        XmlLoader(resolve_anon=False).load_string(
            f'<launch><include file="{LAUNCH}">{inner}</include></launch>', config
        )
        file = config.params["/rosplan_knowledge_base/state_file"].value
        assert file == f"{home}/merlin/ann/knowledge.sqlite"
