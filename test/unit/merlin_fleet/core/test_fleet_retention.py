# SPDX-License-Identifier: Apache-2.0
"""Goals that have ended are removed when they are old: which goals, by which robot, and goals under way."""

import pickle
from typing import Any, Iterator, List

import fleet_world as model
import pytest
from fakes.simulated_store import SimulatedStore

from merlin_fleet.commands import keep_command
from merlin_fleet.commands.fleet_command import main, words
from merlin_fleet.core import events as ev
from merlin_fleet.core import records
from merlin_fleet.core.records import Claim, Goal, Keys, Report
from merlin_fleet.core.retention import HOUR, Keeper, Retention, removal
from merlin_fleet.core.store import Put, Txn
from merlin_fleet.core.view import FleetView
from merlin_fleet.fleet_client import FleetClient
from merlin_fleet.fleet_request import REMOVED
from merlin_fleet.hub import EtcdHub
from merlin_test import LONG
from merlin_test.etcd_process import EtcdProcess

KEYS = Keys("lab")
DAY = 24 * HOUR


# --- which goals -------------------------------------------------------------------------------------


class Shelf:
    """A store with goals, and a view of it."""

    def __init__(self) -> None:
        self.store = SimulatedStore()

    def put(self, kind: str, *names: str, record: Any) -> None:
        text = record if isinstance(record, str) else records.encode(record)
        self.store.transact(Txn(puts=(Put(KEYS.key(kind, *names), text),)))

    def goal(self, name: str, ended: float = 0.0) -> None:
        """A goal, and its end where it has one."""
        self.put(records.GOALS, name, record=Goal(name, ("(done)",), 1.0))
        if ended:
            self.put(records.ENDS, "r1", name, record=Report(name, "r1", 1, "SUCCEEDED", "", ended))

    @property
    def view(self) -> FleetView:
        return FleetView.of(KEYS, self.store.snapshot())


def due(shelf: Shelf, wall: float, **keep: Any) -> List[str]:
    return Keeper(Retention(**{"grace": 0.0, **keep})).due(shelf.view, 0.0, wall)


def test_the_last_ones_and_the_young_ones_are_kept() -> None:
    shelf = Shelf()
    for day in range(1, 11):
        shelf.goal(f"g{day}", ended=day * DAY)
    shelf.goal("open")
    assert due(shelf, 11 * DAY, hours=7 * 24.0, goals=0) == ["g1", "g2", "g3"]
    assert due(shelf, 11 * DAY, hours=0.0, goals=8) == ["g1", "g2"]
    assert due(shelf, 11 * DAY, hours=9.5 * 24, goals=4) == [f"g{day}" for day in range(1, 7)]
    assert due(shelf, 11 * DAY, hours=0.0, goals=0) == []


def test_what_goes_on_or_cannot_be_read_is_kept_however_old_it_is() -> None:
    shelf = Shelf()
    shelf.goal("open")
    shelf.goal("owned")
    shelf.put(records.CLAIMS, "r1", "owned", record=Claim("r1", "x"))
    shelf.goal("cancelling")
    shelf.put(records.CLAIMS, "r1", "cancelling", record=Claim("r1", "x"))
    shelf.put(records.CANCELS, "cancelling", record=records.encode_cancel("c", 5.0))
    shelf.goal("tried")
    shelf.put(records.FAILURES, "r1", "tried", "7", record=Report("tried", "r1", 7, "FAILED", "", 5.0))
    shelf.goal("unclear")
    shelf.put(records.ENDS, "r1", "unclear", record='{"protocol": 99}')
    shelf.put(records.GOALS, "foreign", record='{"protocol": 99}')
    shelf.put(records.ENDS, "r1", "foreign", record=Report("foreign", "r1", 1, "SUCCEEDED", "", 5.0))
    assert due(shelf, 1e9, hours=1.0, goals=1) == []
    shelf.goal("cancelled")
    shelf.put(records.CANCELS, "cancelled", record=records.encode_cancel("c", 5.0))
    shelf.goal("cancelled_before_there_were_times")
    shelf.put(records.CANCELS, "cancelled_before_there_were_times", record="{}")
    assert due(shelf, 1e9, hours=1.0) == ["cancelled_before_there_were_times", "cancelled"]


def test_a_clock_that_is_wrong_by_years_removes_nothing_before_it_was_seen_for_a_while() -> None:
    shelf = Shelf()
    shelf.goal("g1", ended=1.0)
    keeper = Keeper(Retention(grace=600.0))
    assert keeper.due(shelf.view, 100.0, 1e9) == []
    shelf.goal("g2", ended=1.0)
    assert keeper.due(shelf.view, 699.0, 1e9) == []
    assert keeper.due(shelf.view, 700.0, 1e9) == ["g1"]
    assert keeper.due(shelf.view, 1299.0, 1e9) == ["g1", "g2"]


@pytest.mark.parametrize("kind", ["end", "goal", "cancel"])
def test_a_removal_compares_the_goal_and_its_end(kind: str) -> None:
    shelf = Shelf()
    shelf.goal("g1", ended=5.0 if kind != "cancel" else 0.0)
    if kind == "cancel":
        shelf.put(records.CANCELS, "g1", record=records.encode_cancel("c", 5.0))
    txn = removal(KEYS, shelf.view, "g1")
    if kind == "end":
        shelf.store.transact(Txn(deletes=(KEYS.key(records.ENDS, "r1", "g1"),)))
    elif kind == "goal":
        shelf.goal("g1")
    else:
        shelf.put(records.CANCELS, "g1", record="{}")
    assert not shelf.store.transact(txn).done
    assert shelf.store.value(KEYS.key(records.GOALS, "g1"))


def test_a_removal_takes_goal_and_cancel() -> None:
    shelf = Shelf()
    shelf.goal("g1", ended=5.0)
    shelf.put(records.CANCELS, "g1", record="{}")
    assert shelf.store.transact(removal(KEYS, shelf.view, "g1")).done
    assert [item.key for item in shelf.store.snapshot().items] == [KEYS.key(records.ENDS, "r1", "g1")]


# --- robots ------------------------------------------------------------------------------------------


def until(world: Any, holds: Any, rounds: int = 60) -> None:
    """Plays until something holds."""
    for _ in range(rounds):
        if holds():
            return
        world.act()
        assert not world.wrong(), world.wrong()
    raise AssertionError("it never holds")


def begun(world: Any, goal: str = "a") -> Any:
    """Plays until a goal is executed; returns the robot."""
    until(world, lambda: any(goal in robot.running for robot in world.robots))
    return next(robot for robot in world.robots if goal in robot.running)


def tags(world: Any, robot: int) -> List[str]:
    """What a robot asks of the hub now."""
    decisions = (each.decision for each in world.messages if each.robot == robot)
    return [decision.tag for decision in decisions if isinstance(decision, ev.Transact)]


def test_one_robot_removes_the_goals_and_the_next_one_when_it_is_gone() -> None:
    world = model.World(2, model.KEEP)
    removed = {0: [], 1: []}  # type: dict[int, List[str]]

    def look() -> bool:
        for robot, names in removed.items():
            names += [tag for tag in tags(world, robot) if tag.startswith("remove ")]
        return False

    for goal in "ab":
        world.send(goal)
    until(world, lambda: look() or (world.succeeded and not world.left("a") and not world.left("b")))
    assert set(removed[0]) == {"remove a", "remove b"}
    assert removed[1] == []
    world.strike(("kill", "0"))
    world.send("c")
    until(world, lambda: look() or (len(world.succeeded) == 3 and not world.left("c")))
    assert set(removed[1]) == {"remove c"}


def test_a_late_report_of_a_goal_that_is_gone_is_recorded_and_named() -> None:
    world = model.World(2, model.KEEP)
    world.send("a")
    first = begun(world)
    # It ends in its robot as the link is cut; the other one gets it, does it, and it is removed.
    world.strike(("cut", str(first.index)))
    goal = KEYS.key(records.GOALS, "a")
    until(world, lambda: not world.store.value(goal))
    assert first.outbox.reports()
    world.strike(("mend", str(first.index)))
    until(world, lambda: not first.outbox.reports())
    late = [change for change in world.store.changes if "/late/" in change.key and change.value]
    assert [records.decode(Report, change.value).robot for change in late] == [first.name]
    assert any("after the fleet has removed that goal" in text for _, text in first.said)
    assert world.settles() == "", "and the late report is removed when it is old"


def test_a_robot_keeps_its_end_while_it_does_not_know_that_the_hub_has_it() -> None:
    world = model.World(2, model.KEEP)
    world.send("a")
    first = begun(world)
    end, goal = KEYS.key(records.ENDS, first.name, "a"), KEYS.key(records.GOALS, "a")
    for _ in range(30):
        for number, message in reversed(list(enumerate(world.messages))):
            if getattr(message.decision, "tag", "").startswith("report "):
                world.strike(("lose answer", str(number)))
        world.act()
        assert not world.wrong(), world.wrong()
    assert first.outbox.reports() and world.store.value(end)
    assert not world.store.value(goal), "the goal itself is over"
    assert world.settles() == ""
    assert not [change for change in world.store.changes if "/late/" in change.key]


def test_a_missed_deadline_that_comes_late_ends_no_goal_that_is_gone() -> None:
    world = model.World(1, model.KEEP)
    world.send("a", needs=("arm",), deadline=8.0)
    until(world, lambda: "missed a" in tags(world, 0))
    number = next(
        n for n, each in enumerate(world.messages) if getattr(each.decision, "tag", "") == "missed a"
    )
    world.strike(("delay", str(number)))
    world.cancel("a")
    until(world, lambda: not world.left("a"))
    world.strike(("arrive",))
    assert not world.ends("a")


def test_a_robot_that_may_not_remove_goals_says_so_once_and_goes_on() -> None:
    world = model.World(1, model.KEEP)
    (robot,) = world.robots
    for goal in "ab":
        world.send(goal)
    until(world, lambda: any(tag.startswith("remove ") for tag in tags(world, 0)))
    for number, message in reversed(list(enumerate(world.messages))):
        tag = getattr(message.decision, "tag", "")
        if tag.startswith("remove "):
            robot.inbox.append(ev.Refused("the hub does not allow it to this certificate", tag))
            world.strike(("lose question", str(number)))
    for _ in range(20):
        world.act()
    assert not any(tag.startswith("remove ") for tag in tags(world, 0))
    assert robot.agent.denied == "", "the robot itself is well"
    assert len([text for _, text in robot.said if "removes no ended goals" in text]) == 1
    assert len(world.succeeded) == 2 and world.left("a") and world.left("b")
    # A client does it, and the robot takes its own records away.
    view = FleetView.of(KEYS, world.store.snapshot())
    for goal in "ab":
        assert world._transact(removal(KEYS, view, goal)).done
    until(world, lambda: not world.left("a") and not world.left("b"))


# --- clients -----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def etcd() -> Iterator[EtcdProcess]:
    made = EtcdProcess()
    yield made
    made.close()


class Desk:
    """A client, and the hub beside it."""

    def __init__(self, etcd: EtcdProcess, fleet: str) -> None:
        self.fleet = fleet
        self.keys = Keys(fleet)
        self.etcd = etcd
        self.client = FleetClient(fleet, [etcd.endpoint])
        self.hub = EtcdHub(self.keys.root, [etcd.endpoint], timeout=20.0)
        assert self.client.wait_for_hub(LONG)

    def end(self, goal: str) -> None:
        """A robot has done it."""
        report = Report(goal, "r1", 1, "SUCCEEDED", "", 5.0)
        put = Put(self.keys.key(records.ENDS, "r1", goal), records.encode(report))
        self.hub.transact(Txn(puts=(put,)))

    def close(self) -> None:
        self.client.close()
        self.hub.close()


@pytest.fixture
def desk(etcd: EtcdProcess, request: pytest.FixtureRequest) -> Iterator[Desk]:
    made = Desk(etcd, request.node.name)
    yield made
    made.close()


@pytest.mark.processes
def test_the_result_stays_known_to_the_one_who_sent_it(desk: Desk) -> None:
    client = desk.client
    known, missed = client.send("(done a)"), client.send("(done b)")
    assert client.wait(lambda: client.news(missed.id), LONG)
    desk.end(known.id)
    assert known.wait(LONG)
    # Of the other one this client does not hear the end: both keys come and go at one revision for it.
    desk.hub.transact(Txn(deletes=tuple(desk.keys.key(records.GOALS, each.id) for each in (known, missed))))
    assert missed.wait(LONG)
    assert known.result is not None and known.result.outcome == "SUCCEEDED"
    assert missed.result is not None and missed.result.outcome == REMOVED


def ended_goal(desk: Desk) -> str:
    """A goal that has ended, as the client knows."""
    request = desk.client.send("(done a)")
    desk.end(request.id)
    assert request.wait(LONG)
    return request.id


@pytest.mark.processes
def test_the_command_removes_until_ctrl_c(
    desk: Desk, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    goal, going = ended_goal(desk), desk.client.send("(done b)")
    looks: List[float] = []

    def pause(signals: int, seconds: float) -> None:
        looks.append(seconds)
        if len(looks) >= LONG or desk.client.wait(lambda: desk.client.news(goal) is None, 1.0):
            raise KeyboardInterrupt

    monkeypatch.setattr(keep_command, "KEPT", Retention(grace=0.0))
    monkeypatch.setattr(keep_command, "_pause", pause)
    assert main(["keep", "--hub", desk.etcd.endpoint, "--fleet", desk.fleet, "--hours", "1"]) == 0
    assert looks[0] == keep_command.LOOK
    _, *removed = capsys.readouterr().out.splitlines()
    assert removed in (["removed 1 ended goals"], []), "its answer may be lost"
    assert desk.client.news(goal) is None
    news = desk.client.news(going.id)
    assert news is not None and words(news) == "open, no robot is joined"


@pytest.mark.processes
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--hours", "-1"), "-1 is not a number from 0 on"),
        (("--hours", "soon"), "soon is not a number from 0 on"),
        (("--goals", "nan"), "nan is not a whole number from 0 on"),
        (("--hours", "0", "--goals", "0"), "fleet keep: with --hours 0 and --goals 0 every goal is kept"),
    ],
)
def test_mistakes_are_one_clear_line(
    etcd: EtcdProcess, capsys: pytest.CaptureFixture, arguments: Any, message: str
) -> None:
    try:
        code: Any = main(["keep", "--hub", etcd.endpoint, *arguments])
    except SystemExit as end:  # argparse's own
        code = end.code
    assert code == 2
    assert capsys.readouterr().err.splitlines()[-1].endswith(message)


def test_a_robot_does_not_grow_with_the_goals_that_it_has_done() -> None:
    world = model.World(1, model.KEEP)
    sizes = []
    for number in range(360):
        world.send(f"goal_{number:08}")
        for _ in range(12):
            world.act()
        assert not world.wrong()
        sizes.append(len(pickle.dumps(world.robots[0].agent)))
    assert world.settles() == ""
    assert max(sizes[240:]) <= 1.05 * max(sizes[120:240])
