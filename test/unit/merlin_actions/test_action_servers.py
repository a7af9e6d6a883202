# SPDX-License-Identifier: Apache-2.0
"""The clients of the robots of one plan: one for each robot, none for those that are forgotten."""

from types import SimpleNamespace
from typing import Any, List

import pytest
from diagnostic_msgs.msg import KeyValue
from rosplan_knowledge_msgs.msg import DomainFormula

from merlin_actions import action_servers
from merlin_actions.action_servers import ActionServers

DRIVE = DomainFormula(name="drive", typed_parameters=[KeyValue("r", "robot")])
ended: List[str] = []


class Client:
    def __init__(self, name: str, _: type) -> None:
        self.name = name

    def shutdown(self) -> None:
        ended.append(self.name)


@pytest.fixture
def robots() -> Any:
    return SimpleNamespace(parameter=lambda _: "r", namespace=lambda robot: f"/{robot}/")


@pytest.fixture
def servers(robots: Any, monkeypatch: pytest.MonkeyPatch) -> ActionServers:
    ended.clear()
    monkeypatch.setattr(action_servers, "ActionClient", Client)
    monkeypatch.setattr(action_servers.rospy, "resolve_name", lambda name: name)
    return ActionServers(DRIVE, {}, robots)


def test_the_client_of_a_robot_that_is_forgotten_is_shut_down(servers: ActionServers) -> None:
    ann, bob = servers.client("ann"), servers.client("bob")
    assert servers.client("ann") is ann
    servers.forget("ann")
    assert ended == [ann.name] and servers.client("bob") is bob
    assert servers.client("ann") is not ann
    servers.forget("carl")
    assert ended == ["/ann/actions/drive"]


def test_a_robot_that_shares_the_namespace_of_one_that_is_forgotten_keeps_the_client(
    servers: ActionServers, robots: Any
) -> None:
    robots.namespace = lambda robot: "/home/"
    ann, bob = servers.client("ann"), servers.client("bob")
    assert ann is bob
    servers.forget("ann")
    assert not ended and servers.client("bob") is bob
