# SPDX-License-Identifier: Apache-2.0
"""A robot whose drive was stopped at a point of interest keeps that place, as far as the plan goes too."""

import threading
from types import SimpleNamespace
from typing import Dict, List, Sequence, Set

import pytest
from diagnostic_msgs.msg import KeyValue
from rosplan_knowledge_msgs.msg import KnowledgeItem

from merlin_actions.core.ending import Closing
from merlin_actions.effects import Effects, Opening
from merlin_actions.stopped_robots import EffectsOfDrives, StoppedRobots
from merlin_planning.knowledge_client import REMOVE, Update, fact
from merlin_planning.knowledge_text import to_pddl
from merlin_ros.service_proxy import ServiceUnavailable
from merlin_test import LONG

STOPPED_AT = ["(not (robot_at ?r anywhere))", "(robot_at ?r ?here)", "(not (free ?here))"]


class Knowledge:
    """A set of facts about a kitchen and a hall; the attic is not an object of the plan."""

    def __init__(self, *facts: str) -> None:
        self.facts: Set[str] = set(facts)
        self.silent = False

    def instances(self) -> List[str]:
        if self.silent:
            raise ServiceUnavailable("it is being started again")
        return ["ann", "bob", "kitchen", "hall", "anywhere"]

    def query(self, items: Sequence[KnowledgeItem]) -> List[bool]:
        return [(_positive(item) in self.facts) != bool(item.is_negative) for item in items]

    def update(self, updates: Sequence[Update]) -> None:
        for update in updates:
            change = self.facts.discard if update.kind == REMOVE else self.facts.add
            change(to_pddl(update.item))


def _positive(item: KnowledgeItem) -> str:
    return to_pddl(fact(item.attribute_name, *(value.value for value in item.values)))


class Drive(Effects):
    """The drive of a robot, without a declaration of what holds when it stopped at a point."""

    def __init__(self, knowledge: Knowledge) -> None:
        self._facts = knowledge

    def open(self, opening: Opening) -> None:
        start, goal = (parameter.value for parameter in opening.parameters[1:])
        self._facts.facts -= {f"(robot_at {opening.robot} {start})", f"(free {goal})"}
        self._facts.facts |= {f"(free {start})"} - {"(free anywhere)"}

    def close(self, opening: Opening, closing: Closing, on_gone: object = None) -> None:
        goal = opening.parameters[2].value
        if closing is Closing.END:
            self._facts.facts |= {f"(robot_at {opening.robot} {goal})"}
        else:
            self._facts.facts |= {f"(robot_at {opening.robot} anywhere)", f"(free {goal})"}


class Home:
    """Two robots that drive; ``stands`` is where they are in truth."""

    def __init__(self, *facts: str) -> None:
        self.knowledge = Knowledge(*facts)
        self.stands: Dict[str, List[str]] = {}
        robots = StoppedRobots(self.knowledge, lambda robot: self.stands.get(robot, []))  # type: ignore[arg-type]
        self._effects = EffectsOfDrives(Drive(self.knowledge), robots)

    def drive(self, robot: str, start: str, goal: str, declared: Sequence[str] = STOPPED_AT) -> Opening:
        parameters = [KeyValue("r", robot), KeyValue("from", start), KeyValue("to", goal)]
        opening = Opening(parameters, robot, "/bridges", [], [], [], robot, declared)
        self._effects.open(opening)
        return opening

    def end(self, drive: Opening, closing: Closing = Closing.INTERRUPT) -> None:
        self._effects.close(drive, closing, lambda: None)


@pytest.fixture()
def home() -> Home:
    return Home("(robot_at ann hall)", "(robot_at bob anywhere)", "(free kitchen)")


@pytest.mark.parametrize("points", [["kitchen"], ["attic", "kitchen"], ["kitchen", "hall"]])
def test_a_robot_that_was_stopped_at_a_point_holds_it(home: Home, points: List[str]) -> None:
    drive = home.drive("ann", "hall", "kitchen")
    home.stands["ann"] = points
    home.end(drive)
    assert home.knowledge.facts == {"(robot_at ann kitchen)", "(robot_at bob anywhere)", "(free hall)"}


@pytest.mark.parametrize("points", [[], ["attic"]])
def test_elsewhere_it_is_where_its_action_says(home: Home, points: List[str]) -> None:
    drive = home.drive("ann", "hall", "kitchen")
    home.stands["ann"] = points
    home.end(drive)
    assert {"(robot_at ann anywhere)", "(free kitchen)", "(free hall)"} <= home.knowledge.facts


def test_a_robot_that_has_just_set_off_still_holds_where_it_was(home: Home) -> None:
    drive = home.drive("ann", "hall", "kitchen")
    home.stands["ann"] = ["hall"]
    home.end(drive)
    assert {"(robot_at ann hall)", "(free kitchen)"} <= home.knowledge.facts
    assert "(free hall)" not in home.knowledge.facts


def test_a_drive_that_has_ended_and_one_that_declares_nothing_change_no_more(home: Home) -> None:
    home.stands["ann"] = ["hall"]
    home.end(home.drive("ann", "hall", "kitchen"), Closing.END)
    assert "(robot_at ann kitchen)" in home.knowledge.facts
    home.end(home.drive("ann", "kitchen", "hall", []))
    assert {"(robot_at ann anywhere)", "(free hall)"} <= home.knowledge.facts


def test_a_place_that_another_robot_drives_to_is_held_once_that_one_was_stopped(home: Home) -> None:
    """Both drives of a plan are cancelled at once: the order in which they end does not matter."""
    to_hall = home.drive("ann", "hall", "kitchen")
    other = home.drive("bob", "anywhere", "hall")
    home.stands["ann"] = ["hall"]
    home.end(to_hall)
    assert "(robot_at ann anywhere)" in home.knowledge.facts
    home.end(other)
    assert {"(robot_at ann hall)", "(robot_at bob anywhere)"} <= home.knowledge.facts
    assert "(free hall)" not in home.knowledge.facts


def test_a_place_is_held_once_the_robot_there_has_left(home: Home) -> None:
    drive = home.drive("bob", "anywhere", "kitchen")
    home.stands["bob"] = ["hall"]
    home.end(drive)
    assert "(robot_at bob anywhere)" in home.knowledge.facts
    home.drive("ann", "hall", "kitchen")
    assert "(robot_at bob hall)" in home.knowledge.facts and "(free hall)" not in home.knowledge.facts


def test_a_robot_that_drives_again_holds_nothing(home: Home) -> None:
    drive = home.drive("bob", "anywhere", "kitchen")
    home.stands["bob"] = ["hall"]
    home.end(drive)
    home.drive("bob", "anywhere", "kitchen")
    home.end(home.drive("ann", "hall", "kitchen"), Closing.END)
    assert not any("bob" in fact for fact in home.knowledge.facts)
    assert "(free hall)" in home.knowledge.facts


def test_a_knowledge_base_that_does_not_answer_is_reported_later(home: Home) -> None:
    drive = home.drive("ann", "hall", "kitchen")
    home.stands["ann"] = ["kitchen"]
    home.knowledge.silent = True
    home.end(drive)
    assert "(robot_at ann anywhere)" in home.knowledge.facts
    home.knowledge.silent = False
    home.drive("bob", "anywhere", "hall")
    assert "(robot_at ann kitchen)" in home.knowledge.facts


def test_two_robots_that_stop_at_one_point_at_once_do_not_both_hold_it(home: Home) -> None:
    drives = [home.drive("ann", "hall", "kitchen"), home.drive("bob", "anywhere", "hall")]
    home.stands = {"ann": ["hall"], "bob": ["hall"]}
    threads = [threading.Thread(target=home.end, args=(drive,)) for drive in drives]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(LONG)
    held = [fact for fact in home.knowledge.facts if fact.endswith("hall)")]
    assert len(held) == 1 and held[0].startswith("(robot_at"), held


def test_a_drive_ends_though_the_points_of_interest_are_wrong(home: Home) -> None:
    """They are the user's: a list where names of points are expected, for example."""

    def points(robot: str) -> List[str]:
        raise AttributeError("'list' object has no attribute 'items'")

    home.stands = SimpleNamespace(get=lambda robot, default: points(robot))  # type: ignore[assignment]
    home.end(home.drive("ann", "hall", "kitchen"))
    assert "(robot_at ann anywhere)" in home.knowledge.facts
