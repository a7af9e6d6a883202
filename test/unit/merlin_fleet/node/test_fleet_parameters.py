# SPDX-License-Identifier: Apache-2.0
"""The parameters of a robot's node, and its battery."""

from typing import Any, Dict, Tuple

import pytest
import rospy
from sensor_msgs.msg import BatteryState

from merlin_fleet.node.fleet_node import Battery
from merlin_fleet.node.fleet_parameters import read_parameters
from merlin_ros.parameters import ParameterError


@pytest.fixture
def given(monkeypatch: pytest.MonkeyPatch) -> Dict[str, Any]:
    """What the parameter server has."""
    values: Dict[str, Any] = {}
    monkeypatch.setattr(rospy, "get_param", values.get)
    monkeypatch.setattr(rospy, "get_namespace", lambda: "/ward/ann/")
    return values


def test_what_is_not_given(given: Dict[str, Any]) -> None:
    read = read_parameters()
    assert (read.endpoints, read.fleet, read.robot) == (("127.0.0.1:2379",), "fleet", "ward.ann")
    assert (read.groups, read.capabilities, read.tls) == ((), (), None)
    assert read.outbox.endswith("merlin/fleet/fleet.ward.ann.sqlite")


def test_names_are_a_list_or_a_text(given: Dict[str, Any]) -> None:
    given.update({"~groups": "ward, night", "~capabilities": ["arm"], "~hub": "127.0.0.1:1,127.0.0.1:2"})
    given["~fleet_facts"] = "Door_Open=ann, delivered = bob"
    given["rosplan_planner_interface/planner_command"] = "popf DOMAIN PROBLEM"
    read = read_parameters()
    assert read.groups == ("ward", "night")
    assert read.capabilities == ("arm",)
    assert read.endpoints == ("127.0.0.1:1", "127.0.0.1:2")
    assert (read.rules.facts, read.rules.fact_limit) == ({"door_open": "ann", "delivered": "bob"}, 60.0)
    assert read.planner_command == "popf DOMAIN PROBLEM"


@pytest.mark.parametrize(
    ("text", "endpoints"),
    [
        ("[::1]:2379", ("[::1]:2379",)),
        ("hub.lab:1, [::1]:2", ("hub.lab:1", "[::1]:2")),
        ("[hub.lab:1, [::1]:2]", ("hub.lab:1", "[::1]:2")),
        ("[ ]", ("127.0.0.1:2379",)),
    ],
)
def test_an_address_keeps_its_brackets(given: Dict[str, Any], text: str, endpoints: Tuple[str, ...]) -> None:
    given["~hub"] = text
    assert read_parameters().endpoints == endpoints


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("~robot", "a/b", "parameter ~robot: 'a/b' is not a word"),
        ("~fleet", "a b", "parameter ~fleet: 'a b' is not a word"),
        ("~lease", 5.0, "a lease of 5 s is too short"),
        ("~battery_least", "low", "parameter ~battery_least is 'low', not a number"),
        ("~groups", 3, "parameter ~groups is 3, not a list of names"),
        ("~fleet_facts", "door_open", "parameter ~fleet_facts: the robot that writes 'door_open', ''"),
        ("~fleet_facts", ["a=ann", "A=bob"], "parameter ~fleet_facts: 'A' has two writers"),
        ("~fact_limit", 15.0, "parameter ~fact_limit is 15"),
        ("~keep_hours", -1.0, "parameter ~keep_hours is -1"),
        ("~keep_goals", "many", "parameter ~keep_goals is 'many', not a number"),
        ("~ca", "ca.pem", "parameters ~ca, ~certificate and ~key belong together"),
    ],
)
def test_mistakes(given: Dict[str, Any], name: str, value: Any, message: str) -> None:
    given[name] = value
    with pytest.raises(ParameterError) as error:
        read_parameters()
    assert str(error.value).startswith(message)


def test_a_battery_that_is_low_or_silent(monkeypatch: pytest.MonkeyPatch) -> None:
    subscribed = []
    monkeypatch.setattr(rospy, "Subscriber", lambda *arguments, **_: subscribed.append(arguments))
    assert Battery("", 0.2).unfit() == ""
    assert subscribed == []
    battery = Battery("battery", 0.2)
    assert battery.unfit() == "its battery was not received on battery"
    ((topic, _, receive),) = subscribed
    assert topic == "battery"
    receive(BatteryState(percentage=0.1))
    assert battery.unfit() == "its battery is at 10%, less than 20%"
    receive(BatteryState(percentage=0.5))
    assert battery.unfit() == ""
    receive(BatteryState(percentage=float("nan")))  # a driver that does not measure it
    assert battery.unfit() == "its battery was not received on battery"
