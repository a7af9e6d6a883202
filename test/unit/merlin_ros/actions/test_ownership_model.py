# SPDX-License-Identifier: Apache-2.0
"""Everything that can happen to the ownership protocol with few faults, on a model (`ownership_model`)."""

from typing import Dict, List, NamedTuple, Optional, Tuple

import ownership_model as model
import ownership_world as parts
import pytest

Event = Tuple[str, ...]
PER_FAULT = parts.LOSE + 2  # rounds by which each further fault may put the end off
SETTLE = 60  # rounds in which everything has to end once all live


class Found(NamedTuple):
    """What went wrong, and how it came about."""

    what: str
    scenario: List[str]


def stands_within(rules: "parts.Rules") -> int:
    """Rounds after which nothing moves any more that lost its owner: invariant (a)."""
    return parts.SUSPEND + 1 + rules.length + 2


def ends_within(rules: "parts.Rules") -> int:
    """Rounds after which nothing runs any more that lost its owner: invariant (b)."""
    return parts.LOSE + 1 + rules.length + parts.SILENCE + 3


def wrong(rules: "parts.Rules", world: "parts.World", faults: int) -> str:
    """The invariant that the world breaks; empty: none."""
    more = max(0, faults - 1)
    moving = parts.passing(world)
    for goal, age in world.unowned:
        if goal in moving and age > stands_within(rules) + more * (parts.SUSPEND + 2):
            return f"{goal} moves the base {age} rounds after it lost its owner"
        if age > ends_within(rules) + more * PER_FAULT:
            return f"{goal} still runs {age} rounds after it lost its owner"
    return ""


class Search:
    """Tries every scenario with at most so many events, at any moments and in any order.

    :param rules: of the protocol.
    :param actions: that are wanted at the beginning, a letter each.
    :param budget: events.
    """

    def __init__(self, rules: "parts.Rules", actions: str, budget: int) -> None:
        self._rules = rules
        self._budget = budget
        begin = (parts.begin(rules, actions), budget)
        self._from: Dict[tuple, Optional[Tuple[tuple, Optional[Event]]]] = {begin: None}
        self._settled: Dict[parts.World, bool] = {}
        self._front = [begin]

    @property
    def states(self) -> int:
        """How many states there are."""
        return len(self._from)

    def run(self) -> Optional[Found]:
        """The first scenario in which an invariant breaks; None: every scenario keeps them."""
        while self._front:
            front, self._front = self._front, []
            for node in front:
                found = self._extend(node)
                if found is not None:
                    return found
        return None

    def _extend(self, node: tuple) -> Optional[Found]:
        world, budget = node
        following = [(None, (model.after(self._rules, world), budget))]
        if budget:
            following += [
                (event, (model.struck(self._rules, world, event), budget - 1))
                for event in model.events(self._rules, world)
            ]
        for event, new in following:
            if new in self._from:
                continue
            self._from[new] = (node, event)
            what = wrong(self._rules, new[0], self._budget - new[1])
            if not what and event is None and not self._settles(new[0]):
                what = "when all live again, something still runs, or what is wanted next does not begin"
            if what:
                return Found(what, self._scenario(new))
            self._front.append(new)
        return None

    def _settles(self, world: "parts.World") -> bool:
        """Invariant (c): everything ends once all live and nothing is wanted, and the next goal runs."""
        world = model.healed(self._rules, world)
        passed: List[parts.World] = []
        for _ in range(SETTLE):
            known = self._settled.get(world)
            if known is not None:
                break
            passed.append(world)
            if model.quiet(world):
                known = self._next_goal_runs(world)
                break
            world = model.after(self._rules, world)
        result = bool(known)
        self._settled.update((each, result) for each in passed)
        return result

    def _next_goal_runs(self, world: "parts.World") -> bool:
        world = model.wanted(world, "N")
        for _ in range(self._rules.length + 4):
            world = model.after(self._rules, world)
        return len(parts.passing(world)) == 1

    def _scenario(self, node: tuple) -> List[str]:
        events: List[str] = []
        moment = 0
        steps = []
        while self._from[node] is not None:
            node, event = self._from[node]
            steps.append(event)
        for event in reversed(steps):
            if event is None:
                moment += 1
            else:
                events.append(f"round {moment}: {' '.join(event)}")
        return events


@pytest.mark.parametrize(
    ("length", "actions", "budget"),
    [(5, "AB", 1), (2, "AB", 2)],
)
def test_no_scenario_breaks_an_invariant(length: int, actions: str, budget: int) -> None:
    search = Search(parts.Rules(length), actions, budget)
    assert search.run() is None
    assert search.states > 500


@pytest.mark.long
@pytest.mark.parametrize(("length", "actions", "budget"), [(3, "A", 2), (5, "A", 2), (2, "A", 3)])
def test_no_long_scenario_breaks_an_invariant(length: int, actions: str, budget: int) -> None:
    assert Search(parts.Rules(length), actions, budget).run() is None


def play(rules: "parts.Rules", script: Dict[int, List[str]], rounds: int = 60) -> str:
    """What goes wrong when these events happen; empty: nothing."""
    world = parts.begin(rules, "A")
    faults = 0
    for moment in range(rounds):
        for event in script.get(moment, []):
            faults += 1
            world = model.struck(rules, world, tuple(event.split()))
        world = model.after(rules, world)
        what = wrong(rules, world, faults)
        if what:
            return what
    return ""


#: A rule that the protocol needs, and a scenario that shows it.
NEEDED = {
    "a client that dies before its first lease is heard": (
        {"leases_named": False},
        # Process 1 sends its goal in round 1; goal and lease are on separate connections.
        {2: ["lose lease 1", "lose lease -1", "kill 1"]},
    ),
    "a guard that begins when the client is dead": (
        {"guard_asks": False, "leases_named": False, "server_leases": False},
        {8: ["kill -1", "kill 1"], 10: ["restart -1"]},
    ),
    "a guard that hung when the client died": (
        {"guard_asks": False, "server_leases": False},
        {8: ["hang -1", "kill 1"], 20: ["resume -1"]},
    ),
    "a cancel that gets lost": (
        {"repeat_cancel": False},
        {8: ["cancel A"], 10: ["lose cancel 1"]},
    ),
}


@pytest.mark.parametrize("case", NEEDED)
def test_each_rule_is_needed(case: str) -> None:
    without, script = NEEDED[case]
    assert play(parts.Rules(2)._replace(**without), script), "the scenario does no harm"
    kept = {key: value for key, value in without.items() if key == "server_leases"}
    assert play(parts.Rules(2)._replace(**kept), script) == ""


@pytest.mark.parametrize("length", [2, 5])
def test_a_short_hang_loses_nothing(length: int) -> None:
    """Invariant (d): of one process or of two, at any moments."""
    rules = parts.Rules(length)
    everybody = [*range(length + 1), parts.GUARD]
    for first in everybody:
        for second in everybody:
            for offset in range(parts.LOSE + 2):
                world = parts.begin(rules, "A")
                script: Dict[int, List[Event]] = {}
                for process, begin in {(first, 8), (second, 8 + offset if second != first else 8)}:
                    script.setdefault(begin, []).append(("hang", str(process)))
                    script.setdefault(begin + parts.LOSE - 1, []).append(("resume", str(process)))
                for moment in range(30):
                    for event in script.get(moment, []):
                        world = model.struck(rules, world, event)
                    world = model.after(rules, world)
                assert len(parts.passing(world)) == 1, (first, second, offset)
                assert not world.unowned
