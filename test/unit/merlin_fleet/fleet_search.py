# SPDX-License-Identifier: Apache-2.0
"""Searches for scenarios that do harm to a small fleet."""

from typing import Dict, List, Optional, Set, Tuple

import fleet_world as model

Scenario = List[Tuple[int, "model.Event"]]
ROUNDS = 12  # in which faults happen: both goals are done by then, where nothing happens


def begun(world: "model.World", goal: str = "a") -> "model.Robot":
    """Plays until a goal is executed; returns the robot."""
    for _ in range(20):
        world.act()
        for robot in world.robots:
            if goal in robot.running:
                return robot
    raise AssertionError("it never begins")


def play(world: "model.World", script: Dict[int, List["model.Event"]], rounds: int = 40) -> Optional[str]:
    """Plays events at rounds; returns what went wrong."""
    for moment in range(rounds):
        for event in script.get(moment, []):
            world.strike(event)
        world.act()
        if world.wrong():
            return f"round {moment}: {world.wrong()}"
    return world.settles() or None


def explore(
    robots: int,
    goals: str,
    budget: int,
    kinds: Tuple[str, ...] = (),
    finish: bool = False,
    every: int = 1,
    rules: "model.Rules" = model.RULES,
    rounds: int = ROUNDS,
    takes: int = model.TAKES,
) -> Tuple[int, Optional[Tuple[str, Scenario]]]:
    """Tries every scenario with at most so many events, at any moments and in any order.

    :param kinds: of events; none: all.
    :param every: of the later events of a scenario only each so many rounds a moment is tried.
    :param rounds: in which faults happen.
    :param takes: rounds of an execution.
    :return: the number of scenarios that differ in what they do, and one that goes wrong.
    """
    begin = model.World(robots, rules, finish=finish, takes=takes)
    for goal in goals:
        begin.send(goal)
    scenarios = 0
    stack = [(begin, 0, budget, [])]
    known: Set[Tuple[int, int, bytes]] = set()
    while stack:
        world, moment, left, scenario = stack.pop()
        while moment < rounds:
            if left and (not scenario or (moment - scenario[-1][0]) % every == 0):
                saved = world.saved()
                for event in world.events():
                    if kinds and event[0] not in kinds:
                        continue
                    struck = model.World.restored(saved)
                    struck.strike(event)
                    state = (moment, left, struck.saved())
                    if state not in known:  # other events have led to the same
                        known.add(state)
                        stack.append((struck, moment, left - 1, [*scenario, (moment, event)]))
            world.act()
            moment += 1
            if world.wrong():
                return scenarios, (world.wrong(), scenario)
        scenarios += 1
        reason = world.settles()
        if reason:
            return scenarios, (reason, scenario)
    return scenarios, None
