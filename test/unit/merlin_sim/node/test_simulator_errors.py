# SPDX-License-Identifier: Apache-2.0
"""A simulator that cannot begin says why in one line; that its process ends so is shown by simulator.test."""

from pathlib import Path
from unittest import mock

import pytest
import rospy

from merlin_ros.parameters import ParameterError
from merlin_sim.node import simulator_node

WORLD = Path(__file__).resolve().parents[4] / "src" / "merlin_sim" / "worlds" / "apartment.yaml"


def said(_, start, *errors):
    """In place of the process: what it would say before it ends with 2; any other error is a traceback."""
    try:
        start()
    except (ParameterError, *errors) as error:
        return str(error)
    return "it runs"


@pytest.fixture
def given(monkeypatch):
    """What the parameter server has, over a master that knows no other node."""
    values = {"~world": str(WORLD)}
    monkeypatch.setattr(rospy, "get_param", lambda name, default=None: values.get(name, default))
    monkeypatch.setattr(rospy, "Publisher", mock.Mock())
    lonely = mock.Mock(**{"getSystemState.return_value": ([], [], [])})
    monkeypatch.setattr(simulator_node, "bounded_master", lambda: lonely)
    monkeypatch.setattr(simulator_node, "lower_priority", lambda _: None)
    monkeypatch.setattr(simulator_node, "run_node", said)
    return values


def refused(*words):
    text = simulator_node.main()
    assert [word for word in words if word not in text] == [], text
    assert "\n" not in text


def test_a_missing_world(given):
    given["~world"] = "/nowhere/flat.yaml"
    refused("/nowhere/flat.yaml", "No such file")


def test_a_world_that_breaks_the_schema(given, tmp_path):
    file = tmp_path / "flat.yaml"
    file.write_text(WORLD.read_text().replace("x: 7.6, y: 1.2", "x: seven, y: 1.2"))
    given["~world"] = str(file)
    refused("points_of_interest.kitchen.x", "'seven'")


def test_a_robot_without_a_start(given):
    given["~robots"] = ["r1", "r2", "r3", "r4", "r5"]
    refused("no start left", "r5")


@pytest.mark.parametrize(
    ("robots", "words"),
    [(["", "robot"], ["twice"]), ([{"namespace": "r1", "yaw": 1.0}], ["r1", "yaw"])],
)
def test_robots_that_cannot_be_told_apart_or_placed(given, robots, words):
    given["~robots"] = robots
    refused(*words)


def test_a_description_of_no_robot(given):
    given["~urdf"] = str(WORLD)
    refused("~urdf", "not a robot")
