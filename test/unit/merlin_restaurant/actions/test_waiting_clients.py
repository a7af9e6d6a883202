# SPDX-License-Identifier: Apache-2.0
"""Several robots note each client who waits, and one robot that there is one."""

from typing import Any, List

import pytest
from fake_robot import FakeRobot

from merlin_restaurant.actions import check_entrance
from merlin_restaurant.actions.greet_client import GreetClient
from merlin_sm.states.function_state import FunctionState
from smach import State


class Sees:
    """Sees as many people at the entrance as a test says."""

    people = 0

    def state(self, name: str, *args: Any, **options: Any) -> State:
        if name == "recognize":
            return FunctionState(self._look, outputs=["detections"])
        if name == "ask":
            return FunctionState(self._answer, outputs=["heard"], outcomes=["misunderstood"])
        return super().state(name, *args, **options)  # type: ignore[misc]

    def _look(self, userdata: Any) -> None:
        userdata.detections = ["person"] * self.people

    def _answer(self, userdata: Any) -> None:
        userdata.heard = "yes please"


class GreetAlone(Sees, GreetClient):
    pass


class LookAlone(Sees, check_entrance.CheckEntrance):
    pass


Greet, Look = GreetAlone.fitted(["r", "c"], "r"), LookAlone.fitted(["r"], "r")


@pytest.fixture(autouse=True)
def at_the_entrance(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(check_entrance, "spot", lambda point, ahead: (0.0, 0.0))
    monkeypatch.setattr(check_entrance, "seen_near", lambda detections, place, around: list(detections))


@pytest.mark.parametrize(
    ("kind", "known", "people", "waiting"),
    [
        (Greet, 1, 3, 3),
        (Greet, 1, 1, 1),
        (Greet, 2, 0, 2),  # the picture is no reason to forget the client who is greeted
        (Look, 0, 2, 2),
        (Look, 2, 1, 2),
        (Look, 2, 0, 0),
        (LookAlone, 0, 2, 1),
        (LookAlone, 1, 2, 1),
        (GreetAlone, 1, 3, 1),
    ],
)
def test_who_waits_is_noted(robot: FakeRobot, kind: Any, known: int, people: int, waiting: int) -> None:
    names: List[str] = [f"client_{number}" for number in range(1, known + 1)]
    robot.things = {"client": list(names)}
    robot.known = [f"(waiting {name})" for name in names]
    action = kind()
    action.people = people
    assert action.run_once({"r": "robot_1", "c": "client_1"}) == "succeeded"
    assert len(robot.facts("waiting")) == waiting
    assert len(set(robot.facts("waiting"))) == waiting
