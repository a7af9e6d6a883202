# SPDX-License-Identifier: Apache-2.0
"""A robot whose clock is far from the hub's leaves deadlines alone, and says so."""

import fleet_world as model
import pytest

from merlin_fleet.core import records
from merlin_fleet.core.clock import AHEAD, BEHIND
from merlin_fleet.core.records import Report
from merlin_fleet.core.view import FleetView

FAR = 3600.0  # s


def acted(world: model.World, rounds: int) -> FleetView:
    """What the store has after some rounds."""
    for _ in range(rounds):
        world.act()
    return FleetView.of(model.KEYS, world.store.snapshot())


def end_of(world: model.World, goal: str) -> Report:
    (text,) = world.ends(goal)
    report: Report = records.decode(Report, text)
    return report


def owns_two(world: model.World) -> model.Robot:
    """The robot, when the first of its three goals is done and the others are its own."""
    for goal in "abc":
        world.send(goal, deadline=600.0)
    (robot,) = world.robots
    for _ in range(40):
        if len(robot.agent.possession.owned) == 2:
            return robot
        world.act()
    raise AssertionError("it does not take them")


def refusal(view: FleetView, goal: str) -> str:
    """Why r0 does not bid."""
    bids = view.offers.of("r0")
    assert bids is not None
    return bids.of[goal].reason


def said(world: model.World, robot: int) -> list:
    return [text for _, text in world.robots[robot].said if "clock" in text]


def test_a_clock_that_is_ahead_ends_no_goal() -> None:
    world = model.World(2)
    world.robots[0].ahead = FAR
    world.send("a", deadline=600.0)
    assert world.settles() == ""
    assert world.succeeded == [("a", "r1")]
    assert said(world, 0) == [
        "this robot's clock is 3600 s ahead of the hub's: it takes no goal with a deadline, and ends none"
    ]
    assert not said(world, 1)


def test_a_clock_that_jumps_ends_neither_open_nor_owned_goals() -> None:
    world = model.World(1)
    robot = owns_two(world)
    robot.ahead = FAR
    world.send("d", deadline=600.0)
    view = acted(world, 30)
    assert {goal for goal, _ in world.succeeded} == {"a", "b", "c"}
    assert not world.ends("d")
    assert refusal(view, "d") == AHEAD
    robot.ahead = 0.0
    assert world.settles() == ""
    assert end_of(world, "d").outcome == "SUCCEEDED"
    assert said(world, 0)[-1] == "this robot's clock agrees with the hub's again: deadlines count"


def test_a_clock_that_is_behind_begins_no_goal_too_late() -> None:
    world = model.World(2)
    acted(world, 20)
    world.robots[0].ahead = -FAR
    world.robots[1].unfit = "its battery is low"
    world.send("a", deadline=10.0)  # it has passed
    world.send("b", robot="r0", deadline=600.0)
    view = acted(world, 20)
    assert refusal(view, "b") == BEHIND
    assert end_of(world, "a").outcome == "MISSED"
    assert end_of(world, "a").robot == "r1"


def test_goals_without_a_deadline_are_done_by_any_clock() -> None:
    world = model.World(1)
    world.robots[0].ahead = -FAR
    for number in range(12):
        world.send(f"d{number}", deadline=600.0, value=1.0)
    world.send("a")
    acted(world, 20)
    assert world.succeeded == [("a", "r0")]


def test_a_clock_within_the_margin_counts() -> None:
    world = model.World(1)
    world.robots[0].ahead = 2.0
    world.send("a", deadline=600.0)
    world.send("b", needs=("arm",), deadline=15.0)
    assert world.settles() == ""
    assert not said(world, 0)
    assert end_of(world, "b").outcome == "MISSED"


def test_a_clock_that_jumps_without_the_hub_is_found() -> None:
    world = model.World(1, finish=True)
    robot = owns_two(world)
    world.strike(("hub down",))
    robot.ahead = FAR
    acted(world, 20)
    assert {goal for goal, _ in world.succeeded} == {"a", "b", "c"}
    assert said(world, 0)


@pytest.mark.parametrize("rounds", [0, 20])
def test_where_the_hub_tells_no_time_the_own_clock_counts(rounds: int) -> None:
    world = model.World(1)
    world.hub_tells_time = False
    acted(world, rounds)
    world.send("a", needs=("arm",), deadline=15.0)
    world.send("b", deadline=600.0)
    assert world.settles() == ""
    assert end_of(world, "a").outcome == "MISSED"
    assert said(world, 0) == ["the hub does not tell its time: this robot's clock is not compared with it"]
