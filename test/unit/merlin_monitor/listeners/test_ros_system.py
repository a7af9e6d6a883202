# SPDX-License-Identifier: Apache-2.0
"""What a new master does not know yet is not gone; in a recording nothing is silent because it is paused."""

from types import SimpleNamespace
from typing import Any, List

import pytest

from merlin_monitor.listeners import ros_system
from merlin_monitor.listeners.ros_system import STANDS, ReplayedSystem, RosSystem

FEEDBACK = "/rosplan_plan_dispatcher/action_feedback"


def test_no_node_is_gone_because_the_master_is_new(monkeypatch: pytest.MonkeyPatch) -> None:
    system = RosSystem()
    known = [["/diagnostics", [system.name]], [FEEDBACK, ["/merlin_bridges"]]]
    registered: List[Any] = list(known)
    master = SimpleNamespace(
        getSystemState=lambda: [registered], getTopicTypes=lambda: [[topic, "a/B"] for topic, _ in known]
    )
    monkeypatch.setattr(ros_system, "bounded_master", lambda: master)
    system.look()
    assert system.publishers_of(FEEDBACK) == ["/merlin_bridges"]
    registered.clear()  # a new one
    system.look()
    assert system.publishers_of(FEEDBACK) == ["/merlin_bridges"]
    registered.append(known[0])  # from here on it knows those that register
    system.look()
    assert system.publishers_of(FEEDBACK) == []


def test_silence_does_not_grow_while_a_recording_is_paused_or_at_its_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    times = {"played": 7.0, "now": 100.0}
    monkeypatch.setattr(ros_system.rospy, "get_time", lambda: times["played"])
    monkeypatch.setattr(RosSystem, "wall", lambda _: times["now"])
    system = ReplayedSystem()
    begin = system.silence_clock()
    for _ in range(40):  # 10 s at 20 times the speed; many look at the same time
        times["played"] += 5.0
        times["now"] += 0.25
        assert system.silence_clock() == system.silence_clock()
    assert system.silence_clock() - begin == pytest.approx(10.0)
    times["now"] += 3600.0  # it stands
    assert system.silence_clock() - begin == pytest.approx(10.0)
    times["played"] += 0.01
    assert system.silence_clock() - begin == pytest.approx(10.0 + STANDS)


def test_the_player_of_a_recording_is_not_taken_for_the_node_that_has_its_name(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    topics = [["/diagnostics", [RosSystem().name, "/mission"]], ["/merlin/status", ["/mission"]]]
    master = SimpleNamespace(
        getSystemState=lambda: [topics], getTopicTypes=lambda: [[topic, "a/B"] for topic, _ in topics]
    )
    monkeypatch.setattr(ros_system, "bounded_master", lambda: master)
    monkeypatch.setattr(ros_system.rospy, "get_time", lambda: 0.0)
    system = ReplayedSystem()
    seen = system.look()
    assert system.publisher_of("/merlin/status") == "" and system.publishers_of("/diagnostics") == []
    assert seen == {"/diagnostics": "a/B", "/merlin/status": "a/B"}, "its topics are followed all the same"
