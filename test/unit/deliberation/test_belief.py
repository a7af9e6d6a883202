# SPDX-License-Identifier: Apache-2.0
"""What the robot believes: what it has not seen, has seen, holds, and has put down."""

from typing import Set, Tuple

from small_house import HOUSE, state

from deliberation.belief import Belief, fixed_values

SPOTS = {"table", "desk", "cabinet"}


def places(belief: Belief, predicate: str, thing: str) -> Set[str]:
    return {fact[2] for fact in belief.facts(state()) if fact[:2] == (predicate, thing)}


def test_what_was_never_seen_may_be_at_every_spot() -> None:
    belief = Belief(HOUSE, ["mug", "soap"])
    assert places(belief, "maybe_at", "mug") == SPOTS
    assert not places(belief, "is_at", "mug")


def test_what_is_known_at_first_is_not_looked_for_until_it_is_gone_from_there() -> None:
    belief = Belief(HOUSE, ["mug", "soap"], {"mug": "desk"})
    assert (places(belief, "is_at", "mug"), places(belief, "maybe_at", "mug")) == ({"desk"}, set())
    assert places(belief, "maybe_at", "soap") == SPOTS
    belief.looked("desk", [])
    assert (places(belief, "is_at", "mug"), places(belief, "maybe_at", "mug")) == (set(), SPOTS - {"desk"})


def test_a_place_that_was_looked_at_and_is_empty_is_known_so() -> None:
    belief = Belief(HOUSE, ["mug", "soap"])
    belief.looked("table", [])
    assert places(belief, "maybe_at", "mug") == SPOTS - {"table"}


def test_all_that_is_seen_is_known_also_what_was_not_looked_for() -> None:
    belief = Belief(HOUSE, ["mug", "soap"])
    belief.looked("desk", ["mug"])
    assert places(belief, "is_at", "mug") == {"desk"}
    assert not places(belief, "maybe_at", "mug")
    assert places(belief, "maybe_at", "soap") == SPOTS - {"desk"}


def test_a_thing_that_is_gone_from_where_it_was_known_is_looked_for_elsewhere() -> None:
    belief = Belief(HOUSE, ["mug"])
    belief.looked("desk", ["mug"])
    belief.looked("desk", [])
    assert not places(belief, "is_at", "mug")
    assert places(belief, "maybe_at", "mug") == SPOTS - {"desk"}


def test_a_held_thing_is_nowhere_else_and_a_thing_put_down_is_where_the_robot_is() -> None:
    belief = Belief(HOUSE, ["mug"])
    belief.looked("desk", ["mug"])
    belief.felt(state(site="desk", holding="mug"))
    assert not places(belief, "is_at", "mug") and not places(belief, "maybe_at", "mug")
    belief.felt(state(site="table"))
    assert places(belief, "is_at", "mug") == {"table"}


def facts_of(**changes: object) -> Set[Tuple[str, ...]]:
    return set(Belief(HOUSE, ["mug"]).facts(state(**changes)))


def test_the_robot_is_anywhere_where_it_is_at_no_site() -> None:
    assert ("robot_at", "anywhere") in facts_of()
    assert ("robot_at", "desk") in facts_of(site="desk", room="study")


def test_the_hand_is_empty_or_holds_a_thing() -> None:
    assert ("hand_empty",) in facts_of()
    assert ("hand_empty",) not in facts_of(holding="mug")


def test_the_reserve_is_the_way_to_the_charger() -> None:
    values = fixed_values(HOUSE)
    assert values["reserve", "desk"] == values["drive_use", "desk", "dock"] > values["reserve", "table"] > 0
    assert values["reserve", "dock"] == 0
