# SPDX-License-Identifier: Apache-2.0
"""Facts that robots share: one writer each, and a robot that says when it plans with old ones."""

from typing import List, Optional

import fleet_world as model
import pytest

from merlin_fleet.core import events as ev
from merlin_fleet.core import records
from merlin_fleet.core.records import Facts
from merlin_fleet.core.sharing import GRACE, MOST_FACTS
from merlin_fleet.core.store import Put, Txn

DOOR = "door_open"
LIMIT = 20.0  # s
RULES = model.RULES._replace(facts={DOOR: "r0"}, fact_limit=LIMIT)
OLD = f"it plans with old facts: '{DOOR}' of r0 may be older than 20 s"
AGAIN = f"'{DOOR}' of r0 is received again"


class Doors(model.World):
    """A writer, r0, and a reader, r1."""

    def __init__(self) -> None:
        super().__init__(2, RULES)

    def know(self, *facts: str, version: int = 1, robot: int = 0) -> None:
        """The knowledge base of a robot has these facts."""
        self.robots[robot].inbox.append(ev.Known(DOOR, facts, version))

    def go(self, rounds: int) -> None:
        """Time passes."""
        for _ in range(rounds):
            self.act()

    def said(self) -> List[str]:
        """What the reader has said of the facts."""
        return [text for _, text in self.robots[1].said if DOOR in text]

    def records(self) -> List[Facts]:
        """What was written."""
        found = [change for change in self.store.changes if "/facts/" in change.key]
        return [records.decode(Facts, change.value or "") for change in found]


@pytest.fixture
def doors() -> Doors:
    world = Doors()
    world.know("ward", "lab main", version=7)
    world.go(6)
    return world


def test_facts_are_written_once_and_learned(doors: Doors) -> None:
    reader = doors.robots[1]
    assert reader.learned == [ev.Learn(DOOR, ("ward", "lab main"))]
    doors.know("ward", version=9)
    doors.go(30)
    assert reader.learned[1:] == [ev.Learn(DOOR, ("ward",))]
    assert [(facts.version, facts.robot, facts.life) for facts in doors.records()] == [
        (7, "r0", "r0.1"),
        (9, "r0", "r0.1"),
    ]
    assert doors.said() == []
    assert not doors.robots[0].learned, "the writer knows it itself"


@pytest.mark.parametrize("fault", [("cut", "0"), ("kill", "0"), ("cut", "1"), ("hub down",)])
def test_old_facts_are_named_before_they_are_older_than_the_limit(doors: Doors, fault: tuple) -> None:
    doors.strike(fault)
    began = doors.now
    doors.go(40)
    ((moment, text),) = [each for each in doors.robots[1].said if DOOR in each[1]]
    assert text == OLD
    assert began < moment <= began + LIMIT
    assert doors.robots[1].agent.sharing.stale == (OLD.partition(": ")[2],)
    doors.strike({"cut": ("mend", fault[-1]), "kill": ("restart", "0")}.get(fault[0], ("hub up",)))
    doors.go(10)
    if fault[0] == "kill":
        assert doors.said() == [OLD], "its new life has not read its knowledge base yet"
        doors.know("ward")
        doors.go(10)
    assert doors.said() == [OLD, AGAIN]
    assert doors.robots[1].agent.sharing.stale == ()


def test_a_writer_without_its_knowledge_base_does_not_vouch(doors: Doors) -> None:
    doors.robots[0].inbox.append(ev.Known(DOOR, None, 7))
    doors.go(30)
    assert doors.records()[-1] == Facts("r0", DOOR, ("ward", "lab main"), 7, "")
    assert doors.said() == [OLD]
    assert len(doors.robots[1].learned) == 1, "what was known is not forgotten"


def test_too_many_facts_are_not_shared(doors: Doors) -> None:
    doors.know(*(f"d{number}" for number in range(MOST_FACTS + 1)))
    doors.go(30)
    assert [text for _, text in doors.robots[0].said] == [
        f"{DOOR} is not shared: it has more than {MOST_FACTS} facts"
    ]
    assert doors.records()[-1].life == ""


def test_another_robot_cannot_write_it(doors: Doors) -> None:
    reader = doors.robots[1]
    for owner, robot in (("r1", "r1"), ("r1", "r0")):
        foreign = Facts(robot, DOOR, ("vault",), 1, f"{robot}.1")
        key = model.KEYS.key(records.FACTS, owner, DOOR)
        doors.store.transact(Txn((), (Put(key, records.encode(foreign)),)))
        doors.go(3)
    assert [each.facts for each in reader.learned] == [("ward", "lab main")]
    assert f"{key} is left alone: it is '{DOOR}' of r0" in [text for _, text in reader.said]


@pytest.mark.parametrize("written", [True, False])
def test_a_robot_that_begins_does_not_trust_what_it_finds(written: bool) -> None:
    world = Doors()
    world.strike(("kill", "0"))
    if written:
        facts = records.encode(Facts("r0", DOOR, ("ward",), 7, "r0.0"))
        world.store.transact(Txn((), (Put(model.KEYS.key(records.FACTS, "r0", DOOR), facts),)))
    world.go(int(GRACE) + 3)
    assert world.said() == [OLD]
    assert len(world.robots[1].learned) == written
    world.send("a", robot="r1")
    reason: Optional[str] = None
    for _ in range(10):
        world.act()
        bids = world.robots[1].agent.view.offers.of("r1")
        bid = bids.of.get("a") if bids is not None else None
        reason = bid.reason if bid is not None else reason
    assert reason == OLD.partition(": ")[2]
    assert world.settles() == "", "it bids, and says so"
