# SPDX-License-Identifier: Apache-2.0
"""Which facts about available robots are written, also when the knowledge base refuses or hangs meanwhile."""

from typing import List, Tuple

import pytest

from merlin_actions.core.availability import Availability


@pytest.fixture
def robots() -> Availability:
    known = Availability()
    known.put("ann", True)
    known.put("bob", False)
    return known


def write(known: Availability) -> List[Tuple[str, bool]]:
    """Writes all that is pending."""
    changes = sorted(known.changes().items())
    for robot, available in changes:
        known.wrote(robot, available)
    return changes


def test_only_changes_are_written(robots: Availability) -> None:
    assert robots.pending and not robots.is_written("ann")
    assert write(robots) == [("ann", True), ("bob", False)]
    assert not robots.pending and robots.is_written("ann")
    robots.put("ann", True)
    assert not robots.pending
    robots.put("ann", False)
    assert write(robots) == [("ann", False)]


def test_what_could_not_be_written_stays_pending(robots: Availability) -> None:
    assert robots.changes() == {"ann": True, "bob": False}
    robots.wrote("bob", False)  # and the knowledge base is gone before the other one
    assert robots.pending and not robots.is_written("ann")
    assert write(robots) == [("ann", True)]


def test_a_change_during_the_writing_is_written_next(robots: Availability) -> None:
    changes = robots.changes()
    robots.put("ann", False)
    for robot, available in changes.items():
        robots.wrote(robot, available)
    assert robots.pending
    assert write(robots) == [("ann", False)]


def test_listed_robots_without_a_message_are_not_available(robots: Availability) -> None:
    write(robots)
    robots.settle()
    assert robots.pending and robots.unsettled
    robots.compare(["ann", "carl"])
    assert not robots.unsettled
    assert write(robots) == [("carl", False)]
    robots.put("carl", True)
    assert write(robots) == [("carl", True)], "its first message comes late"


def test_a_listed_robot_is_written_again_after_a_failure(robots: Availability) -> None:
    write(robots)
    robots.settle()
    robots.compare(["carl"])
    assert robots.changes() == {"carl": False}  # and the knowledge base is gone
    assert robots.pending, "settling is not over before it is written"
    assert write(robots) == [("carl", False)]


def test_what_is_lost_is_written_again(robots: Availability) -> None:
    write(robots)
    robots.forget(["ann", "carl"])
    assert robots.pending and not robots.is_written("ann")
    assert write(robots) == [("ann", True)], "bob is out, carl was never heard"
    robots.forget()
    assert not robots.unsettled, "robots without a message may still come"
    assert write(robots) == [("ann", True)]


def test_robots_are_compared_again_with_a_knowledge_base_that_has_begun_anew(robots: Availability) -> None:
    robots.settle()
    robots.compare([])
    write(robots)
    robots.forget()
    assert robots.unsettled
    robots.compare(["bob"])  # so it is in the problem
    assert write(robots) == [("ann", True), ("bob", False)]


def test_a_robot_that_is_not_known_counts_as_written(robots: Availability) -> None:
    assert robots.is_written("dora")


def test_robots_that_come_and_go_for_ever_are_not_remembered() -> None:
    known = Availability()
    known.put("ann", True)
    for number in range(20):
        for available in (True, False):
            known.put(f"guest{number}", available)
            write(known)
    assert known.robots == {"ann"}
