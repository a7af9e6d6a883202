# SPDX-License-Identifier: Apache-2.0
"""The stress test sees a robot that is not as an idle one has to be."""

import pytest
from stress.idle_rules import NEAR, IdleRobot, violations

IDLE = IdleRobot(
    positions=["(robot_at kitchen)"],
    place=(1.0, 2.0),
    points={"kitchen": (1.0, 2.0 + NEAR / 2), "hall": (9.0, 2.0)},
)


def test_an_idle_robot_at_its_place_is_right() -> None:
    assert list(violations(IDLE, "robot_at")) == []


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"goals": ["(checked hall)"]}, "goals are left in the knowledge base: ['(checked hall)']"),
        ({"positions": []}, "0 facts robot_at hold when idle: []"),
        (
            {"positions": ["(robot_at hall)"]},
            "(robot_at hall) holds, but the robot is 8.00 m away from there",
        ),
        ({"is_driving": True}, "the robot is commanded to drive while the executor is idle"),
    ],
)
def test_what_is_wrong_is_said(change: dict, what: str) -> None:
    assert list(violations(IDLE._replace(**change), "robot_at")) == [what]


def test_two_places_at_once_are_wrong_whatever_they_are() -> None:
    both = ["(robot_at kitchen)", "(robot_at anywhere)"]
    (found,) = violations(IDLE._replace(positions=both), "robot_at")
    assert found.startswith("2 facts robot_at hold when idle")


@pytest.mark.parametrize("change", [{"place": None}, {"positions": ["(robot_at anywhere)"]}])
def test_a_place_that_is_not_known_is_not_compared(change: dict) -> None:
    assert list(violations(IDLE._replace(**change), "robot_at")) == []
