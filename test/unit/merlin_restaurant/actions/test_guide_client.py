# SPDX-License-Identifier: Apache-2.0
"""Guiding a client: what the robot sees of the client decides where the guidance goes, and it ends."""

from types import SimpleNamespace
from typing import Any, List

import pytest
import rospy

from merlin_restaurant.actions import guide_client
from merlin_restaurant.actions.guide_client import GuideClient
from merlin_ros import ros_alarm
from merlin_sm.states.function_state import FunctionState


class Watch:
    """A follower that the drives and waits of a test do not ask for."""

    behind = close = False

    def begin(self, *_: Any) -> None:
        """A guidance begins."""

    end = begin


class Guidance(GuideClient):
    """Its drives, waits and looks end as a test lists them; `said` and `forgotten` are what it did.

    :param drives: outcomes of the drives to the table: "" or "behind".
    :param waits: outcomes of the waits for the client: "" or "lost".
    :param looks: number of persons seen at the table in each look; the last one repeats.
    """

    def __init__(self, drives: List[str], waits: List[str], looks: List[int]) -> None:
        self.drives, self.waits, self.looks = list(drives), list(waits), list(looks)
        self.said: List[str] = []
        self.forgotten: List[str] = []
        super().__init__()

    def state(self, name: str, *args: Any, **options: Any) -> Any:
        if name == "speak":
            return FunctionState(lambda userdata: self.said.append(args[0]))
        if name == "navigation":
            return None  # part of the state `while`
        if name == "while":
            return FunctionState(lambda userdata: self.drives.pop(0) or None, outcomes=["behind"])
        if name == "recognize":
            return FunctionState(self._look, outputs=["detections"])
        return super().state(name, *args, **options)

    def _look(self, userdata: Any) -> None:
        userdata.detections = ["person"] * (self.looks.pop(0) if len(self.looks) > 1 else self.looks[0])

    def remove_facts(self, facts: Any) -> None:
        self.forgotten.append(facts)


@pytest.fixture(autouse=True)
def world(monkeypatch: pytest.MonkeyPatch) -> None:
    """People at the table are those of the list; ten simulated seconds pass between two looks."""
    waits: List[Guidance] = []
    clock = iter(range(0, 100_000, 10))
    monkeypatch.setattr(guide_client, "FollowerWatch", Watch)
    monkeypatch.setattr(
        guide_client,
        "WatchState",
        lambda watch, until, limit=0.0: FunctionState(
            lambda userdata: waits[-1].waits.pop(0) or None, outcomes=["lost"] if limit else []
        ),
    )
    monkeypatch.setattr(guide_client, "people_at", lambda table, seen: len(seen))
    monkeypatch.setattr(rospy.rostime, "is_wallclock", lambda: False)
    monkeypatch.setattr(rospy, "get_time", lambda: float(next(clock)))
    build = Guidance.build

    def remember_and_build(self: Guidance) -> None:
        waits.append(self)
        build(self)

    monkeypatch.setattr(Guidance, "build", remember_and_build)


def guide(guidance: Guidance) -> str:
    return str(guidance.run_once({"c": "client_1", "t": "table_1"}))


def test_the_robot_looks_until_a_person_sits_at_the_table() -> None:
    guidance = Guidance([""], [], [0, 0, 1])
    assert guide(guidance) == "succeeded"
    assert guidance.said == ["Please follow me to {t}.", "This is {t}. Please take a seat."]


def test_the_robot_calls_and_waits_for_a_client_that_falls_behind() -> None:
    guidance = Guidance(["behind", "behind", ""], ["", ""], [1])
    assert guide(guidance) == "succeeded"
    assert guidance.said.count("I wait for you.") == 2


def test_a_lost_client_is_forgotten() -> None:
    guidance = Guidance(["behind"], ["lost"], [0])
    assert guide(guidance) == "aborted"
    assert guidance.said[-1].startswith("I am sorry, I have lost you.")
    assert guidance.forgotten == ["(greeted client_1)"]
    assert "client_1 no longer follows" in guidance.reason


def test_a_client_that_does_not_sit_down_is_not_seated() -> None:
    guidance = Guidance(["", ""], [], [0])
    for _ in range(2):  # the second time as patiently as the first
        assert guide(guidance) == "aborted"
        assert "does not sit down at table_1" in guidance.reason
    assert guidance.forgotten == []


def test_a_client_is_given_its_time_though_the_wall_clock_is_set_forward(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    passes = iter(range(100))
    monkeypatch.setattr(rospy.rostime, "is_wallclock", lambda: True)
    monkeypatch.setattr(ros_alarm, "time", SimpleNamespace(monotonic=lambda: float(next(passes))))
    assert guide(Guidance([""], [], [0] * 20 + [1])) == "succeeded"
