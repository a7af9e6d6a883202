# SPDX-License-Identifier: Apache-2.0
"""World files: put together, seeded, and refused with one sentence."""

from pathlib import Path
from typing import Any, Dict

import pytest
import yaml

from deliberation.house import ACTIONS
from deliberation.problems import PROBLEMS
from deliberation.world_file import WorldError, read_world, seeded

WORLDS = Path(__file__).resolve().parents[3] / "examples" / "deliberation" / "worlds"


def written(folder: Path, name: str, data: Any) -> Path:
    file = folder / name
    file.write_text(data if isinstance(data, str) else yaml.safe_dump(data), encoding="utf-8")
    return file


BASE: Dict[str, Any] = {
    "robots": [{"name": "r"}],
    "hallways": [{"name": "door"}],
    "locations": [{"name": "fridge"}],
}


def test_a_world_adds_to_its_base_closes_places_and_sets_its_robot(tmp_path: Path) -> None:
    written(tmp_path, "base.yaml", BASE)
    own = {"base": "base.yaml", "closed": ["door", "fridge"], "robot": {"initial_battery_level": 50.0}}
    world = read_world(written(tmp_path, "own.yaml", own))
    assert [world[key][0]["is_open"] for key in ("hallways", "locations")] == [False, False]
    assert world["robots"] == [{"name": "r", "initial_battery_level": 50.0}]


@pytest.mark.parametrize(
    ("data", "said"),
    [
        ("a: [", "is not YAML"),
        ("- a", "is no mapping"),
        ({"rooms": []}, "has no robot"),
        ({**BASE, "closed": ["window"]}, "closes 'window'"),
        ({"base": "gone.yaml"}, "there is no world"),
    ],
)
def test_a_wrong_world_is_refused_with_one_sentence(data: Any, said: str, tmp_path: Path) -> None:
    with pytest.raises(WorldError, match=said) as error:
        read_world(written(tmp_path, "world.yaml", data))
    assert "\n" not in str(error.value)


def test_the_seed_gives_each_action_dice_of_its_own_and_the_factor_shortens_delays() -> None:
    world = read_world(WORLDS / "problem_3.yaml")
    dice = seeded(world, seed=7, rtf=5.0)["robots"][0]["action_execution_options"]
    assert len({dice[action]["rng_seed"] for action in ACTIONS}) == len(ACTIONS)
    assert dice["pick"] == {"success_probability": 0.5, "delay": 0.1, "rng_seed": 701}
    assert seeded(world, 7, 5.0) == seeded(world, 7, 5.0) != seeded(world, 8, 5.0)


@pytest.mark.parametrize("number", PROBLEMS)
def test_the_worlds_of_the_problems_have_what_their_goals_name(number: int) -> None:
    world = read_world(WORLDS / f"problem_{number}.yaml")
    text = f"{PROBLEMS[number].goals} {PROBLEMS[number].urgent}".replace("not", "")
    named = {word for word in text.replace("(", " ").replace(")", " ").split() if not word.startswith("is_")}
    there = {place["name"] for key in ("objects", "locations", "hallways") for place in world[key]}
    assert named <= there
