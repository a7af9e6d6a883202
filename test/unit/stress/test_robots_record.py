# SPDX-License-Identifier: Apache-2.0
"""What robots were seen to do, against what the knowledge says; and what a stress test does is its seed's."""

import random

import pytest
from stress.robots_record import RobotsRecord
from stress.stress_cycles import draw

ROBOTS = ["ann", "bob"]


@pytest.fixture
def record():
    record = RobotsRecord(ROBOTS)
    record.begin()
    record.sent("ann", "g1", "kitchen", 1.0)
    record.carries_out("ann", ["g1"])
    record.moved("ann", True)
    record.running([("drive", "ann", "anywhere", "kitchen")])
    return record


def arrive(record):
    record.ended("ann", "g1", True)
    record.carries_out("ann", [])
    record.moved("ann", False)
    record.running([])
    record.rest(2.5)


def contradictions(record, ann="kitchen", bob="anywhere", visited=("kitchen",)):
    return list(record.contradictions({"ann": [ann], "bob": [bob]}, visited))


def test_what_fits_is_no_contradiction(record):
    assert record.restless == ["(drive ann anywhere kitchen) runs", "the base of ann has a goal", "ann moves"]
    arrive(record)
    assert record.restless == [] and record.wrong == []
    assert contradictions(record) == [] and contradictions(record, ann="anywhere") == []


def test_a_result_may_be_heard_before_its_goal():
    record = RobotsRecord(ROBOTS)
    record.begin()
    record.ended("ann", "g1", True)
    record.sent("ann", "g1", "kitchen", 1.0)
    assert contradictions(record) == []


def test_each_contradiction_is_one_sentence(record):
    arrive(record)
    assert contradictions(record, ann="hall") == [
        "ann is said to be at hall, and its last drive ended at kitchen"
    ]
    assert contradictions(record, visited=["hall"]) == [
        "hall is said to be visited, and no drive has ended there"
    ]
    assert list(record.contradictions({"ann": ["kitchen", "anywhere"]}, [])) == [
        "ann is at ['kitchen', 'anywhere']",
        "bob is at no place",
    ]
    record.begin()
    assert contradictions(record) == ["kitchen is said to be visited, and no drive has ended there"]
    record.sent("ann", "g2", "hall", 2.0)
    record.ended("ann", "g2", False)
    assert contradictions(record, visited=[]) == [
        "ann is said to be at kitchen, and its last drive ended at None"
    ]


def test_what_must_not_happen_is_noted(record):
    record.running([("drive", "ann", "a", "b"), ("drive", "bob", "a", "b"), ("drive", "ann", "b", "c")])
    record.carries_out("bob", ["g7", "g8"])
    arrive(record)
    record.moved("bob", True)
    record.sent("bob", "g8", "hall", 2.4)
    record.sent("bob", "g9", "hall", 3.0)
    assert [wrong.split(":")[0] for wrong in record.wrong] == [
        "two actions run on ann",
        "bob carries out 2 drives at once",
        "bob drives, and no plan is carried out",
        "the base of bob gets a goal, and no plan is carried out",
    ]


@pytest.mark.parametrize(
    "begin, moves, succeeds, found",
    [
        (2.4, True, False, ""),
        (3.0, False, False, ""),
        (3.0, True, False, "ann has moved, and no goal for that was on its way when its host hung"),
        (2.4, False, True, ""),
        (2.4, True, True, "ann has reached hall after its host hung, and no plan is carried out"),
    ],
)
def test_a_host_that_continues_moves_its_base_only_for_a_goal_that_was_on_its_way(
    record, begin, moves, succeeds, found
):
    arrive(record)
    record.rest(2.5, struck="ann")
    record.moved("ann", moves)
    assert bool(contradictions(record, ann="anywhere")) == moves, "the goal is not heard yet"
    record.sent("ann", "g2", "hall", begin)
    record.ended("ann", "g2", succeeds)
    record.moved("ann", False)
    assert contradictions(record, ann="anywhere") == [found][: bool(found)] and record.wrong == []
    record.begin()
    assert contradictions(record, ann="anywhere", visited=[]) == []


def test_a_goal_that_is_heard_before_its_base_has_it_was_on_its_way(record):
    arrive(record)
    record.sent("ann", "g2", "hall", 2.4)
    record.rest(2.5, struck="ann")
    record.moved("ann", True)
    record.moved("ann", False)
    record.ended("ann", "g2", False)
    assert contradictions(record, ann="anywhere") == [] == record.wrong


def test_a_host_that_was_killed_sends_no_goal_any_more(record):
    arrive(record)
    record.rest(2.5, struck="ann", killed=True)
    record.sent("ann", "g2", "hall", 2.4)
    assert record.wrong == []
    record.sent("ann", "g3", "hall", 3.0)
    assert record.wrong == ["the base of ann gets a goal, and no plan is carried out"]


def test_what_is_done_is_that_of_the_seed():
    def cycles(seed):
        chance = random.Random(seed)
        return [draw(chance, ROBOTS, ["kitchen", "hall"], 2.0) for _ in range(50)]

    assert cycles(4) == cycles(4) != cycles(5)
    assert {cycle.how for cycle in cycles(4)} == {"kill", "stop", "out", ""}
