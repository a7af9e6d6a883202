# SPDX-License-Identifier: Apache-2.0
"""The expected number of actions of a robot that knows where everything is. Without ROS.

The best policy repeats each action until it succeeds, as a failed one changes nothing: one with the chance p
counts 1/p. The fewest are found by A*, over where robot and wanted things are and what is open. A battery is
left out, so with one the figure is a lower bound.
"""

import heapq
import itertools
from typing import Collection, Dict, FrozenSet, Iterator, List, NamedTuple, Optional, Tuple

from deliberation.house import House, State, accessible, holds


class _Node(NamedTuple):
    site: str
    room: str
    holding: str
    things: Tuple[str, ...]  # spots, in the order of the wanted things; the held one: empty
    open: FrozenSet[str]


def expected_actions(house: House, state: State, goals: Collection[Tuple[str, ...]]) -> Optional[float]:
    """How many actions are expected, failed ones included, until all goals hold; None: they cannot.

    :param state: where it begins.
    :param goals: as of :func:`deliberation.house.holds`.
    """
    wanted = sorted({goal[1] for goal in goals if goal[0] == "is_at"})
    return _Search(house, state, wanted, list(goals)).run()


class _Search:
    def __init__(self, house: House, state: State, wanted: List[str], goals: List[Tuple[str, ...]]) -> None:
        self._house, self._state, self._wanted, self._goals = house, state, wanted, goals
        self._cost = {name: house.tries(name) for name in ("navigate", "pick", "place", "open", "close")}
        self._targets = {goal[1]: goal[2] for goal in goals if goal[0] == "is_at"}
        # What never needs to be opened or visited is left out.
        self._spots = [name for name in house.of_kind("spot") if name in self._useful()]

    def _useful(self) -> FrozenSet[str]:
        named = {goal[-1] for goal in self._goals}
        tables = [name for name in self._house.of_kind("spot") if name in self._state.open]
        return frozenset(named | {self._state.things[thing] for thing in self._wanted} | set(tables))

    def run(self) -> Optional[float]:
        state = self._state
        first = _Node(
            state.site,
            state.room,
            state.holding,
            tuple(state.things[thing] for thing in self._wanted),
            state.open,
        )
        order = itertools.count()
        done: Dict[_Node, float] = {}
        queue = [(self._bound(first), next(order), 0.0, first)]
        while queue:
            _, _, cost, node = heapq.heappop(queue)
            if node in done:
                continue
            done[node] = cost
            if all(holds(goal, self._as_state(node)) for goal in self._goals):
                return cost
            for action, successor in self._next(node):
                if successor not in done:
                    further = cost + self._cost[action]
                    heapq.heappush(queue, (further + self._bound(successor), next(order), further, successor))
        return None

    def _as_state(self, node: _Node) -> State:
        things = dict(zip(self._wanted, node.things))
        return self._state._replace(
            site=node.site, room=node.room, holding=node.holding, open=node.open, things=things
        )

    def _bound(self, node: _Node) -> float:
        """At least this: each thing is taken to where it shall be, by a drive that ends there."""
        bound = 0.0
        for thing, spot in zip(self._wanted, node.things):
            if thing == node.holding:
                bound += self._cost["place"] + (self._cost["navigate"] * (node.site != self._targets[thing]))
            elif spot != self._targets[thing]:
                bound += self._cost["pick"] + self._cost["place"] + self._cost["navigate"]
        for goal in self._goals:
            if goal[:2] == ("not", "is_open") and goal[2] in node.open:
                bound += self._cost["close"]
            elif goal[0] == "is_open" and goal[1] not in node.open:
                bound += self._cost["open"]
        return bound

    def _next(self, node: _Node) -> Iterator[Tuple[str, _Node]]:
        house, there = self._house, accessible(self._house, self._as_state(node))
        for name in [*self._spots, *house.of_kind("door")]:
            site = house.sites[name]
            reached = [room for room in site.rooms if room in there]
            if name != node.site and reached and not (site.kind == "door" and name in node.open):
                yield "navigate", node._replace(site=name, room=reached[0])
        if not node.site:
            return
        if not node.holding and node.site not in node.open:
            yield "open", node._replace(open=node.open | {node.site})
        if house.sites[node.site].kind != "spot" or node.site not in node.open:
            return
        for number, (thing, spot) in enumerate(zip(self._wanted, node.things)):
            before, after = node.things[:number], node.things[number + 1 :]
            if node.holding == thing:
                yield "place", node._replace(holding="", things=(*before, node.site, *after))
            elif not node.holding and spot == node.site:
                yield "pick", node._replace(holding=thing, things=(*before, "", *after))
        if not node.holding and ("not", "is_open", node.site) in self._goals:
            yield "close", node._replace(open=node.open - {node.site})
