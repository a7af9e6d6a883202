# SPDX-License-Identifier: Apache-2.0
"""Many robots and goals: what each of them computes and writes, and that the lists of a view are right."""

import importlib.util
import random
import sys
import threading
from pathlib import Path
from typing import Any, Callable, Dict, List

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from merlin_fleet.core import events as ev
from merlin_fleet.core import records
from merlin_fleet.core.auction import Offers, lot, order, unsuited
from merlin_fleet.core.records import Bid, Bids, Claim, Goal, Profile, Report
from merlin_fleet.core.retention import Keeper, Retention
from merlin_fleet.core.store import Change, Put, Snapshot, Txn
from merlin_fleet.core.view import FleetGoalState, FleetView
from merlin_fleet.event_inbox import EventInbox
from merlin_test import LONG

_SPEC = importlib.util.spec_from_file_location("fleet_crowd", Path(__file__).with_name("fleet_crowd.py"))
crowds = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(crowds)
KEYS, joined = crowds.KEYS, crowds.joined


def test_in_a_crowd_the_cheapest_does_it_though_few_bid() -> None:
    crowd = joined(30)
    before = crowd.written(records.BIDS)
    for number in range(10):
        crowd.send(1)
        crowd.until(lambda: crowd.written(records.ENDS) > number)  # noqa: B023
    assert dict(crowd.begun) == crowd.best
    assert crowd.written(records.BIDS) - before < 10 * 20, "all 30 bid for each"


def test_many_goals_are_done_once_each_with_few_writes() -> None:
    crowd = joined(30)
    before = len(crowd.store.changes)
    crowd.send(90)
    crowd.until(lambda: crowd.written(records.ENDS) == 90)
    assert sorted(goal for goal, _ in crowd.begun) == sorted(crowd.best)
    assert len({robot for _, robot in crowd.begun}) > 20, "most of the robots do some"
    assert len(crowd.store.changes) - before < 90 * 10


def test_robots_that_are_behind_do_not_make_it_worse() -> None:
    crowd = joined(30)
    crowd.behind = 8.0
    before = crowd.written(records.BIDS)
    crowd.send(30)
    crowd.until(lambda: crowd.written(records.ENDS) == 30)
    assert sorted(goal for goal, _ in crowd.begun) == sorted(crowd.best)
    assert crowd.written(records.BIDS) - before < 30 * 4, "they write again what they have not seen yet"
    assert crowd.lost_claims < 30, "they claim what they have not seen to be taken"


@pytest.mark.parametrize("wanted", [{"robot": "r3"}, {"needs": ("arm",)}])
@pytest.mark.parametrize("behind", [0.0, 1.0])
def test_a_goal_for_one_robot_is_not_lost_in_a_crowd(wanted: Dict[str, Any], behind: float) -> None:
    crowd = joined(12)
    crowd.behind = behind
    for number in range(12):  # of which the robot's lot leaves some to others
        goal = Goal(f"only{number}", ("(done)",), crowd.now, **wanted)
        crowd.store.transact(Txn((), (Put(KEYS.key(records.GOALS, goal.id), records.encode(goal)),)))
    crowd.send(60)
    crowd.until(lambda: crowd.written(records.ENDS) == 72)
    assert {robot for goal, robot in crowd.begun if goal.startswith("only")} == {"r3"}
    assert len(crowd.begun) == 72


def test_a_first_goal_whose_bidders_do_not_come_is_left_to_all() -> None:
    """The robots in whose share it is have bid, and their lease still runs."""
    crowd = joined(30)
    crowd.send(200)
    crowd.until(lambda: crowd.agents[0].view.offers.offered("g0"))
    gone = [a for a in crowd.agents if "g0" in (a.view.offers.of(a.robot.name) or Bids()).of]
    assert 0 < len(gone) < 20
    for agent in gone:
        agent.handle = lambda *_: []  # type: ignore[assignment]
    crowd.until(lambda: any(goal == "g0" for goal, _ in crowd.begun))


def calls(function: Callable[[], Any]) -> int:
    """How many functions are called, those of C too."""
    count = 0

    def see(_: Any, event: str, __: Any) -> None:
        nonlocal count
        count += event in ("call", "c_call")

    sys.setprofile(see)
    try:
        function()
    finally:
        sys.setprofile(None)
    return count


def test_what_a_change_costs_does_not_grow_with_the_goals() -> None:
    def cost(goals: int) -> int:
        crowd = joined(2)
        crowd.store.revoke(2)  # the other robot has left
        crowd.until(lambda: len(crowd.agents[0].view.lives) == 1)
        agent = crowd.agents[0]
        items = [Goal(f"g{n}", ("(done)",), 0.0, deadline=1e9 + n) for n in range(goals)]
        puts = [Change(KEYS.key(records.GOALS, goal.id), records.encode(goal), 1) for goal in items]
        agent.handle(crowd.now, ev.Changed(tuple(puts)))
        claim = records.encode(Claim("r7", f"life{goals}"))
        change = Change(KEYS.key(records.CLAIMS, "r7", f"g{goals - 1}"), claim, crowd.store.revision + 1)
        return calls(lambda: agent.handle(crowd.now, ev.Changed((change,))))

    assert cost(1000) <= cost(20) + 20


def test_a_look_for_old_goals_costs_little_while_none_is_due() -> None:
    def cost(goals: int) -> int:
        view = FleetView(KEYS)
        for number in range(goals):
            goal = Goal(f"g{number}", ("(done)",), 0.0)
            report = Report(goal.id, "r1", 1, "SUCCEEDED", "", 1.0)
            view.apply(
                [
                    Change(KEYS.key(records.GOALS, goal.id), records.encode(goal), 2 * number + 1),
                    Change(KEYS.key(records.ENDS, "r1", goal.id), records.encode(report), 2 * number + 2),
                ]
            )
        keeper = Keeper(Retention(hours=1.0))
        assert keeper.due(view, 0.0, 2.0) == []
        return calls(lambda: keeper.due(view, 60.0, 62.0))

    assert cost(1000) == cost(20)


# --- the lists are what the keys say ----------------------------------------------------------------

GOAL_NAMES = st.sampled_from("abcd")
ROBOT_NAMES = st.sampled_from(["r1", "r2", "r3"])
GOALS = st.builds(
    Goal,
    GOAL_NAMES,
    st.just(("(done)",)),
    st.floats(0.0, 9.0),
    deadline=st.none() | st.floats(0.0, 9.0),
    value=st.sampled_from([0.0, 1.0]),
    robot=st.sampled_from(["", "r1", "r2"]),
)
REPORTS = st.builds(Report, GOAL_NAMES, ROBOT_NAMES, st.just(1), st.just("FAILED"), st.just(""), st.just(0.0))
BID = st.builds(Bid, st.none() | st.sampled_from([1.0, 2.0, 3.0]), st.sampled_from(["", "no plan"]))
BIDS = st.builds(Bids, st.dictionaries(GOAL_NAMES, BID), st.sampled_from(["", "", "full"]))
KEY_AND_TEXT = st.one_of(
    GOALS.map(lambda goal: ((records.GOALS, goal.id), records.encode(goal))),
    st.tuples(GOAL_NAMES, ROBOT_NAMES).map(
        lambda it: ((records.CLAIMS, it[1], it[0]), records.encode(Claim(it[1], it[1])))
    ),
    GOAL_NAMES.map(lambda goal: ((records.CANCELS, goal), "{}")),
    REPORTS.map(lambda report: ((records.ENDS, report.robot, report.goal), records.encode(report))),
    REPORTS.map(lambda report: ((records.FAILURES, report.robot, report.goal, "1"), records.encode(report))),
    st.tuples(ROBOT_NAMES, BIDS).map(lambda it: ((records.BIDS, it[0]), records.encode_bids(it[1]))),
    ROBOT_NAMES.map(lambda name: ((records.LIVES, name), records.encode(Claim(name, name)))),
    GOAL_NAMES.map(lambda goal: ((records.GOALS, goal), "not a goal")),
)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.lists(st.tuples(KEY_AND_TEXT, st.booleans(), st.booleans()), max_size=40))
def test_the_lists_of_a_view_are_what_its_keys_say(steps: List[tuple]) -> None:
    robot = Profile("r1")
    view = FleetView(KEYS, robot)
    waiting: List[Change] = []
    for number, ((names, text), there, at_once) in enumerate(steps):
        waiting.append(Change(KEYS.key(*names), text if there else None, number + 1))
        if at_once:
            view.apply(waiting)
            waiting = []
    view.apply(waiting)
    is_open = [goal for goal in view.goals.values() if view.state(goal.id) is FleetGoalState.OPEN]
    suited = [goal for goal in is_open if not unsuited(goal, robot)]
    tried = {name for name, of in view.failures.items() if any(it.robot == "r1" for it in of.values())}
    assert view.open == sorted(order(goal) for goal in suited if goal.id not in tried)
    assert view.unsuited == sorted(order(goal) for goal in is_open if unsuited(goal, robot))
    over = {name: view.over_since(name) for name in {*view.goals, *view.cancels}}
    assert view.over == {name: at for name, at in over.items() if at is not None}
    assert view.due == sorted((goal.deadline, goal.id) for goal in is_open if goal.deadline is not None)
    owners = {(claim.robot, goal) for goal, claim in view.claims.items()}
    assert owners == {(name, goal) for name, goals in view.owned_by.items() for goal in goals}


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.lists(st.tuples(ROBOT_NAMES, st.none() | BIDS), max_size=20), BID, GOAL_NAMES)
def test_offers_are_ranked_as_when_they_are_all_compared(steps: List[tuple], mine: Bid, goal: str) -> None:
    offers, known = Offers(), {}  # type: Offers, Dict[str, Bids]
    for robot, bids in steps:
        if bids is not None:
            offers.put(robot, bids)
            known[robot] = bids
        elif robot in known:
            offers.remove(robot)
            del known[robot]
    costs = [(bids.of[goal].cost, lot(goal, name)) for name, bids in known.items() if goal in bids.of]
    own = (mine.cost or 0.0, lot(goal, "r9"))
    assert offers.cheaper(goal, "r9", own[0]) == sum(
        cost is not None and (cost, lo) < own for cost, lo in costs
    )
    assert offers.closed == sum(bool(bids.reason) for bids in known.values())
    assert offers.answers(goal) == offers.closed + len(costs)


# --- changes wait for each other --------------------------------------------------------------------


def change(key: str) -> Change:
    return Change(key, "x", 1)


def test_changes_come_as_one_event_and_urgent_ones_at_once() -> None:
    inbox = EventInbox(3600.0)
    inbox.put_changes((change("a"),), urgent=False)
    assert inbox.next(0.0) is None, "it waits for others"
    inbox.put_changes((change("b"),), urgent=True)
    inbox.put_changes((change("c"),), urgent=False)
    assert inbox.next(LONG) == ev.Changed((change("a"), change("b")))
    assert inbox.next(0.0) is None
    patient = EventInbox(0.01)
    patient.put_changes((change("a"),), urgent=False)
    assert patient.next(LONG) == ev.Changed((change("a"),))


def test_the_slower_decisions_are_the_more_changes_come_together() -> None:
    inbox = EventInbox(0.0)
    inbox.put_changes((change("a"),), urgent=False)
    assert inbox.next(0.0) == ev.Changed((change("a"),))
    inbox.took(3600.0)
    inbox.put_changes((change("b"),), urgent=False)
    assert inbox.next(0.0) is None, "it waits for others"
    inbox.put_changes((change("c"),), urgent=True)
    assert inbox.next(0.0) == ev.Changed((change("b"), change("c")))
    inbox.took(0.0)
    inbox.put_changes((change("d"),), urgent=False)
    assert inbox.next(0.0) == ev.Changed((change("d"),))


def test_changes_never_move_to_the_other_side_of_a_connection() -> None:
    inbox = EventInbox(3600.0)
    inbox.put_changes((change("old"),), urgent=False)
    connected = ev.Connected(Snapshot(5, ()))
    inbox.put(connected)
    inbox.put_changes((change("new"),), urgent=True)
    assert [inbox.next(LONG) for _ in range(3)] == [
        ev.Changed((change("old"),)),
        connected,
        ev.Changed((change("new"),)),
    ]


def test_a_thread_that_waits_is_woken() -> None:
    inbox, heard = EventInbox(0.01), []  # type: EventInbox, List[Any]
    thread = threading.Thread(target=lambda: heard.append(inbox.next(LONG)), name="waits", daemon=True)
    thread.start()
    inbox.put_changes((change("a"),), urgent=random.random() < 0.5)
    thread.join(LONG)
    assert heard == [ev.Changed((change("a"),))]
