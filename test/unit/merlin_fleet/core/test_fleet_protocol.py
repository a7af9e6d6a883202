# SPDX-License-Identifier: Apache-2.0
"""All that can happen to a small fleet with few faults, and much that can happen to it with more."""

import pickle
from typing import Optional, Tuple

import fleet_search
import fleet_world as model
import pytest
from fleet_search import begun, explore
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from merlin_fleet.core import records
from merlin_fleet.core.agent import Agent
from merlin_fleet.core.reporting import Outbox
from merlin_fleet.core.robot_lease import LeaseTimes

#: Every moment, where the same scenarios with fewer moments are told in seconds.
LONG = (pytest.mark.long, pytest.mark.timeout(3600))


@pytest.mark.parametrize(("goals", "finish"), [("ab", False), ("a", True)])
def test_no_fault_does_harm(goals: str, finish: bool) -> None:
    scenarios, found = explore(2, goals, 1, finish=finish)
    assert found is None
    assert scenarios > 150


@pytest.mark.parametrize("finish", [False, True])
def test_no_fault_does_harm_while_ended_goals_are_removed(finish: bool) -> None:
    scenarios, found = explore(2, "a", 1, finish=finish, rules=model.KEEP, rounds=18)
    assert found is None
    assert scenarios > 150


@pytest.mark.parametrize(
    ("every", "kinds"),
    [
        (12, ("lose answer", "kill", "restart")),
        (15, ("delay", "arrive", "cancel")),
        (9, ("cut", "mend")),
        pytest.param(9, ("lose answer", "kill", "restart"), marks=LONG),
        pytest.param(9, ("delay", "arrive", "cancel"), marks=LONG),
    ],
)
def test_no_two_faults_do_harm_while_ended_goals_are_removed(every: int, kinds: Tuple[str, ...]) -> None:
    scenarios, found = explore(2, "a", 2, kinds, every=every, rules=model.KEEP, rounds=18)
    assert found is None
    assert scenarios > 50


@pytest.mark.parametrize(
    ("every", "kinds"),
    [
        (4, ("hang", "resume", "hub down", "hub up")),
        (5, ("cut", "mend", "kill", "restart")),
        (12, ("delay", "arrive", "cut")),
        (16, ("lose answer", "hang", "cancel")),
    ],
)
def test_no_two_faults_do_harm(every: int, kinds: Tuple[str, ...]) -> None:
    scenarios, found = explore(2, "a", 2, kinds, every=every)
    assert found is None
    assert scenarios > 100


@pytest.mark.parametrize(
    ("budget", "every", "kinds", "finish"),
    [
        (2, 3, ("kill", "forget"), True),
        (3, 12, ("kill", "forget", "restart"), True),
        (3, 12, ("kill", "forget", "cancel"), True),
        pytest.param(3, 8, ("kill", "forget", "restart"), True, marks=LONG),
        pytest.param(3, 8, ("kill", "forget", "cancel"), True, marks=LONG),
        pytest.param(3, 16, ("kill", "forget", "delay", "arrive"), True, marks=LONG),
        (2, 3, ("kill", "forget"), False),
        pytest.param(2, 1, ("kill", "forget"), True, marks=LONG),
        pytest.param(2, 1, ("kill", "forget"), False, marks=LONG),
    ],
)
def test_a_robot_is_forgotten_without_harm(
    budget: int, every: int, kinds: Tuple[str, ...], finish: bool
) -> None:
    scenarios, found = explore(2, "a", budget, kinds, finish, every, rounds=20)
    assert found is None
    assert scenarios > 50


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_no_two_faults_of_any_kind_do_harm() -> None:
    assert explore(2, "a", 2, every=4)[1] is None


# --- the search finds what is wrong -----------------------------------------------------------------


def second_begins_within(rules: "model.Rules", rate: float, revoked: bool) -> str:
    """What is wrong when the owner's link is cut and the clocks run at other speeds.

    :param revoked: whether the owner's lease is ended at that moment.
    """
    world = model.World(2, rules, (rate, 2.0 - rate))
    world.send("a")
    first = begun(world)
    first.running["a"].left = 1000  # a long one
    world.strike(("cut", str(first.index)))
    if revoked:
        world.strike(("revoke", str(first.index)))
    for _ in range(100):
        world.act()
        if world.wrong():
            return world.wrong()
    return world.settles(2000)


@pytest.mark.parametrize("revoked", [False, True])
@pytest.mark.parametrize("rate", [0.75, 0.9, 1.0, 1.1, 1.25])
def test_a_clock_that_drifts_within_the_bound_does_no_harm(rate: float, revoked: bool) -> None:
    times = LeaseTimes(ttl=20.0, renew_every=1.0, stop_time=3.0, drift=0.26)
    assert second_begins_within(model.RULES._replace(lease=times), rate, revoked) == ""


def test_a_clock_that_drifts_beyond_the_bound_is_found() -> None:
    times = LeaseTimes(ttl=20.0, renew_every=1.0, stop_time=3.0, drift=0.0)
    found = second_begins_within(model.RULES._replace(lease=times), 0.5, True)
    assert "any robot may take it" in found or "owned by" in found


def cut_off(stop_time: float, stop_takes: int) -> Optional[str]:
    """What is wrong when the owner's link is cut and its lease is ended, and its stop takes so many rounds.

    All of it at any moment.
    """
    times = LeaseTimes(ttl=12.0, renew_every=1.0, stop_time=stop_time, drift=0.0)
    for moment in range(4):
        world = model.World(2, model.RULES._replace(lease=times))
        world.send("a")
        first = begun(world)
        first.running["a"].left = 1000
        first.running["a"].stop_takes = stop_takes
        index = str(first.index)
        found = fleet_search.play(world, {moment: [("cut", index), ("revoke", index)]}, 60)
        if found:
            return found
    return None


def test_the_owners_clock_stops_it_before_another_robot_begins() -> None:
    assert cut_off(stop_time=7.0, stop_takes=6) is None


def test_a_stop_that_takes_longer_than_said_is_found() -> None:
    found = cut_off(stop_time=2.0, stop_takes=6)
    assert found and ("any robot may take it" in found or "owned by" in found)


# --- scenarios ----------------------------------------------------------------------------------------


def end_of(world: "model.World", goal: str) -> records.Report:
    """How a goal ended."""
    (text,) = world.ends(goal)
    report: records.Report = records.decode(records.Report, text)
    return report


def test_a_late_report_is_recorded_and_not_applied() -> None:
    world = model.World(2)
    world.send("a")
    first = begun(world)
    second = world.robots[1 - first.index]
    # It ends in the very round in which its robot is cut off; the other one gets the goal and does it.
    world.strike(("cut", str(first.index)))
    for _ in range(40):
        world.act()
    assert end_of(world, "a").robot == second.name
    assert world.settles() == ""
    late = [change for change in world.store.changes if "/late/" in change.key]
    assert [records.decode(records.Report, change.value).robot for change in late] == [first.name]
    assert end_of(world, "a").robot == second.name
    assert not first.outbox.reports()


def test_what_was_done_for_a_hub_that_was_put_back_from_before_the_claim_is_late() -> None:
    world = model.World(2, takes=100)
    for _ in range(4):
        world.act()
    world.send("a")
    store = pickle.dumps(world.store)
    first = begun(world)
    world.strike(("hub down",))
    world.act()
    world.store = pickle.loads(store)
    for robot in world.robots:
        robot.heard = False
    world.strike(("hub up",))
    world.act()  # it hears that its claim is gone, and stops; the goal is done at this moment
    first.running.pop("a")
    first.inbox.append(model.ev.Ended("a", True, "SUCCEEDED"))
    assert world.settles(200) == ""
    late = [change for change in world.store.changes if "/late/" in change.key]
    assert [records.decode(records.Report, change.value).robot for change in late] == [first.name]
    assert any("recorded as late" in text for _, text in first.said)
    assert end_of(world, "a").epoch > 0


def test_a_report_whose_answer_was_lost_is_not_late() -> None:
    world = model.World(1)
    world.send("a")
    begun(world)
    while not any("report" in getattr(message.decision, "tag", "") for message in world.messages):
        world.act()
    number = next(i for i, each in enumerate(world.messages) if "report" in getattr(each.decision, "tag", ""))
    world.strike(("lose answer", str(number)))
    assert world.settles() == ""
    assert not [change for change in world.store.changes if "/late/" in change.key]


def test_a_goal_to_finish_is_finished_without_the_hub_and_by_no_other_robot() -> None:
    world = model.World(2, finish=True)
    world.send("a")
    first = begun(world)
    world.strike(("cut", str(first.index)))
    first.running["a"].left = 30
    for _ in range(60):
        world.act()
    assert world.succeeded == [("a", first.name)]
    assert world.settles() == ""
    assert end_of(world, "a").robot == first.name


def test_a_goal_to_finish_is_taken_up_by_the_next_life_of_its_robot() -> None:
    world = model.World(2, finish=True)
    world.send("a")
    first = begun(world)
    world.strike(("kill", str(first.index)))
    for _ in range(30):
        world.act()
    assert not world.succeeded
    world.strike(("restart", str(first.index)))
    assert world.settles() == ""
    assert world.succeeded == [("a", first.name)]


def test_a_goal_to_finish_that_was_begun_in_time_is_not_missed_by_the_next_life_of_its_robot() -> None:
    world = model.World(1, finish=True)
    world.send("a", deadline=10.0)
    begun(world)
    world.strike(("kill", "0"))
    while world.now < 20.0:
        world.act()
    world.strike(("restart", "0"))
    assert world.settles() == ""
    assert end_of(world, "a").outcome == "SUCCEEDED"


def test_a_report_survives_the_robots_death() -> None:
    world = model.World(1)
    world.send("a")
    (robot,) = world.robots
    begun(world)
    world.strike(("hub down",))
    while not robot.outbox.reports():
        world.act()
    world.strike(("kill", "0"))
    world.act()
    world.strike(("restart", "0"))
    world.strike(("hub up",))
    assert world.settles() == ""
    assert world.succeeded == [("a", "r0")], "it is not done again"


def test_a_second_process_of_the_same_name_does_not_join() -> None:
    world = model.World(2)
    world.robots[1].name = "r0"
    profile = records.Profile("r0")
    world.robots[1].agent = Agent("lab", profile, "other", Outbox(), model.RULES)
    for _ in range(20):
        world.act()
    assert [robot.agent.joined for robot in world.robots] == [True, False]
    world.strike(("kill", "0"))
    for _ in range(20):
        world.act()
    assert world.robots[1].agent.joined


def test_the_next_robot_tries_what_one_failed() -> None:
    world = model.World(3)
    world.send("a", tries=2)
    for _ in range(2):
        robot = begun(world)
        robot.running.pop("a")
        robot.inbox.append(model.ev.Ended("a", False, "ACTION_FAILED", "the door is locked"))
    assert world.settles() == ""
    tried = [change for change in world.store.changes if "/failures/" in change.key]
    assert len(tried) == 1
    assert end_of(world, "a").outcome == "ACTION_FAILED"
    assert end_of(world, "a").robot != records.decode(records.Report, tried[0].value).robot


def test_a_goal_that_no_robot_can_take_ends_at_its_deadline() -> None:
    world = model.World(2)
    world.send("a", needs=("arm",), deadline=15.0)
    for _ in range(14):
        world.act()
    assert not world.ends("a")
    assert world.settles() == ""
    assert end_of(world, "a").outcome == "MISSED"


def test_a_goal_whose_owner_is_gone_at_its_deadline_is_not_called_one_that_never_began() -> None:
    world = model.World(2, takes=100)
    world.send("a", deadline=10.0)
    first = begun(world)
    world.strike(("kill", str(first.index)))
    while not world.ends("a"):
        world.act()
    end = end_of(world, "a")
    assert (end.outcome, end.reason) == ("MISSED", "its deadline has passed, and no robot has it")


def test_a_goal_for_one_robot_waits_for_it() -> None:
    world = model.World(2)
    world.strike(("kill", "1"))
    world.send("a", robot="r1")
    for _ in range(20):
        world.act()
    assert not world.succeeded
    assert world.settles() == ""
    assert world.succeeded == [("a", "r1")]


def test_a_cancelled_goal_stops_and_ends() -> None:
    world = model.World(2)
    world.send("a")
    begun(world)
    world.strike(("cancel", "a"))
    assert world.settles() == ""
    assert end_of(world, "a").outcome == "CANCELLED"
    assert not world.succeeded


def test_the_busy_robot_leaves_a_goal_to_the_idle_one() -> None:
    world = model.World(2)
    for goal in "abcdef":
        world.send(goal)
    assert world.settles(120) == ""
    counts = {name: [robot for _, robot in world.succeeded].count(name) for name in ("r0", "r1")}
    assert counts["r0"] and counts["r1"]
    assert len(world.succeeded) == 6


def test_a_robot_that_is_fit_again_takes_what_it_has_refused() -> None:
    world = model.World(1, model.RULES._replace(ask_again=5.0))
    (robot,) = world.robots
    robot.unfit = "its battery is low"
    world.send("a")
    for _ in range(20):
        world.act()
    assert robot.agent.view.offers.of("r0").of["a"].reason == robot.unfit
    robot.unfit = ""
    assert world.settles() == ""
    assert world.succeeded == [("a", "r0")]


def test_a_robot_that_is_fit_again_takes_what_it_refused_behind_goals_that_it_cannot_do() -> None:
    world = model.World(1, model.RULES._replace(ask_again=5.0))
    (robot,) = world.robots
    most = robot.rules.most_bids
    robot.unfit = "its battery is low"
    for number in range(most):
        world.send(f"a{number}", value=1.0)
    world.send("b")
    for _ in range(40):
        world.act()
    robot.unfit = ""
    robot.never = {f"a{number}" for number in range(most)}
    for _ in range(60):
        world.act()
    assert world.succeeded == [("b", "r0")]


def test_a_robot_gives_back_what_it_cannot_do_any_more_and_has_not_begun() -> None:
    world = model.World(2, model.RULES._replace(ask_again=5.0), takes=1000)
    owner, other = world.robots
    other.unfit = "its battery is low"
    world.send("a")
    begun(world)
    world.send("b")
    while world.store.value(model.KEYS.key(records.CLAIMS, owner.name, "b")) == "":
        world.act()
    owner.unfit, other.unfit = "its Executor is paused", ""
    assert begun(world, "b") is other
    assert list(owner.running) == ["a"]
    assert any("gives b back" in text and owner.unfit in text for _, text in owner.said)
    assert not world.wrong()


@pytest.mark.parametrize(
    "kinds", [("unfit", "fit"), ("unfit", "kill", "restart"), ("unfit", "delay", "arrive")]
)
def test_goals_that_are_given_back_do_no_harm(kinds: Tuple[str, ...]) -> None:
    rules = model.RULES._replace(ask_again=2.0)
    scenarios, found = explore(2, "abc", 2, kinds, every=4, rules=rules, takes=6)
    assert found is None
    assert scenarios > 50


# --- random scenarios ---------------------------------------------------------------------------------


class FleetMachine(RuleBasedStateMachine):
    """Any number of faults, in any order."""

    @initialize(
        robots=st.integers(1, 3),
        finish=st.booleans(),
        goals=st.integers(1, 4),
        again=st.sampled_from((2.0, 1e6)),
        crowd=st.sampled_from((0, 8)),
        most_bids=st.sampled_from((1, 8)),
        keep=st.sampled_from((model.RULES, model.KEEP)),
        takes=st.sampled_from((model.TAKES, 4 * model.TAKES)),
    )
    def begin(
        self,
        robots: int,
        finish: bool,
        goals: int,
        again: float,
        crowd: int,
        most_bids: int,
        keep: "model.Rules",
        takes: int,
    ) -> None:
        # A crowd of 0: they bid as the robots of a crowd do.
        auction = model.RULES.auction._replace(crowd=crowd, enough=1)
        rules = keep._replace(auction=auction, most_bids=most_bids, ask_again=again)
        self.world = model.World(robots, rules, finish=finish, takes=takes)
        for number in range(goals):
            self.world.send(f"g{number}")

    @rule(rounds=st.integers(1, 6))
    def pass_time(self, rounds: int) -> None:
        for _ in range(rounds):
            self.world.act()
            assert not self.world.wrong()

    @precondition(lambda self: len(self.world.goals) < 8)
    @rule(tries=st.integers(1, 2), value=st.integers(0, 2))
    def send(self, tries: int, value: int) -> None:
        if self.world.takes > model.TAKES:
            tries = 1  # one that hangs meanwhile has failed, and there may be no other robot
        self.world.send(f"g{len(self.world.goals)}", tries=tries, value=float(value))

    @rule(data=st.data())
    def strike(self, data: st.DataObject) -> None:
        self.world.strike(data.draw(st.sampled_from(list(self.world.events()))))

    @invariant()
    def nothing_is_wrong(self) -> None:
        assert not getattr(self, "world", None) or not self.world.wrong()

    def teardown(self) -> None:
        if getattr(self, "world", None):
            assert self.world.settles(250) == ""


TestFleetMachine = FleetMachine.TestCase
TestFleetMachine.settings = settings(
    max_examples=25,
    stateful_step_count=30,
    deadline=None,
    derandomize=True,
    suppress_health_check=list(HealthCheck),
)
