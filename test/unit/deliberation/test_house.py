# SPDX-License-Identifier: Apache-2.0
"""The house: ways, what is accessible, goals, and its way over a topic."""

import json

import pytest
from small_house import HOUSE, state

from deliberation.house import accessible, as_data, from_data, holds, mistake_in, words


def test_a_closed_door_bars_the_way_and_an_open_one_does_not() -> None:
    assert accessible(HOUSE, state()) == {"hall"}
    opened = state(open=state().open | {"door"})
    assert accessible(HOUSE, opened) == {"hall", "study"}


def test_ways_lead_through_doors_and_get_longer_with_each() -> None:
    ways = HOUSE.ways((0.0, 1.0), ("hall",))
    assert set(ways) == set(HOUSE.sites)
    assert ways["table"] < ways["door"] < ways["desk"]


def test_goals_are_read_and_compared_with_what_is_true() -> None:
    goals = words("(is_at mug desk) (not (is_open cabinet))")
    assert goals == [("is_at", "mug", "desk"), ("not", "is_open", "cabinet")]
    assert all(holds(goal, state()) for goal in goals)
    assert not holds(("is_at", "mug", "table"), state())


@pytest.mark.parametrize("text", ["", "(is_at mug", "  "])
def test_a_text_that_is_not_a_list_of_goals_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="not a list of goals"):
        words(text)


def test_a_goal_that_the_simulation_cannot_judge_is_refused() -> None:
    with pytest.raises(ValueError, match="robot_at desk"):
        holds(("robot_at", "desk"), state())


@pytest.mark.parametrize(
    ("goals", "said"),
    [
        ("(is_at mug desk) (not (is_open cabinet)) (is_open door)", ""),
        ("(is_at mug desk) (is_at cup desk)", "names cup, which is not in this world; there are mug, soap"),
        ("(is_at mug shelf)", "names shelf, which is not in this world; there are cabinet, desk,"),
        ("(not (is_open fridge))", "'not is_open fridge' names fridge, which"),
    ],
)
def test_a_goal_that_names_what_is_not_there_is_named(goals: str, said: str) -> None:
    mistake = mistake_in(words(goals), HOUSE, state())
    assert said in mistake and bool(said) == bool(mistake) and "\n" not in mistake


def test_house_and_state_come_through_json() -> None:
    assert from_data(json.loads(json.dumps(as_data(HOUSE, state())))) == (HOUSE, state())
