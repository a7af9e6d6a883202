# SPDX-License-Identifier: Apache-2.0
"""What robots say of themselves, and stops that clients ask for."""

from typing import Any, Dict

import fleet_world as model
from fakes.simulated_store import SimulatedStore

from merlin_fleet.core import events as ev
from merlin_fleet.core import records
from merlin_fleet.core.records import LONGEST_RECORD, Halt, Schema, Status
from merlin_fleet.core.store import Put, Txn
from merlin_fleet.core.view import FleetView

HOME = Schema("(define (domain home) (:predicates (in_service)))", ("kitchen poi",))


class Lab(model.World):
    """One robot, r0, and those who look at it."""

    def __init__(self) -> None:
        super().__init__(1)
        self.go(6)

    def tell(self, kind: str, record: Any) -> None:
        """The robot says something of itself."""
        self.robots[0].inbox.append(ev.Tell(kind, record))
        self.go(4)

    def go(self, rounds: int) -> None:
        """Time passes."""
        for _ in range(rounds):
            self.act()

    def stop(self, by: str = "Ana") -> None:
        """A client stops the robot."""
        put = Put(model.KEYS.key(records.HALTS, "r0"), records.encode(Halt(by, self.now)))
        self.store.transact(Txn(puts=(put,)))

    def view(self) -> FleetView:
        """What clients see."""
        return FleetView.of(model.KEYS, self.store.snapshot())

    def writes(self) -> Dict[str, int]:
        """How often each kind was written."""
        kinds = [model.KEYS.parts(change.key)[0] for change in self.store.changes]
        return {kind: kinds.count(kind) for kind in (records.SCHEMAS, records.STATUS)}


def test_what_it_says_is_written_once_and_stays() -> None:
    lab = Lab()
    lab.tell(records.SCHEMAS, HOME)
    lab.tell(records.STATUS, Status(("ask p=hall",), at=1.0))
    lab.tell(records.STATUS, Status(at=2.0))
    lab.go(20)
    assert (lab.view().schemas, lab.view().status) == ({"r0": HOME}, {"r0": Status(at=2.0)})
    assert lab.writes() == {records.SCHEMAS: 1, records.STATUS: 2}
    ends = (model.KEYS.robots_end, model.KEYS.clients_end)
    assert all(ends[0] < model.KEYS.key(kind) < ends[1] for kind in lab.writes()), "only clients follow it"
    assert model.KEYS.key(records.HALTS) < ends[0]


def test_what_is_said_without_the_hub_comes_later() -> None:
    lab = Lab()
    lab.strike(("cut", "0"))
    lab.go(2)
    lab.tell(records.STATUS, Status(at=1.0))
    lab.tell(records.STATUS, Status(at=2.0))
    assert lab.view().status == {}
    lab.strike(("mend", "0"))
    lab.go(8)
    assert lab.view().status == {"r0": Status(at=2.0)}


def test_what_is_too_long_for_the_hub_is_named_and_not_written() -> None:
    lab = Lab()
    lab.tell(records.SCHEMAS, Schema("x" * LONGEST_RECORD))
    assert lab.view().schemas == {}
    assert any("does not get the schemas of this robot" in text for _, text in lab.robots[0].said)


def test_what_the_hub_does_not_allow_keeps_nothing_else() -> None:
    lab = Lab()
    lab.robots[0].inbox.append(ev.Refused("permission denied", "tell status"))
    lab.send("a")
    lab.go(20)
    assert any("run `keys allow`" in text for _, text in lab.robots[0].said)
    assert not lab.robots[0].agent.denied
    assert lab.succeeded == [("a", "r0")]


def test_a_stop_is_obeyed_once_and_removed() -> None:
    lab = Lab()
    lab.stop()
    assert lab.view().halts["r0"].by == "Ana"
    lab.go(10)
    assert lab.robots[0].halts == ["Ana"]
    assert lab.view().halts == {}
    lab.stop("Bo")
    lab.go(10)
    assert lab.robots[0].halts == ["Ana", "Bo"]


def test_a_robot_that_was_away_obeys_when_it_is_back() -> None:
    lab = Lab()
    lab.strike(("kill", "0"))
    lab.stop()
    lab.go(3)
    assert "r0" in lab.view().halts
    lab.strike(("restart", "0"))
    lab.go(3)
    assert lab.robots[0].halts == ["Ana"], "it does not wait until the lease of its earlier process ends"


def test_a_stop_of_another_hub_confirms_none_of_this_one() -> None:
    lab = Lab()
    lab.store.revision += 1000  # the revisions of the next hub are lower
    lab.stop()
    stop = lab.store.revision
    lab.go(4)
    lab.tell(records.STATUS, Status(stop=stop, at=1.0))
    assert lab.view().status["r0"].stop == stop
    lab.strike(("hub down",))
    lab.go(1)
    lab.store, lab.robots[0].heard = SimulatedStore(), False
    lab.strike(("hub up",))
    lab.go(20)
    assert lab.view().status == {"r0": Status(at=1.0)}
    lab.tell(records.STATUS, Status(stop=stop, at=2.0))
    assert lab.view().status == {"r0": Status(at=2.0)}
    lab.robots[0].inbox.append(ev.Obeyed(stop))  # its guard confirms it only now
    lab.stop("Bo")
    assert lab.store.revision < stop
    lab.go(4)
    assert lab.robots[0].halts == ["Ana", "Bo"]
    assert lab.view().halts == {}


def test_a_forgotten_robot_that_comes_back_says_again_what_it_has_said() -> None:
    lab = Lab()
    lab.tell(records.SCHEMAS, HOME)
    lab.strike(("cut", "0"))
    lab.go(20)
    lab.forget(lab.robots[0])
    assert lab.view().schemas == {}
    lab.robots[0].linked = True  # its watch goes on where it was
    lab.go(20)
    assert "r0" in lab.view().lives
    assert lab.view().schemas == {"r0": HOME}


def test_who_forgets_a_robot_forgets_what_it_has_said() -> None:
    lab = Lab()
    lab.tell(records.SCHEMAS, HOME)
    lab.tell(records.STATUS, Status(at=1.0))
    lab.strike(("kill", "0"))
    lab.go(20)
    lab.stop()
    lab.forget(lab.robots[0])
    assert (lab.view().schemas, lab.view().status, lab.view().halts) == ({}, {}, {})
