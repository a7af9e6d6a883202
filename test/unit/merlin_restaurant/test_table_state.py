# SPDX-License-Identifier: Apache-2.0
"""What the robot makes of what it sees and hears."""

import pytest

from merlin_restaurant.menu import call_from, difference, items_in, table_called
from merlin_restaurant.table_state import decide, seen_near


@pytest.mark.parametrize(
    "people, dishes, state",
    [
        (1, [], "needs_serving"),
        (2, ["coffee"], "already_served"),
        (0, ["cup"], "needs_cleaning"),
        (0, [], "ready"),
    ],
)
def test_the_state_of_a_table(people: int, dishes: list, state: str) -> None:
    assert decide(people, dishes) == state


class Thing:
    def __init__(self, name: str, x: float, y: float) -> None:
        self.name = name
        self.position = (x, y, 0.8)


def test_only_what_is_near_counts() -> None:
    things = [Thing("cup", 1.0, 1.2), Thing("person", 1.0, 1.9), Thing("cup", 4.0, 1.0)]
    assert seen_near(things, (1.0, 1.0), 0.5) == ["cup"]
    assert seen_near(things, (1.0, 1.0), 1.0) == ["cup", "person"]


@pytest.mark.parametrize(
    "ordered, seen, wrong",
    [
        (["coffee", "cake"], ["cake", "coffee"], ""),
        (["coffee", "cake"], ["coffee"], "the cake is missing"),
        (["coffee"], ["juice"], "the coffee is missing, and the juice was not ordered"),
        (["coffee"], ["coffee", "juice"], "the juice was not ordered"),
        (["coffee"], ["coffee", "coffee"], "there is more than one coffee"),
    ],
)
def test_the_difference_between_an_order_and_the_bar(ordered: list, seen: list, wrong: str) -> None:
    assert difference(ordered, seen) == wrong


def test_items_and_tables_are_found_in_sentences() -> None:
    assert items_in("one cake and a coffee please") == ["coffee", "cake"]
    assert table_called(call_from("table_5")) == "table_5"
    assert table_called("good evening we would like a table") == ""
