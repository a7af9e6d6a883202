# SPDX-License-Identifier: Apache-2.0
"""A second host of a robot is refused, however late the connection to the first one opens."""

from types import SimpleNamespace
from typing import Any, Callable, Dict, Set

import pytest
import rospy
from merlin_msgs.msg import RobotHost

from merlin_actions import robot_presence
from merlin_actions.robot_presence import RobotPresence

FIRST = "/ann/merlin_fsm_host"


class Master:
    """A master that knows the first host; the connection to it opens at some look for it.

    Each look for connections takes a second of the fake clock.
    """

    def __init__(self, monkeypatch: pytest.MonkeyPatch, looks: int) -> None:
        self._looks = looks
        self.looked = 0
        self._callbacks: Dict[str, Callable[[RobotHost], None]] = {}
        state = ([["/kb/robots", [FIRST, "/second/host"]]], [], [])
        monkeypatch.setattr(rospy, "get_name", lambda: "/second/host")
        monkeypatch.setattr(rospy, "Publisher", lambda *_, **__: None)
        monkeypatch.setattr(rospy, "Subscriber", self._subscribe)
        for name, made in (
            ("get_param", lambda *_: False),
            ("bounded_master", lambda: SimpleNamespace(getSystemState=lambda: state)),
            ("connected_peers", self._peers),
            ("GONE_AFTER", 0.0),  # a message has to come with the connection
            ("CONNECTION_LOOK", 0.0),
            ("time", SimpleNamespace(monotonic=lambda: float(self.looked))),
        ):
            monkeypatch.setattr(robot_presence, name, made)

    def _subscribe(self, topic: str, _: type, callback: Callable[[RobotHost], None], **__: Any) -> Any:
        self._callbacks[topic] = callback
        return SimpleNamespace(unregister=lambda: None)

    def _peers(self, _: Any) -> Set[str]:
        self.looked += 1
        if self.looked < self._looks:
            return set()
        self._callbacks["/kb/robots"](RobotHost(robot="ann", node=FIRST))
        return {FIRST}


def test_a_first_host_whose_connection_opens_late_is_heard(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(robot_presence, "CONNECT_LIMIT", 200.0)
    Master(monkeypatch, looks=100)
    with pytest.raises(ValueError, match=f"{FIRST} says already that it is robot ann"):
        RobotPresence("ann", "/kb", {}).refuse_second()


def test_a_host_that_was_killed_is_not_waited_for_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(robot_presence, "CONNECT_LIMIT", 50.0)
    master = Master(monkeypatch, looks=10**9)
    RobotPresence("bob", "/kb", {}).refuse_second()
    assert master.looked == 50
