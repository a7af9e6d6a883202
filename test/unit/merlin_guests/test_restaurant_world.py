# SPDX-License-Identifier: Apache-2.0
"""Players refuse a world in which they would not find their way about, and say what it lacks."""

from pathlib import Path

import pytest

from merlin_guests.players_node import restaurant_world
from merlin_sim.world.world_file import WorldError, find_world


def test_the_restaurant_of_the_simulator_is_one() -> None:
    assert restaurant_world("restaurant").name == "restaurant"


def test_another_world_is_refused_with_what_it_lacks() -> None:
    with pytest.raises(WorldError) as refusal:
        restaurant_world("apartment")
    text = str(refusal.value)
    assert "apartment.yaml is not a restaurant" in text
    for lack in ("door 'entrance_door'", "furniture 'bar_counter'", "person 'barman'", "interest 'table_6'"):
        assert lack in text


@pytest.mark.parametrize(
    "old, new, lack",
    [
        ("  table_2: {x", "  elsewhere: {x", "point of interest 'table_2'"),
        ("name: entrance_door", "name: front_door", "door 'entrance_door'"),
        ("name: chair_5", "name: stool", "piece of furniture 'chair_5'"),
        ("name: barman", "name: landlord", "person 'barman'"),
    ],
)
def test_what_is_missing_alone_is_named(tmp_path: Path, old: str, new: str, lack: str) -> None:
    text = Path(find_world("restaurant")).read_text()
    assert old in text
    world = tmp_path / "cafe.yaml"
    world.write_text(text.replace(old, new))
    with pytest.raises(WorldError, match=rf"cafe.yaml is not a restaurant: it has no {lack}$"):
        restaurant_world(str(world))
