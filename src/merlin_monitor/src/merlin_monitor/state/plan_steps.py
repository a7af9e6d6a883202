# SPDX-License-Identifier: Apache-2.0
"""The steps of a plan message, and which comes before which."""

from typing import Any, Dict, List, NamedTuple, Sequence, Set, Tuple, Union

from merlin_monitor.text.fact_text import atom_text

ACTION_START, ACTION_END, PLAN_START = 0, 1, 2
#: What an edge joins that does not go from the end of one step to the start of another.
FROM_START, TO_END = "start", "end"


class ShownStep(NamedTuple):
    """An action of a plan; times in s from the plan's start."""

    id: int
    name: str
    parameters: List[Tuple[str, str]]
    start: float
    duration: float

    @property
    def text(self) -> str:
        """``(navigate anywhere kitchen)``."""
        return atom_text(self.name, [value for _, value in self.parameters])


#: Which step comes before which; `FROM_START` or `TO_END` where it is not its end before the other's start.
Edges = Sequence[Union[Tuple[int, int], Tuple[int, int, str]]]


def sequential_steps(message: Any) -> Tuple[List[ShownStep], Edges]:
    """The order of a rosplan_dispatch_msgs/CompletePlan: one action after the other."""
    steps = [_step(action) for action in message.plan]
    return steps, [(before.id, after.id) for before, after in zip(steps, steps[1:])]


def graph_steps(message: Any) -> Tuple[List[ShownStep], Edges]:
    """The order of a rosplan_dispatch_msgs/EsterelPlan, without edges that others imply."""
    steps = {
        node.action.action_id: _step(node.action) for node in message.nodes if node.node_type == ACTION_START
    }
    owner = {node.node_id: node.action.action_id for node in message.nodes if node.node_type != PLAN_START}
    ends = {node.node_id for node in message.nodes if node.node_type == ACTION_END}
    after: Dict[int, Set[int]] = {identity: set() for identity in steps}
    kinds: Dict[Tuple[int, int], Set[str]] = {}
    for edge in message.edges:
        for source in edge.source_ids:
            for sink in edge.sink_ids:
                before, behind = owner.get(source), owner.get(sink)
                if before is None or behind is None or before == behind:
                    continue
                if before in steps and behind in steps:
                    after[before].add(behind)
                    kind = TO_END if sink in ends else "" if source in ends else FROM_START
                    kinds.setdefault((before, behind), set()).add(kind)
    ordered = sorted(steps.values(), key=lambda step: (step.start, step.id))
    return ordered, [_edge(*pair, kinds[pair]) for pair in _without_implied(after)]


def _edge(before: int, behind: int, kinds: Set[str]) -> Union[Tuple[int, int], Tuple[int, int, str]]:
    kind = next(each for each in ("", FROM_START, TO_END) if each in kinds)
    return (before, behind, kind) if kind else (before, behind)


def _step(action: Any) -> ShownStep:
    parameters = [(parameter.key, parameter.value) for parameter in action.parameters]
    return ShownStep(action.action_id, action.name, parameters, action.dispatch_time, action.duration)


def _without_implied(after: Dict[int, Set[int]]) -> List[Tuple[int, int]]:
    """Edges a→c are dropped where a way a→b→…→c exists. A cycle keeps its edges."""
    reach: Dict[int, Set[int]] = {}

    def reachable(start: int) -> Set[int]:
        if start not in reach:
            found: Set[int] = set()
            waiting = list(after[start])
            while waiting:
                node = waiting.pop()
                if node not in found:
                    found.add(node)
                    waiting.extend(after[node])
            reach[start] = found
        return reach[start]

    edges: List[Tuple[int, int]] = []
    for before, targets in sorted(after.items()):
        for target in sorted(targets):
            implied = any(
                target in reachable(other) and before not in reachable(other)
                for other in targets
                if other != target and other not in reachable(target)
            )
            if not implied:
                edges.append((before, target))
    return edges
