# SPDX-License-Identifier: Apache-2.0
"""What the keys hold: read back as written, and refused where this version cannot know them."""

import pytest
from fakes.simulated_store import SimulatedStore

from merlin_fleet.core import events as ev
from merlin_fleet.core import records
from merlin_fleet.core.agent import Agent
from merlin_fleet.core.auction import AuctionTimes, Offers, take_at, unsuited
from merlin_fleet.core.records import Bid, Bids, Claim, Goal, Keys, Profile, RecordError, Report
from merlin_fleet.core.reporting import Outbox
from merlin_fleet.core.robot_lease import LeaseTimes, RobotLease
from merlin_fleet.core.store import Change, Item, Put, Snapshot, Txn, Unwritten
from merlin_fleet.core.view import FleetGoalState, FleetView

KEYS = Keys("lab")
GOAL = Goal("g1", ("(delivered box_1 ward_2)",), 12.5, "ana", deadline=99.0, groups=("carriers",), tries=2)


@pytest.mark.parametrize(
    "record",
    [
        GOAL,
        Goal("g2", (), 0.0),
        Claim("r1", "life", 7),
        Report("g1", "r1", 7, "SUCCEEDED", "", 1.0),
        Profile("r1", ("carriers",), ("arm",), "home", 5.0),
    ],
    ids=lambda record: type(record).__name__,
)
def test_a_record_is_read_as_it_was_written(record: tuple) -> None:
    assert records.decode(type(record), records.encode(record)) == record


def test_bids_are_read_as_they_were_written() -> None:
    bids = Bids({"g1": Bid(3.5), "g2": Bid(None, "no arm")}, "its battery is low")
    assert records.decode_bids(records.encode_bids(bids)) == bids


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("{", "not JSON"),
        ("[]", "not a JSON object"),
        ('{"protocol": 0, "id": "g1"}', "protocol 0"),
        ('{"protocol": 4, "id": "g1"}', "missing"),
        ('{"protocol": 4, "id": 5}', "'id' is 5"),
        ('{"protocol": 4, "colour": "red"}', "no 'colour'"),
        ('{"protocol": 4, "goals": ["a", 2]}', "not a list of texts"),
        ('{"protocol": 4, "finish": "yes"}', "'finish'"),
        ('{"protocol": 4, "value": true}', "'value'"),
        ('{"protocol": 4, "value": 1' + 400 * "0" + "}", "'value'"),
        ('{"protocol": 4, "sender": "\\ud800"}', "'sender'"),
        ('{"protocol": 4, "goals": ["\\ud800"]}', "not a list of texts"),
        (100_000 * "[", "not JSON"),
    ],
    ids=lambda text: text[:40],
)
def test_what_is_not_a_goal_is_refused(text: str, reason: str) -> None:
    with pytest.raises(RecordError, match=reason):
        records.decode(Goal, text)


@pytest.mark.parametrize(
    "text",
    [
        "5",
        '{"protocol": 4}',
        '{"protocol": 4, "bids": {"g": 5}}',
        '{"protocol": 4, "bids": {"g": [1' + 400 * "0" + ', ""]}}',
        '{"protocol": 4, "bids": {"g": [null, "\\ud800"]}}',
        '{"protocol": 4, "bids": {}, "reason": "\\ud800"}',
    ],
    ids=lambda text: text[:40],
)
def test_what_is_not_bids_is_refused(text: str) -> None:
    with pytest.raises(RecordError):
        records.decode_bids(text)


@pytest.mark.parametrize(
    "text", ["{", "5", 100_000 * "[", '{"at": 1' + 400 * "0" + "}", '{"at": "noon"}'], ids=len
)
def test_a_cancel_counts_whatever_it_says(text: str) -> None:
    assert records.decode_cancel(text) == 0.0


@pytest.mark.parametrize("name", ["", "a/b", "../x", "a b", "ä", "x" * 65])
def test_a_name_that_cannot_be_a_key_is_refused(name: str) -> None:
    with pytest.raises(RecordError):
        Keys(name)


def test_the_view_follows_a_goal_and_leaves_out_what_it_cannot_read() -> None:
    goal, broken = KEYS.key("goals", "g1"), KEYS.key("goals", "g2")
    items = (
        Item(goal, records.encode(GOAL), 5),
        Item(broken, '{"protocol": 9}', 6),
        Item("/other/key", "x", 6),
    )
    view = FleetView.of(KEYS, Snapshot(8, items))
    assert view.revision == 8
    assert view.state("g1") is FleetGoalState.OPEN
    assert view.state("g2") is FleetGoalState.UNKNOWN
    assert list(view.unreadable) == [broken]
    view.apply([Change(KEYS.key("claims", "r1", "g1"), records.encode(Claim("r1", "x")), 9)])
    assert view.state("g1") is FleetGoalState.OWNED
    assert view.claims["g1"].epoch == 9
    view.apply([Change(KEYS.key("cancels", "g1"), "{}", 10)])
    assert view.state("g1") is FleetGoalState.CANCELLING
    view.apply([Change(KEYS.key("claims", "r1", "g1"), None, 11)])
    assert view.state("g1") is FleetGoalState.CANCELLED
    end = Report("g1", "r1", 9, "SUCCEEDED", "", 1.0)
    view.apply([Change(KEYS.key("ends", "r1", "g1"), records.encode(end), 12), Change(broken, None, 12)])
    assert view.state("g1") is FleetGoalState.ENDED
    assert not view.unreadable


def test_what_a_robot_writes_of_the_goal_of_another_one_is_left_alone() -> None:
    claims = {robot: KEYS.key("claims", robot, "g1") for robot in ("r1", "r2")}
    end = Report("g1", "r1", 6, "SUCCEEDED", "", 1.0)
    items = (
        Item(claims["r1"], records.encode(Claim("r1", "x")), 7),
        Item(claims["r2"], records.encode(Claim("r2", "y")), 6),
        Item(KEYS.key("goals", "g1"), records.encode(GOAL), 5),
    )
    view = FleetView.of(KEYS, Snapshot(8, items))
    assert view.claims["g1"].robot == "r2"
    view.apply([Change(KEYS.key("ends", "r1", "g1"), records.encode(end), 9), Change(claims["r1"], None, 10)])
    assert view.state("g1") is FleetGoalState.OWNED
    assert view.unreadable == {KEYS.key("ends", "r1", "g1"): "r2 owns the goal"}
    view.apply([Change(KEYS.key("late", "r2", "g1.6"), records.encode(end), 11)])
    assert view.unreadable[KEYS.key("late", "r2", "g1.6")] == "it is of r1"


@pytest.mark.parametrize(
    "key", [("claims", "g1"), ("ends", "g1"), ("failures", "g1", "5"), ("claims", "r1", "g1")]
)
def test_a_goal_with_records_that_cannot_be_read_is_not_open(key: tuple) -> None:
    view = FleetView.of(KEYS, Snapshot(8, (Item(KEYS.key("goals", "g1"), records.encode(GOAL), 5),)))
    view.apply([Change(KEYS.key(*key), '{"protocol": 1}', 9)])
    assert list(view.unreadable) == [KEYS.key(*key)]
    assert (view.state("g1") is FleetGoalState.OPEN) == (key[0] == "failures")
    view.apply([Change(KEYS.key(*key), None, 10)])
    assert view.state("g1") is FleetGoalState.OPEN


@pytest.mark.parametrize(
    ("goal", "why"),
    [
        (Goal("g", (), 0.0), ""),
        (Goal("g", (), 0.0, robot="r2"), "for the robot r2"),
        (Goal("g", (), 0.0, domain="restaurant"), "of the domain restaurant, the robot has home"),
        (Goal("g", (), 0.0, groups=("carriers", "guides")), ""),
        (Goal("g", (), 0.0, groups=("guides",)), "for robots of guides"),
        (Goal("g", (), 0.0, needs=("arm", "lift", "tray")), "needs lift, tray"),
    ],
)
def test_a_robot_knows_which_goals_it_cannot_do(goal: Goal, why: str) -> None:
    robot = Profile("r1", ("carriers",), ("arm",), "home")
    assert why in unsuited(goal, robot)
    assert bool(why) == bool(unsuited(goal, robot))


def test_the_cheapest_takes_a_goal_at_once_when_all_have_answered() -> None:
    times = AuctionTimes(window=1.0, step=2.0)
    offers = Offers()
    for robot, bid in {"r1": Bid(5.0), "r2": Bid(3.0), "r3": Bid(None, "busy")}.items():
        offers.put(robot, Bids({"g": bid}))
    assert take_at("g", "r2", offers, 3, 10.0, times) == 10.0
    assert take_at("g", "r1", offers, 3, 10.0, times) == 12.0
    assert take_at("g", "r3", offers, 3, 10.0, times) is None
    assert take_at("g", "r2", offers, 4, 10.0, times) == 11.0
    offers.put("r4", Bids({}, "it has enough to do"))
    assert take_at("g", "r2", offers, 4, 10.0, times) == 10.0
    offers.put("r1", Bids({"g": Bid(2.0)}))
    assert take_at("g", "r2", offers, 4, 10.0, times) == 12.0
    for robot in ("r1", "r3", "r4"):
        offers.remove(robot)
    assert take_at("g", "r2", offers, 1, 10.0, times) == 10.0
    offers.put("r2", Bids())
    assert take_at("g", "r2", offers, 1, 10.0, times) is None


def test_a_lease_ends_early_enough_for_stop_and_drift() -> None:
    robot_lease = RobotLease(LeaseTimes(ttl=20.0, renew_every=2.0, stop_time=6.0, drift=0.05))
    assert not robot_lease.holds(0.0)
    robot_lease.renew(7, 100.0, 20.0)
    assert robot_lease.holds(112.9)
    assert not robot_lease.holds(113.0)
    robot_lease.renew(7, 104.0, 20.0)
    robot_lease.renew(7, 102.0, 20.0)  # an answer that was overtaken shortens nothing
    assert robot_lease.holds(116.9)
    robot_lease.renew(7, 110.0, 10.0)  # the store keeps it for less than was agreed
    assert robot_lease.holds(119.4)
    assert not robot_lease.holds(119.5)
    robot_lease.lose()
    assert not robot_lease.holds(105.0)


def test_the_store_keeps_a_lease_as_long_as_its_goals_may_run_and_others_wait_for_the_stop() -> None:
    times = LeaseTimes(ttl=15.0, stop_time=6.0, drift=0.01)
    assert times.kept * (1 - times.drift) >= times.runs
    assert times.wait(times.ttl) * (1 - times.drift) >= times.ttl


def test_times_that_leave_no_time_to_run_are_refused() -> None:
    with pytest.raises(ValueError, match=r"10\.1 s is the least"):
        LeaseTimes(ttl=9.0, renew_every=2.0, stop_time=6.0).checked()


def test_a_goal_whose_id_is_no_word_is_left_alone_and_keeps_no_robot_from_others() -> None:
    store = SimulatedStore()
    store.transact(Txn((), (Put(KEYS.key("about"), records.encode_about("x")),)))
    for name in ("a b", "a c", "g1"):
        store.transact(Txn((), (Put(KEYS.key("goals", name), records.encode(GOAL._replace(id=name))),)))
    store.transact(Txn((), (Put(KEYS.key("cancels", "a d"), "{}"),)))
    view = FleetView.of(KEYS, store.snapshot())
    assert [name for *_, name in view.open] == ["g1"]
    assert [view.state(name) for name in ("a b", "g1")] == [FleetGoalState.UNKNOWN, FleetGoalState.OPEN]
    assert sorted(view.unreadable) == [
        KEYS.key(*key) for key in (("cancels", "a d"), ("goals", "a b"), ("goals", "a c"))
    ]
    assert not view.over


@pytest.mark.parametrize("version", [1, 2])
def test_a_hub_of_an_older_protocol_is_refused_with_one_message(version: int) -> None:
    def old(key: str, revision: int) -> Change:
        return Change(KEYS.root + key, f'{{"protocol": {version}, "id": "x"}}', revision)

    keys = ("about", "goals/g1", "claims/r2/g1", "tries/r2/g1/3", "marks/0/r2", "lives/r2", "bids/r2")
    items = tuple(Item(*old(key, number)) for number, key in enumerate(keys, 1))
    agent = Agent("lab", Profile("r1"), "life1", Outbox())
    decided = agent.handle(0.0, ev.Connected(Snapshot(9, items)))
    decided += agent.handle(1.0, ev.Changed((old("goals/g2", 10),)))
    decided += agent.handle(60.0)
    assert decided == [
        ev.Say(f"the hub is not used: it is of protocol {version}, this is protocol {records.PROTOCOL}")
    ]


def test_a_record_of_an_older_protocol_is_left_alone_with_one_message() -> None:
    agent = Agent("lab", Profile("r1"), "life1", Outbox())
    key = KEYS.key("goals", "g1")
    agent.handle(0.0, ev.Connected(Snapshot(9, (Item(KEYS.key("about"), records.encode_about("x"), 1),))))
    decided = agent.handle(1.0, ev.Changed((Change(key, '{"protocol": 1}', 10),))) + agent.handle(2.0)
    said = [decision.text for decision in decided if isinstance(decision, ev.Say)]
    assert said == [f"{key} is left alone: it is of protocol 1, this is protocol {records.PROTOCOL}"]


def test_marks_exclude_each_other_per_part() -> None:
    store = SimulatedStore()
    seen = store.transact(Txn((), (Put(KEYS.marks("g1") + "r1", "x"),))).revision
    assert store.transact(Txn((Unwritten(KEYS.marks("g1"), seen),))).done
    store.transact(Txn((), (Put(KEYS.marks("g1") + "r2", "x"),)))
    assert not store.transact(Txn((Unwritten(KEYS.marks("g1"), seen),))).done
    assert KEYS.marks("g1") != KEYS.marks("g2")
    assert store.transact(Txn((Unwritten(KEYS.marks("g2"), seen),))).done
    assert {KEYS.marks(f"g{n}") + "r1" for n in range(20)} <= set(KEYS.of_robot("r1"))


def test_robots_and_clients_follow_what_they_read() -> None:
    followed = [
        getattr(records, kind) for kind in ("ABOUT", "GOALS", "CLAIMS", "CANCELS", "ENDS", "FAILURES")
    ]
    followed += [records.LIVES, records.BIDS, records.LATE, records.FACTS]
    assert all(KEYS.key(kind) < KEYS.robots_end for kind in followed)
    assert KEYS.robots_end <= KEYS.key(records.ROBOTS) < KEYS.clients_end <= KEYS.key(records.TAKEN)
