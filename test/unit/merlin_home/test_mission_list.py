# SPDX-License-Identifier: Apache-2.0
"""Mission lists: what the paper says of them, for any seed."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from merlin_home.mission_list import MissionListError, make_mission, mission_tasks

POINTS = ["dorm_room", "bathroom", "kitchen", "main_door"]


@given(st.sampled_from([6, 20, 120]), st.integers(0, 10**6))
def test_neighbours_differ_and_exactly_half_is_marked(tasks: int, seed: int) -> None:
    mission = make_mission(POINTS, tasks, seed)
    assert [task.number for task in mission] == list(range(1, tasks + 1))
    assert all(a.poi != b.poi for a, b in zip(mission, mission[1:]))
    assert {task.poi for task in mission} <= set(POINTS)
    assert sum(task.marked for task in mission) * 2 == tasks


@given(st.integers(0, 10**6), st.permutations(POINTS))
def test_the_same_seed_gives_the_same_list_in_any_order_of_points(seed: int, points: list) -> None:
    assert make_mission(points, 20, seed) == make_mission(POINTS, 20, seed)


@given(st.integers(0, 10**6), st.integers(0, 20), st.integers(0, 20))
def test_marks_of_a_smaller_share_are_among_those_of_a_larger_one(seed: int, one: int, other: int) -> None:
    small, large = sorted([one, other])
    few = make_mission(POINTS, 20, seed, small / 20)
    many = make_mission(POINTS, 20, seed, large / 20)
    assert [task.poi for task in few] == [task.poi for task in many]
    assert {task.number for task in few if task.marked} <= {task.number for task in many if task.marked}
    assert sum(task.marked for task in many) == large


def test_the_algorithm_is_a_contract() -> None:
    """Lists of published results can be made again by any later version."""
    mission = make_mission(POINTS, 6, 1)
    assert [task.poi for task in mission] == [
        "bathroom",
        "main_door",
        "dorm_room",
        "bathroom",
        "kitchen",
        "main_door",
    ]
    assert [task.number for task in mission if task.marked] == [3, 5, 6]


def test_every_point_and_every_place_is_drawn_about_equally() -> None:
    missions = [make_mission(POINTS, 6, seed) for seed in range(2000)]
    for poi in POINTS:
        assert 2700 < sum(task.poi == poi for mission in missions for task in mission) < 3300
    for place in range(6):
        assert 900 < sum(mission[place].marked for mission in missions) < 1100


@pytest.mark.parametrize(
    ("points", "tasks", "share", "text"),
    [
        (["kitchen", "kitchen"], 6, 0.5, "two points"),
        (POINTS, 0, 0.5, "one task"),
        (POINTS, 5, 0.5, "even length"),
        (POINTS, 6, 1.5, "from 0 to 1"),
    ],
)
def test_impossible_lists_say_why(points: list, tasks: int, share: float, text: str) -> None:
    with pytest.raises(MissionListError, match=text):
        make_mission(points, tasks, 1, share)


def test_missions_of_the_paper() -> None:
    assert [mission_tasks(mission) for mission in (1, 2, 3)] == [6, 20, 120]
    with pytest.raises(MissionListError, match="no mission 4"):
        mission_tasks(4)
