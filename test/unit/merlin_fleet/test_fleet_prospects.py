# SPDX-License-Identifier: Apache-2.0
"""What is said of an open goal: which robots do not do it, and when none does."""

from merlin_fleet.core import records
from merlin_fleet.core.records import Bid, Bids, Claim, Goal, Keys, Profile, Report
from merlin_fleet.core.store import Change
from merlin_fleet.core.view import FleetView
from merlin_fleet.prospects import hopeless, remarks

KEYS = Keys("lab")
NONE = "no robot that is joined can do it"


class Lab:
    """A view of a fleet with one goal."""

    def __init__(self, **wanted: object) -> None:
        self.goal = Goal("g1", ("(done)",), 0.0, **wanted)  # type: ignore[arg-type]
        self.view = FleetView(KEYS)
        self.revision = 0
        self.put(records.encode(self.goal), records.GOALS, "g1")

    def put(self, text: str, *names: str) -> None:
        self.revision += 1
        self.view.apply([Change(KEYS.key(*names), text, self.revision)])

    def join(self, name: str, *capabilities: str) -> None:
        self.put(records.encode(Profile(name, (), capabilities)), records.ROBOTS, name)
        self.put(records.encode(Claim(name, name)), records.LIVES, name)

    def bid(self, name: str, bids: Bids) -> None:
        self.put(records.encode_bids(bids), records.BIDS, name)


def test_without_robots() -> None:
    lab = Lab()
    assert hopeless(lab.view, lab.goal) == "no robot is joined"
    assert remarks(lab.view, lab.goal) == {}


def test_robots_that_lack_something_need_not_say_so() -> None:
    lab = Lab(needs=("arm",))
    lab.join("ann")
    assert hopeless(lab.view, lab.goal) == NONE
    assert remarks(lab.view, lab.goal) == {"ann": "it needs arm"}
    lab.join("bob", "arm")
    assert hopeless(lab.view, lab.goal) == "", "bob has not said anything yet"


def test_a_robot_that_has_enough_to_do_may_take_it_later() -> None:
    lab = Lab()
    lab.join("ann")
    lab.bid("ann", Bids({"g1": Bid(None, "no plan")}))
    assert hopeless(lab.view, lab.goal) == NONE
    lab.join("bob")
    lab.bid("bob", Bids({}, "it has enough to do"))
    assert hopeless(lab.view, lab.goal) == ""
    assert remarks(lab.view, lab.goal) == {"ann": "no plan", "bob": "it has enough to do"}
    lab.bid("bob", Bids({"g1": Bid(5.0, "it plans with old facts")}))
    assert hopeless(lab.view, lab.goal) == ""
    lab.bid("bob", Bids({"g1": Bid(None)}))
    assert hopeless(lab.view, lab.goal) == NONE


def test_each_robot_tries_a_goal_once() -> None:
    lab = Lab(tries=3)
    lab.join("ann")
    report = Report("g1", "ann", 5, "ACTION_FAILED", "the door is shut", 1.0)
    lab.put(records.encode(report), records.FAILURES, "ann", "g1", "5")
    assert hopeless(lab.view, lab.goal) == NONE
    assert remarks(lab.view, lab.goal) == {"ann": "it has tried: ACTION_FAILED, the door is shut"}
