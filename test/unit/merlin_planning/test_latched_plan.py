# SPDX-License-Identifier: Apache-2.0
"""A plan that the parser has latched before this client began is not taken for the one it has parsed."""

from types import SimpleNamespace
from typing import Any, List

import pytest
import rospy
from rosplan_dispatch_msgs.msg import ActionDispatch, CompletePlan

from merlin_planning import planning_client
from merlin_planning.planning_client import PlanningClient

TOPIC = "/rosplan_parsing_interface/complete_plan"


class Parser:
    """The topic of the plans; a subscriber gets the latched plan when its connection is open."""

    def __init__(self) -> None:
        self.latched = plan("old")
        self.watches: List[Any] = []

    def watch(self, topic: str, message_class: type) -> Any:
        found = SimpleNamespace(topic=topic, count=0, message=None, connected=False)
        found.wait_newer = lambda count, timeout: self._wait(found, count)
        self.watches.append(found)
        return found

    def service(self, name: str, *_: Any, **__: Any) -> Any:
        parser = self

        class Service:
            def wait(self, timeout: float) -> bool:
                return True

            def __call__(self) -> None:
                parser.parse()

        return Service()

    def connect(self) -> None:
        for watch in self.watches:
            if not watch.connected:
                watch.connected = True
                self._send(watch, self.latched)

    def parse(self) -> None:
        new = plan("new")
        for watch in self.watches:
            if watch.connected:
                self._send(watch, new)
        # One that is not connected yet gets what was latched when its connection began.

    def _wait(self, watch: Any, count: int) -> Any:
        self.connect()
        return watch.message if watch.count > count else None

    @staticmethod
    def _send(watch: Any, message: Any) -> None:
        watch.message = message
        watch.count += 1


def plan(name: str) -> CompletePlan:
    return CompletePlan(plan=[ActionDispatch(name=name)])


def test_the_first_plan_is_the_one_that_was_parsed(monkeypatch: pytest.MonkeyPatch) -> None:
    parser = Parser()
    master = SimpleNamespace(getTopicTypes=lambda: [[TOPIC, "rosplan_dispatch_msgs/CompletePlan"]])
    monkeypatch.setattr(planning_client, "TopicWatch", parser.watch)
    monkeypatch.setattr(planning_client, "bounded_master", lambda: master)
    monkeypatch.setattr(planning_client, "ServiceProxy", parser.service)
    monkeypatch.setattr(
        planning_client, "ActionClient", lambda *_: SimpleNamespace(wait_for_server=lambda timeout: True)
    )
    monkeypatch.setattr(rospy, "Subscriber", lambda *_, **__: None)
    client = PlanningClient()
    client.wait(1.0)
    parser.connect()  # meanwhile
    assert [action.name for action in client.parse_plan()] == ["new"]
