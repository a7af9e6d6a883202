# SPDX-License-Identifier: Apache-2.0
"""At which points of interest robots stand, from what they say of their drives."""

from typing import Any, Callable, List

import pytest
import rospy
from merlin_msgs.msg import RobotWay

from merlin_actions import robot_places
from merlin_actions.robot_places import STANDS_AT, RobotPlaces

POINTS = {
    "hall": {"x": 0.0, "y": 0.0, "yaw": 0.0},
    "door": {"x": 0.5, "y": 0.0, "yaw": 0.0},
    "kitchen": {"x": 5.0, "y": 0.0, "yaw": 0.0},
}


@pytest.fixture()
def say(monkeypatch: pytest.MonkeyPatch) -> Callable[[str, float], None]:
    """Has a robot say where it drives."""
    takers: List[Callable[[Any], None]] = []
    monkeypatch.setattr(rospy, "Subscriber", lambda topic, kind, take, **_: takers.append(take))
    monkeypatch.setattr(
        robot_places,
        "get_param",
        lambda name, default: POINTS if name == "/ann/world/points_of_interest" else default,
    )

    def publish(robot: str, x: float) -> None:
        way = RobotWay(robot=robot)
        way.pose.position.x = x
        takers[-1](way)

    return publish


def test_a_robot_stands_at_the_points_that_are_near_the_nearest_first(
    say: Callable[[str, float], None],
) -> None:
    places = RobotPlaces()
    assert places.points_at("ann") == []
    say("ann", 0.3)
    assert places.points_at("ann") == ["door", "hall"]
    say("ann", 5.0 - STANDS_AT + 0.01)
    assert places.points_at("ann") == ["kitchen"]
    say("ann", 5.0 - STANDS_AT - 0.01)
    assert places.points_at("ann") == []


def test_a_robot_without_points_of_interest_stands_at_none(say: Callable[[str, float], None]) -> None:
    places = RobotPlaces()
    say("bob", 0.0)
    assert places.points_at("bob") == []
    assert places.places() == {"bob": (0.0, 0.0)}


def test_names_without_end_do_not_grow_without_end(say: Callable[[str, float], None]) -> None:
    places = RobotPlaces()
    say("ann", 0.1)
    for number in range(2000):
        say(f"ghost{number}", 3.0)
    say("ann", 0.2)
    assert len(places.places()) < 100 and places.points_at("ann") == ["hall", "door"]
