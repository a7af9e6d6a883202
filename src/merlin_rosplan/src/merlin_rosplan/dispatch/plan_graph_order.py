# SPDX-License-Identifier: Apache-2.0
"""The order of a plan's happenings: by time, and among those of one time by what they need of each other."""

import heapq
import itertools
from typing import Dict, Iterable, List, Sequence, Set

from merlin_rosplan.dispatch.happening import Happening
from merlin_rosplan.dispatch.operator_model import PlanTerm
from merlin_rosplan.dispatch.plan_graph import Node, NodeType


def plan_order(nodes: Sequence[Node], times: Sequence[float], happenings: Sequence[Happening]) -> List[Node]:
    """Starts and ends in the order of the plan.

    Rounded plans put an end and the start that it makes possible on the same time, and PDDL lets two actions
    start together of which one brings about the other's over-all condition.

    :param nodes: all of the graph; times and happenings by id. The start of the plan is left out.
    """
    ordered: List[Node] = []
    by_time = sorted(nodes[1:], key=lambda node: (times[node.id], node.id))
    for _, group in itertools.groupby(by_time, key=lambda node: times[node.id]):
        members = list(group)
        ordered.extend(_sorted_group(members, happenings) if len(members) > 1 else members)
    return ordered


def _sorted_group(nodes: List[Node], happenings: Sequence[Happening]) -> List[Node]:
    """A provider before its consumer, a reader of a fact before its writer; else by id."""
    adders: Dict[PlanTerm, List[int]] = {}
    deleters: Dict[PlanTerm, List[int]] = {}
    for node in nodes:
        for atom in happenings[node.id].add:
            adders.setdefault(atom, []).append(node.id)
        for atom in happenings[node.id].delete:
            deleters.setdefault(atom, []).append(node.id)
    before: Dict[int, Set[int]] = {node.id: set() for node in nodes}
    after: Dict[int, Set[int]] = {node.id: set() for node in nodes}

    def order(first: int, second: int) -> None:
        if first != second and first not in after[second]:
            before[second].add(first)
            after[first].add(second)

    for node in nodes:
        if node.type == NodeType.ACTION_END and node.id - 1 in before:
            order(node.id - 1, node.id)
    for node in nodes:
        happening = happenings[node.id]
        for needs, keeps, makers, breakers in (
            (happening.positive, happening.keep_positive, adders, deleters),
            (happening.negative, happening.keep_negative, deleters, adders),
        ):
            for maker in _nodes_of(needs, makers):
                order(maker, node.id)
            for breaker in _nodes_of(keeps, breakers):
                order(node.id, breaker)
    return _topological(nodes, before, after)


def _nodes_of(atoms: Iterable[PlanTerm], index: Dict[PlanTerm, List[int]]) -> Set[int]:
    return {node for atom in atoms for node in index.get(atom, ())}


def _topological(nodes: List[Node], before: Dict[int, Set[int]], after: Dict[int, Set[int]]) -> List[Node]:
    by_id = {node.id: node for node in nodes}
    free = [node.id for node in nodes if not before[node.id]]
    heapq.heapify(free)
    ordered: List[Node] = []
    left = set(by_id)
    while left:
        # a cycle comes from a plan that PDDL does not allow: it is broken at the lowest number
        number = heapq.heappop(free) if free else min(left)
        if number not in left:
            continue
        left.discard(number)
        ordered.append(by_id[number])
        for successor in sorted(after[number]):
            before[successor].discard(number)
            if successor in left and not before[successor]:
                heapq.heappush(free, successor)
    return ordered
