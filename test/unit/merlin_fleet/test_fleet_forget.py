# SPDX-License-Identifier: Apache-2.0
"""What a robot that never comes back has left is removed, and nothing else, and only when it is gone."""

from typing import Any, Iterator, List, Tuple

import fleet_world as model
import pytest
from fakes.simulated_store import SimulatedStore

from merlin_fleet.commands.fleet_command import main
from merlin_fleet.core import records
from merlin_fleet.core.records import MARK_PARTS, Claim, Facts, Goal, Keys, Profile, Report
from merlin_fleet.core.store import Put, Txn, Unwritten
from merlin_fleet.core.view import FleetGoalState, FleetView
from merlin_fleet.forgetting import MOST, leavings
from merlin_fleet.hub import EtcdHub
from merlin_test.etcd_process import EtcdProcess

KEYS = Keys("lab")


def puts_of_ann(robot: str = "ann") -> List[Put]:
    """Goals of all kinds, and what a robot has written of them."""

    def report(goal: str) -> str:
        return records.encode(Report(goal, robot, 1, "SUCCEEDED", "", 1.0))

    def goal(name: str, **more: Any) -> str:
        return records.encode(Goal(name, ("(done)",), 1.0, **more))

    texts = {
        (records.ABOUT,): records.encode_about("x"),
        (records.GOALS, "owned"): goal("owned", finish=True),
        (records.GOALS, "stopped"): goal("stopped", finish=True),
        (records.GOALS, "done"): goal("done"),
        (records.GOALS, "tried"): goal("tried", tries=2),
        (records.GOALS, "hers"): goal("hers", robot=robot),
        (records.CANCELS, "stopped"): records.encode_cancel("desk", 1.0),
        (records.CLAIMS, robot, "owned"): records.encode(Claim(robot, "x")),
        (records.CLAIMS, robot, "stopped"): records.encode(Claim(robot, "x")),
        (records.ENDS, robot, "done"): report("done"),
        (records.ENDS, robot, "gone"): report("gone"),
        (records.FAILURES, robot, "tried", "1"): report("tried"),
        (records.FAILURES, robot, "gone", "1"): report("gone"),
        (records.LATE, robot, "gone.7"): report("gone"),
        (records.FACTS, robot, "door_open"): records.encode(Facts(robot, "door_open", ("a",), 1, "x")),
        (records.ROBOTS, robot): records.encode(Profile(robot, heard=1e9)),
        (records.TAKEN, MARK_PARTS[0], robot): "x",
        # Of another robot, which stays.
        (records.ENDS, "bob", "gone"): records.encode(Report("gone", "bob", 1, "SUCCEEDED", "", 1.0)),
        (records.ROBOTS, "bob"): records.encode(Profile("bob")),
        (records.TAKEN, MARK_PARTS[0], "bob"): "x",
    }
    return [Put(KEYS.key(*names), text) for names, text in texts.items()]


def test_what_is_removed_and_what_is_not() -> None:
    store = SimulatedStore()
    for put in puts_of_ann():
        store.transact(Txn(puts=(put,)))
    left = leavings(KEYS, FleetView.of(KEYS, store.snapshot()), "ann")
    assert (sorted(left.owned), left.cancelled, left.kept) == (
        ["owned", "stopped"],
        ("stopped",),
        ("done", "tried"),
    )
    assert [goal.id for goal in left.only] == ["hers"]
    for txn in left.removal(KEYS):
        assert max(len(txn.compare), len(txn.puts) + len(txn.deletes)) <= 2 * MOST  # etcd takes 128
        assert store.transact(txn).done
    own = [item.key for item in store.snapshot().items if "ann" in item.key.split("/")]
    assert own == [KEYS.key(records.ENDS, "ann", "done"), KEYS.key(records.FAILURES, "ann", "tried", "1")]
    assert store.value(KEYS.key(records.ENDS, "bob", "gone"))
    view = FleetView.of(KEYS, store.snapshot())
    states = {goal: view.state(goal) for goal in view.goals}
    assert states == {
        "owned": FleetGoalState.OPEN,
        "stopped": FleetGoalState.CANCELLED,
        "done": FleetGoalState.ENDED,
        "tried": FleetGoalState.OPEN,
        "hers": FleetGoalState.OPEN,
    }
    again = leavings(KEYS, view, "ann")
    assert again.known
    assert not again.owned


def test_a_claim_that_is_on_its_way_since_before_the_marks_were_removed_comes_too_late() -> None:
    store = SimulatedStore()
    seen = store.revision  # another robot sees the goal as open, and sends its claim
    for put in puts_of_ann():
        if "ann" in put.key.split("/"):
            store.transact(Txn(puts=(put,)))
    prefix = KEYS.key(records.TAKEN, MARK_PARTS[0], "")
    claim = Txn((Unwritten(prefix, seen),), (Put("claim", ""),))
    assert not store.transact(claim).done
    for txn in leavings(KEYS, FleetView.of(KEYS, store.snapshot()), "ann").removal(KEYS):
        assert store.transact(txn).done
    assert not store.value(prefix + "ann")
    assert not store.transact(claim).done


def test_a_robot_that_comes_back_meanwhile_loses_nothing_more() -> None:
    store = SimulatedStore()
    for put in puts_of_ann():
        store.transact(Txn(puts=(put,)))
    left = leavings(KEYS, FleetView.of(KEYS, store.snapshot()), "ann")
    store.transact(Txn(puts=(Put(KEYS.key(records.LIVES, "ann"), "x"),)))
    before = store.snapshot().items
    assert not any(store.transact(txn).done for txn in left.removal(KEYS))
    assert store.snapshot().items == before


# --- in the small world ------------------------------------------------------------------------------


def owner_is_gone(finish: bool = True) -> Tuple[Any, Any, Any]:
    """A world in which a robot was killed with a goal of its own; that robot, and the other one."""
    world = model.World(2, finish=finish)
    world.send("a")
    while not any(robot.running for robot in world.robots):
        world.act()
    first = next(robot for robot in world.robots if robot.running)
    world.strike(("kill", str(first.index)))
    for _ in range(12):
        world.act()
    return world, first, world.robots[1 - first.index]


def test_a_goal_to_finish_of_a_robot_that_is_forgotten_goes_to_another_one() -> None:
    world, first, second = owner_is_gone()
    assert world.succeeded == []
    world.strike(("forget", str(first.index)))
    for _ in range(20):
        world.act()
    assert world.succeeded == [("a", second.name)]
    assert not world.leavings(first).known
    assert world.settles() == ""
    assert world.succeeded == [("a", second.name)], "the robot that came back does not do it again"


def test_a_forgotten_robot_that_has_done_the_goal_reports_it_as_late() -> None:
    world = model.World(2, finish=True)
    world.send("a")
    while not any(robot.running for robot in world.robots):
        world.act()
    first = next(robot for robot in world.robots if robot.running)
    world.strike(("cut", str(first.index)))
    while not first.outbox.reports():
        world.act()
    world.strike(("kill", str(first.index)))
    for _ in range(12):
        world.act()
    world.strike(("forget", str(first.index)))
    while not world.ends("a"):
        world.act()
    assert world.settles() == ""
    (end,) = world.ends("a")
    assert records.decode(records.Report, end).robot != first.name
    late = [change for change in world.store.changes if "/late/" in change.key and change.value]
    assert [records.decode(records.Report, change.value).robot for change in late] == [first.name]


def test_a_word_that_is_not_true_is_found_and_the_robot_stops_when_it_hears_of_it() -> None:
    world = model.World(2, finish=True)
    world.send("a")
    while not any(robot.running for robot in world.robots):
        world.act()
    first = next(robot for robot in world.robots if robot.running)
    first.running["a"].left = 1000
    world.strike(("cut", str(first.index)))
    for _ in range(12):
        world.act()
    assert not world.wrong()
    world.forget(first)
    while not world.wrong():
        world.act()
    assert "any robot may take it" in world.wrong()
    world.strike(("mend", str(first.index)))
    for _ in range(4):
        world.act()
    assert not first.running
    assert world.settles() == ""


# --- the command over etcd ---------------------------------------------------------------------------


@pytest.fixture(scope="module")
def etcd() -> Iterator[EtcdProcess]:
    made = EtcdProcess()
    yield made
    made.close()


@pytest.fixture
def hub(etcd: EtcdProcess) -> Iterator[EtcdHub]:
    made = EtcdHub(KEYS.root, [etcd.endpoint], timeout=20.0)
    for item in made.read().items:  # of the test before
        made.transact(Txn(deletes=(item.key,)))
    yield made
    made.close()


def forget(etcd: EtcdProcess, *arguments: str) -> int:
    return main(["forget", "--hub", etcd.endpoint, "--fleet", "lab", *arguments])


@pytest.mark.processes
def test_the_command(etcd: EtcdProcess, hub: EtcdHub, capsys: pytest.CaptureFixture) -> None:
    hub.transact(Txn(puts=tuple(puts_of_ann())))
    before = hub.read().items
    assert forget(etcd, "ann") == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "ann owns goals to finish, and may still execute them: owned, stopped." in line
    assert "--never-comes-back" in line
    assert hub.read().items == before
    assert forget(etcd, "ann", "--never-comes-back") == 0
    said = capsys.readouterr()
    assert "warning: should ann still execute owned, stopped" in said.err
    lines = said.out.splitlines()
    assert lines[0].startswith("ann is forgotten (last seen: 2001-09-0")
    assert lines[1:] == [
        "open again: owned",
        "over, as they were cancelled: stopped",
        "only ann may do these, they wait: hers",
        "removed: records of 1 goals that are gone, 1 late reports, facts of 1 predicates",
        "kept: how it did 2 goals that the fleet still keeps; repeat this when those are removed",
    ]
    own = [item.key for item in hub.read().items if "ann" in item.key.split("/")]
    assert own == [KEYS.key(records.ENDS, "ann", "done"), KEYS.key(records.FAILURES, "ann", "tried", "1")]


@pytest.mark.processes
def test_a_robot_that_is_heard_of_is_not_forgotten(
    etcd: EtcdProcess, hub: EtcdHub, capsys: pytest.CaptureFixture
) -> None:
    life = Put(KEYS.key(records.LIVES, "ann"), records.encode(Claim("ann", "x")))
    hub.transact(Txn(puts=(*puts_of_ann(), life)))
    before = hub.read().items
    assert forget(etcd, "ann", "--never-comes-back") == 2
    assert "the robot 'ann' is in the fleet 'lab'; nothing was removed" in capsys.readouterr().err
    assert forget(etcd, "amn") == 2
    assert "no robot 'amn' has ever joined the fleet 'lab'" in capsys.readouterr().err
    assert hub.read().items == before
