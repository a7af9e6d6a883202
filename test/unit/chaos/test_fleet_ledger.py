# SPDX-License-Identifier: Apache-2.0
"""The judge of make fleet: what it must find, and what is right."""

import pytest
from fleet.ledger import Ledger

GOALS = ("a", "b")


def done(ledger: Ledger, robot: str, goal: str, begun: float) -> None:
    ledger.begin(robot, goal, begun)
    ledger.end(robot, goal, begun + 1.0, "SUCCEEDED")


@pytest.fixture
def ledger() -> Ledger:
    made = Ledger()
    done(made, "ann", "a", 1.0)
    return made


def test_a_goal_that_was_stopped_or_lost_its_robot_and_is_done_by_another_one_is_right(
    ledger: Ledger,
) -> None:
    ledger.begin("ann", "b", 3.0)
    ledger.end("ann", "b", 4.0, "CANCELLED")
    ledger.begin("bob", "b", 5.0)
    assert ledger.next_begun("b", 3.5) == "bob"
    assert ledger.next_begun("b", 5.0) is None
    ledger.kill("bob", 6.0)
    done(ledger, "ann", "b", 7.0)
    assert ledger.mistakes(GOALS, {"a": "SUCCEEDED", "b": "SUCCEEDED"}) == []


def test_a_goal_that_has_not_ended_is_lost(ledger: Ledger) -> None:
    assert ledger.mistakes(GOALS, {"a": "SUCCEEDED"}) == ["b was lost: it has not ended"]


def test_a_goal_that_no_robot_did_is_not_done(ledger: Ledger) -> None:
    (found,) = ledger.mistakes(GOALS, {"a": "SUCCEEDED", "b": "SUCCEEDED"})
    assert found == "b was reported as done, and no robot did it"


def test_a_goal_that_was_done_twice_is_found(ledger: Ledger) -> None:
    done(ledger, "bob", "a", 9.0)
    assert ledger.mistakes(("a",), {"a": "SUCCEEDED"}) == ["a was done 2 times"]


def test_two_robots_at_once_are_found(ledger: Ledger) -> None:
    ledger.begin("ann", "b", 3.0)
    ledger.begin("bob", "b", 4.0)
    ledger.end("ann", "b", 5.0, "CANCELLED")
    found = ledger.mistakes(GOALS, {"a": "SUCCEEDED", "b": "MISSED"})
    assert found == ["b was executed by ann and bob at once", "bob still executes b"]


@pytest.mark.parametrize(("stops_after", "overlaps"), [(1.0, 0), (4.0, 1)])
def test_a_robot_that_hung_may_stop_for_a_moment_what_another_one_has(
    ledger: Ledger, stops_after: float, overlaps: int
) -> None:
    ledger.begin("ann", "b", 3.0)
    ledger.hang("ann")
    assert ledger.running("ann") == {"b"}
    ledger.begin("bob", "b", 20.0)
    ledger.resume("ann", 30.0)
    ledger.end("ann", "b", 30.0 + stops_after, "CANCELLED")
    ledger.end("bob", "b", 40.0, "SUCCEEDED")
    assert len(ledger.overlaps) == overlaps
    assert ledger.times_done("b") == 1


def test_a_robot_that_hung_and_goes_on_alone_is_right(ledger: Ledger) -> None:
    ledger.begin("ann", "b", 3.0)
    ledger.hang("ann")
    ledger.resume("ann", 13.0)
    ledger.end("ann", "b", 20.0, "SUCCEEDED")
    assert ledger.mistakes(GOALS, {"a": "SUCCEEDED", "b": "SUCCEEDED"}) == []


def test_what_a_hung_robot_had_begun_may_be_reported_late(ledger: Ledger) -> None:
    ledger.hang("ann")
    ledger.begin("ann", "b", 3.0)
    ledger.begin("bob", "b", 20.0)
    ledger.end("bob", "b", 24.0, "SUCCEEDED")
    ledger.resume("ann", 33.0)
    ledger.end("ann", "b", 33.5, "CANCELLED")
    assert ledger.mistakes(GOALS, {"a": "SUCCEEDED", "b": "SUCCEEDED"}) == []
