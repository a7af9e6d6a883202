"""robots:=… of the launch files: names between commas or blanks, with or without brackets and quotes."""

from pathlib import Path

import pytest
import rospkg
from roslaunch.config import ROSLaunchConfig
from roslaunch.xmlloader import XmlLoader

MERLIN = Path(rospkg.RosPack().get_path("merlin"))
APPLICATION = {
    "domain_path": MERLIN / "pddl/robots/domain.pddl",
    "problem_path": MERLIN / "pddl/robots/problem.pddl",
    "actions": "[merlin_actions.actions.drive:Drive]",
}
FORMS = ["ann,bob", "ann bob", " ann,  bob ", "[ann, bob]", "['ann', 'bob']"]


def load(file, arguments):
    inner = "".join(f'<arg name="{name}" value="{value}"/>' for name, value in arguments.items())
    config = ROSLaunchConfig()
    text = f'<launch><include file="{MERLIN / "launch" / file}">{inner}</include></launch>'
    XmlLoader(resolve_anon=False).load_string(text, config)
    return config


@pytest.mark.parametrize("robots", FORMS)
@pytest.mark.parametrize(
    "file, arguments", [("include/application.launch", APPLICATION), ("restaurant.launch", {})]
)
def test_each_robot_has_a_host_and_stands_in_the_world(file, arguments, robots):
    config = load(file, {**arguments, "robots": robots})
    hosts = [node.namespace for node in config.nodes if node.type == "fsm_host"]
    assert sorted(set(hosts) - {"/"}) == ["/ann/", "/bob/"]
    assert config.params["/ann/merlin_fsm_host/robot"].value == "ann"
    assert config.params["/merlin_sim/robots"].value == ["ann", "bob"]


@pytest.mark.parametrize("robots", ["", "[]", " "])
def test_none_is_one_robot_without_a_name(robots):
    config = load("include/application.launch", {**APPLICATION, "robots": robots})
    assert {node.namespace for node in config.nodes if node.type == "fsm_host"} == {"/"}
