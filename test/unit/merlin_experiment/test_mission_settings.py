# SPDX-License-Identifier: Apache-2.0
"""Parameters of the mission node: what is wrong is said in one sentence."""

from typing import Any, Dict

import pytest

from merlin_experiment.mission.mission_settings import MissionSettings, SettingsError

POINTS = {
    name: {"x": x, "y": 0.0, "yaw": 0.0}
    for x, name in enumerate(["dorm_room", "bathroom", "kitchen", "main_door"])
}


def read(points: Any = POINTS, **params: Any) -> MissionSettings:
    return MissionSettings.read(lambda name, default: params.get(name, default), points)


def test_defaults_are_mission_1() -> None:
    settings = read()
    assert len(settings.make_list()) == 6
    assert settings.columns()["approach"] == "merlin"
    assert settings.points["kitchen"] == (2.0, 0.0)


def test_points_can_be_chosen() -> None:
    settings = read(points=POINTS, tasks=4)
    assert len(settings.make_list()) == 4
    chosen = MissionSettings.read(
        lambda name, default: {"points": "kitchen bathroom"}.get(name, default), POINTS
    )
    assert {task.poi for task in chosen.make_list()} == {"kitchen", "bathroom"}


@pytest.mark.parametrize(
    ("params", "text"),
    [
        ({"mission": 4}, "no mission 4"),
        ({"mission": 1.5}, "whole number"),
        ({"seed": "seven"}, "~seed is 'seven'"),
        ({"cancel_after": 0}, "more than 0"),
        ({"approach": "clever"}, "merlin, naive"),
        ({"rtf_policy": "sometimes"}, "constant, adaptive"),
        ({"real_time_factor": -1}, "0 or more"),
        ({"tasks": 5}, "even length"),
    ],
)
def test_what_is_wrong_is_named(params: Dict[str, Any], text: str) -> None:
    with pytest.raises(SettingsError, match=text):
        read(**params)


def test_unknown_points_are_named_with_those_there_are() -> None:
    with pytest.raises(SettingsError, match="no garage; it has bathroom, dorm_room, kitchen, main_door"):
        MissionSettings.read(lambda name, default: {"points": "garage"}.get(name, default), POINTS)


def test_a_world_without_points_is_named() -> None:
    with pytest.raises(SettingsError, match="world:="):
        read(points={"kitchen": {"x": 1.0}})


def test_a_missing_world_file_is_named() -> None:
    with pytest.raises(SettingsError, match="no file /nowhere.yaml"):
        read(world_file="/nowhere.yaml")
    assert read().world_file is None
