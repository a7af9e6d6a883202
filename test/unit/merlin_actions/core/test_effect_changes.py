# SPDX-License-Identifier: Apache-2.0
"""The changes of an action that is carried out, stopped or never begun, where the bridge applies them."""

from typing import List, Sequence, Set

import pytest

from merlin_actions.core.effect_changes import EffectChanges, FactChange
from merlin_actions.core.ending import Closing

DRIVE = {"a": "hall", "b": "kitchen"}
BUSY = FactChange(True, "busy")


class World:
    """The facts that are true."""

    def __init__(self, *facts: FactChange) -> None:
        self.facts: Set[FactChange] = set(facts)

    def true_now(self, changes: Sequence[FactChange]) -> List[bool]:
        return [change._replace(becomes_true=True) in self.facts for change in changes]

    def apply(self, changes: Sequence[FactChange]) -> None:
        for change in changes:
            fact = change._replace(becomes_true=True)
            (self.facts.add if change.becomes_true else self.facts.discard)(fact)


def at(place: str, true: bool = True) -> FactChange:
    return FactChange(true, "at", (place,))


def durative() -> EffectChanges:
    """(drive ?a ?b): leaves at its start, arrives at its end, and counts the move at a constant place."""
    return EffectChanges([at("a", False)], [at("b"), FactChange(True, "used", ("corridor",))], plain=False)


def carry_out(
    world: World, effects: EffectChanges, closing: Closing, interrupted: Sequence[FactChange]
) -> None:
    world.apply(effects.open("t", DRIVE, [BUSY], world.true_now))
    assert BUSY in world.facts, "it holds while the action runs"
    world.apply(effects.close("t", DRIVE, closing, interrupted))


@pytest.mark.parametrize(
    ("closing", "interrupted", "left"),
    [
        (Closing.END, [], {at("kitchen"), FactChange(True, "used", ("corridor",))}),
        (Closing.INTERRUPT, [at("anywhere")], {at("anywhere")}),
        (Closing.INTERRUPT, [], {at("hall")}),
        (Closing.ROLLBACK, [at("anywhere")], {at("hall")}),
    ],
)
def test_what_holds_after_an_action(
    closing: Closing, interrupted: List[FactChange], left: Set[FactChange]
) -> None:
    world = World(at("hall"))
    carry_out(world, durative(), closing, interrupted)
    assert world.facts == left


def test_a_plain_operator_changes_nothing_before_its_end() -> None:
    world = World(at("hall"))
    effects = EffectChanges([at("a", False), at("b")], [], plain=True)
    assert effects.open("t", DRIVE, [], world.true_now) == []
    world.apply(effects.close("t", DRIVE, Closing.END, []))
    assert world.facts == {at("kitchen")}


def test_what_was_so_before_stays_so_after_an_undo() -> None:
    world = World(at("hall"), BUSY)
    carry_out(world, durative(), Closing.ROLLBACK, [])
    assert world.facts == {at("hall"), BUSY}, "the robot was busy before this action"


def test_a_start_effect_that_changed_nothing_is_not_undone() -> None:
    world = World(at("bathroom"))
    carry_out(world, durative(), Closing.INTERRUPT, [])
    assert world.facts == {at("bathroom")}, "it was not in the hall before"


def test_a_place_that_is_left_and_reached_is_where_the_robot_is() -> None:
    world = World(at("hall"))
    effects = EffectChanges([at("b"), at("a", False)], [], plain=True)
    circle = {"a": "hall", "b": "hall"}
    effects.open("t", circle, [], world.true_now)
    world.apply(effects.close("t", circle, Closing.END, []))
    assert world.facts == {at("hall")}


def test_each_execution_is_undone_by_itself() -> None:
    world = World(at("hall"))
    effects = durative()
    world.apply(effects.open("first", DRIVE, [], world.true_now))
    world.apply(effects.open("second", DRIVE, [], world.true_now))
    world.apply(effects.close("second", DRIVE, Closing.ROLLBACK, []))
    assert world.facts == set(), "the second one has changed nothing"
    world.apply(effects.close("first", DRIVE, Closing.ROLLBACK, []))
    assert world.facts == {at("hall")}


def test_an_execution_that_was_never_opened_leaves_the_world_alone() -> None:
    assert durative().close("unknown", DRIVE, Closing.ROLLBACK, []) == []
