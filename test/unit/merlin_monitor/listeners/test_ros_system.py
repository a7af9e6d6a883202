# SPDX-License-Identifier: Apache-2.0
"""What a new master does not know yet is not gone."""

from types import SimpleNamespace
from typing import Any, List

import pytest

from merlin_monitor.listeners import ros_system
from merlin_monitor.listeners.graph_watch import GraphWatch
from merlin_monitor.listeners.ros_system import RosSystem

FEEDBACK = "/rosplan_plan_dispatcher/action_feedback"


def test_nobody_is_gone_because_the_master_is_new(monkeypatch: pytest.MonkeyPatch) -> None:
    system = RosSystem()
    known = [["/diagnostics", [system.name]], [FEEDBACK, ["/merlin_bridges"]]]
    registered: List[Any] = list(known)
    master = SimpleNamespace(
        getSystemState=lambda: [registered], getTopicTypes=lambda: [[topic, "a/B"] for topic, _ in known]
    )
    monkeypatch.setattr(ros_system, "bounded_master", lambda: master)
    watch = GraphWatch(lambda topics: None, system)
    watch.look()
    assert watch.publishers_of(FEEDBACK) == ["/merlin_bridges"]
    registered.clear()  # a new one
    watch.look()
    assert watch.publishers_of(FEEDBACK) == ["/merlin_bridges"]
    registered.append(known[0])  # from here on it knows those that register
    watch.look()
    assert watch.publishers_of(FEEDBACK) == []
