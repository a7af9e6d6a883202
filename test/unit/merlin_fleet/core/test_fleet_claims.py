# SPDX-License-Identifier: Apache-2.0
"""Claims that vanish before their time: by an operator's command, or one with a copied certificate."""

from typing import Tuple

import fleet_world as model
import pytest
from fleet_search import begun, explore

#: Every moment, where the same scenarios with fewer moments are told in seconds.
LONG = (pytest.mark.long, pytest.mark.timeout(3600))


@pytest.mark.parametrize(
    ("budget", "every", "kinds"),
    [
        (2, 5, ("revoke", "unclaim", "cut", "mend")),
        (2, 9, ("revoke", "unclaim", "kill", "restart", "hang")),
        (2, 5, ("revoke", "hub down", "hub up")),
        (3, 12, ("revoke", "cut", "restart")),
        pytest.param(2, 2, ("revoke", "unclaim", "cut", "mend"), marks=LONG),
        pytest.param(2, 4, ("revoke", "unclaim", "kill", "restart", "hang"), marks=LONG),
        pytest.param(2, 4, ("revoke", "hub down", "hub up"), marks=LONG),
        pytest.param(3, 8, ("revoke", "cut", "restart"), marks=LONG),
    ],
)
def test_claims_that_anyone_ends_do_no_harm(budget: int, every: int, kinds: Tuple[str, ...]) -> None:
    scenarios, found = explore(2, "a", budget, kinds, every=every, takes=4 * model.TAKES)
    assert found is None
    assert scenarios > 50


def test_an_owner_that_hears_late_of_the_end_of_its_lease_does_no_harm() -> None:
    # Until an execution that begins again without its claim meets the one of the next robot.
    scenarios, found = explore(2, "a", 2, ("slow", "revoke"), every=5, rounds=20, takes=4 * model.TAKES)
    assert found is None
    assert scenarios > 20


def test_an_owner_whose_claim_is_gone_stops_at_once_and_may_do_it_again() -> None:
    for event in ("revoke", "unclaim"):
        world = model.World(2)
        world.send("a")
        first = begun(world)
        first.running["a"].left = 1000
        world.strike((event, str(first.index), "a"))
        world.act()
        assert first.running["a"].stopping
        at = world.now
        world.act()
        assert begun(world) is first, "others do not know yet that it stands"
        assert world.now - at < model.TIMES.ttl
        assert world.settles(1200) == ""


@pytest.mark.parametrize("begins", [False, True])
def test_the_next_robot_waits_until_an_owner_that_does_not_hear_of_it_stands(begins: bool) -> None:
    world = model.World(2)
    first, second = world.robots
    if begins:  # after the claim is gone: it has never seen it
        second.state = model.DEAD
    world.send("a")
    assert begun(world) is first
    first.running["a"].left = 1000
    world.strike(("cut", "0"))
    world.strike(("revoke", "0"))
    vanished = world.now
    second.state = model.UP
    while "a" not in second.running:
        world.act()
        assert not world.wrong()
    assert not first.running
    assert model.TIMES.ttl <= world.now - vanished <= model.TIMES.ttl + 5.0
    assert world.settles() == ""


def test_what_was_stopped_without_the_hub_begins_again_only_when_its_claim_is_seen() -> None:
    world = model.World(1, takes=1000)
    world.send("a")
    (robot,) = world.robots
    begun(world)
    world.strike(("hub down",))
    while robot.running:
        world.act()
    world.strike(("unclaim", "0", "a"))
    for _ in range(10):
        world.act()
        assert not world.wrong()
    robot.heard = False
    world.strike(("hub up",))
    for _ in range(20):
        world.act()
        assert not world.wrong()


def test_a_goal_that_no_robot_ever_had_does_not_wait_for_a_robot_that_begins() -> None:
    world = model.World(2)
    world.send("a")
    begun(world)
    assert world.now < model.TIMES.ttl


def test_a_goal_that_is_given_back_does_not_wait() -> None:
    world = model.World(2)
    world.send("a")
    first = begun(world)
    second = world.robots[1 - first.index]
    first.inbox.append(model.ev.Leaving())
    while first.running or first.agent.possession.to_return():
        world.act()
    world.strike(("revoke", str(first.index)))
    world.strike(("kill", str(first.index)))
    at = world.now
    assert begun(world) is second
    assert world.now - at < model.TIMES.ttl
    assert world.settles() == ""
