# SPDX-License-Identifier: Apache-2.0
"""What the stress of several robots and of several requests draws, and how it judges."""

import random
from typing import Dict, List

import pytest
from stress.stress_cycles import Cycle, arguments_of, draw, draw_joint, places_of, twice, untrue

ROBOTS = ["ann", "bob"]
PLACES = ["kitchen", "hall", "yard", "attic"]


def cycles(seed: int, count: int = 300) -> List[Cycle]:
    chance = random.Random(seed)
    return [draw(chance, ROBOTS, PLACES, 2.0) for _ in range(count)]


def test_the_same_seed_draws_the_same_cycles() -> None:
    assert cycles(3) == cycles(3) != cycles(4)


def test_every_cycle_can_be_run() -> None:
    for cycle in cycles(1):
        assert 1 <= len(cycle.goals) <= 3 and len(set(cycle.goals)) == len(cycle.goals)
        assert set(cycle.goals) <= set(PLACES)
        assert all(0.0 <= pause <= 2.0 for pause in cycle.pauses)
        assert (cycle.victim in ROBOTS) if cycle.how else cycle.victim == ""


def test_each_way_to_leave_is_drawn_and_most_requests_are_cancelled() -> None:
    drawn = cycles(2)
    assert {cycle.how for cycle in drawn} == {"kill", "stop", "out", ""}
    assert {cycle.victim for cycle in drawn if cycle.how} == set(ROBOTS)
    assert len(drawn) / 2 < sum(cycle.cancel for cycle in drawn) < len(drawn)


def test_one_place_is_enough() -> None:
    assert draw(random.Random(0), ROBOTS, ["hall"], 1.0).goals == ["hall"]


def test_facts_are_read() -> None:
    assert arguments_of(["(visited hall)", "(available ann)"]) == ["hall", "ann"]
    assert places_of([]) == {}
    assert places_of(["(robot_at ann hall)", "(robot_at bob yard)"]) == {"ann": ["hall"], "bob": ["yard"]}
    assert places_of(["(robot_at ann hall)", "(robot_at ann yard)"]) == {"ann": ["hall", "yard"]}, "a fault"


@pytest.mark.parametrize(
    ("names", "doubled"),
    [([], []), (["ann", "bob"], []), (["bob", "ann", "bob", "ann", "bob"], ["ann", "bob"])],
)
def test_names_that_occur_twice(names: List[str], doubled: List[str]) -> None:
    assert twice(names) == doubled


def test_each_of_several_requests_is_sent_before_something_is_done_to_it() -> None:
    chance = random.Random(1)
    drawn = [draw_joint(chance, PLACES, 2.0, kills=0.5) for _ in range(300)]
    again = random.Random(1)
    assert drawn == [draw_joint(again, PLACES, 2.0, kills=0.5) for _ in range(300)]
    for cycle in drawn:
        sent = [deed.request for deed in cycle.deeds if deed.do == "send"]
        assert sent == list(range(len(cycle.requests))) and len(sent) > 1
        for number, deed in enumerate(cycle.deeds):
            assert 0.0 <= deed.pause <= 2.0
            before = [each.request for each in cycle.deeds[: number + 1] if each.do == "send"]
            assert deed.request in before
    assert {deed.do for cycle in drawn for deed in cycle.deeds} == {"send", "cancel", "fact", "kill"}
    assert all(sum(deed.do == "kill" for deed in cycle.deeds) <= 1 for cycle in drawn)
    assert all(deed.do != "kill" for deed in draw_joint(chance, PLACES, 2.0).deeds)
    options = {option for cycle in drawn for request in cycle.requests for option in request}
    assert options == {"goals", "deadline", "not_before", "priority", "on_interrupt", "alone", "survives"}


@pytest.mark.parametrize(
    ("outcome", "options", "cancelled", "facts", "wrong"),
    [
        ("SUCCEEDED", {}, False, ["(checked p1)"], False),
        ("ALREADY_TRUE", {}, True, ["(checked p2)"], True),
        ("CANCELLED", {}, True, [], False),
        ("CANCELLED", {}, False, [], True),
        ("LATE", {"deadline": 5.0}, False, [], False),
        ("LATE", {}, False, [], True),
        ("ACTION_FAILED", {}, False, [], False),
        ("INTERNAL", {}, False, [], True),
        ("CANCEL_TIMEOUT", {}, True, [], True),
    ],
)
def test_an_end_that_is_not_true_is_seen(
    outcome: str, options: Dict[str, float], cancelled: bool, facts: List[str], wrong: bool
) -> None:
    said = untrue(outcome, "why", {"goals": "(checked p1)", **options}, cancelled, facts)
    assert bool(said) == wrong


@pytest.mark.parametrize(
    ("options", "cancelled", "killed", "wrong"),
    [
        ({}, False, True, False),
        ({}, False, False, True),
        ({"survives": True}, False, True, True),
        ({"survives": True}, True, True, False),
    ],
)
def test_only_a_request_that_survives_does_not_end_with_its_executor(
    options: Dict[str, bool], cancelled: bool, killed: bool, wrong: bool
) -> None:
    said = untrue("INTERNAL", "it died", {"goals": "(checked p1)", **options}, cancelled, [], killed)
    assert bool(said) == wrong
