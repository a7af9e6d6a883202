# SPDX-License-Identifier: Apache-2.0
"""Parameters of the mission node: what is wrong is said in one sentence."""

from typing import Any, Callable, Dict

import pytest
import rospy

from merlin_experiment.mission.mission_settings import MissionSettings
from merlin_ros.parameters import ParameterError

POINTS = {
    name: {"x": x, "y": 0.0, "yaw": 0.0}
    for x, name in enumerate(["dorm_room", "bathroom", "kitchen", "main_door"])
}


@pytest.fixture
def read(monkeypatch: pytest.MonkeyPatch) -> Callable[..., MissionSettings]:
    def read(given: Any = POINTS, **params: Any) -> MissionSettings:
        values = {"world/points_of_interest": given, **{f"~{name}": value for name, value in params.items()}}
        monkeypatch.setattr(rospy, "get_param", lambda name, default: values.get(name, default))
        return MissionSettings.read()

    return read


def test_defaults_are_mission_1(read: Any) -> None:
    settings = read()
    assert len(settings.make_list()) == 6
    assert settings.columns()["approach"] == "merlin"
    assert settings.points["kitchen"] == (2.0, 0.0)


def test_points_can_be_chosen(read: Any) -> None:
    assert len(read(tasks=4).make_list()) == 4
    chosen = read(points="kitchen bathroom")
    assert {task.poi for task in chosen.make_list()} == {"kitchen", "bathroom"}


@pytest.mark.parametrize(
    ("params", "text"),
    [
        ({"mission": 4}, "no mission 4"),
        ({"mission": 1.5}, "whole number"),
        ({"seed": "seven"}, "~seed is 'seven'"),
        ({"cancel_after": 0}, "less than 0.001"),
        ({"approach": "clever"}, "merlin, naive"),
        ({"rtf_policy": "sometimes"}, "constant, adaptive"),
        ({"real_time_factor": -1}, "less than 0"),
        ({"tasks": 5}, "even length"),
    ],
)
def test_what_is_wrong_is_named(read: Any, params: Dict[str, Any], text: str) -> None:
    with pytest.raises(ParameterError, match=text):
        read(**params)


def test_unknown_points_are_named_with_those_there_are(read: Any) -> None:
    with pytest.raises(ParameterError, match="no garage; it has bathroom, dorm_room, kitchen, main_door"):
        read(points="garage")


def test_a_world_without_points_is_named(read: Any) -> None:
    with pytest.raises(ParameterError, match="world:="):
        read({"kitchen": {"x": 1.0}})


def test_a_missing_world_file_is_named(read: Any) -> None:
    with pytest.raises(ParameterError, match="no file /nowhere.yaml"):
        read(world_file="/nowhere.yaml")
    assert read().world_file is None
