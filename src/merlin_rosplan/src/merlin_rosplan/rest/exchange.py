# SPDX-License-Identifier: Apache-2.0
"""A plan that takes the place of what has not begun of another, while actions of that one go on. Pure."""

import dataclasses
from typing import Callable, List, Sequence

from merlin_pddl.plan_text import PlanStep
from merlin_rosplan.dispatch.dispatch_schedule import Ongoing, PlanError, PlannedAction
from merlin_rosplan.dispatch.operator_model import ActionModel
from merlin_rosplan.dispatch.plan_graph import MIN_BOUND, EdgeType, Node, NodeType, PlanGraph
from merlin_rosplan.dispatch.plan_graph_builder import build_graph

LONG_PLAN = 50  # actions; behind a running one a longer plan has no edges that others imply


def continued_list(actions: Sequence[PlannedAction], ongoing: Ongoing) -> List[PlannedAction]:
    """A plan of one action after the other, behind those that go on.

    :raises PlanError: as :func:`continued_graph`.
    """
    first = _taken_up(actions, ongoing, lambda index: index == 0 and not ongoing.kept)
    return [*_before(ongoing.kept), *first]


def continued_graph(
    graph: PlanGraph,
    actions: Sequence[PlannedAction],
    ongoing: Ongoing,
    operator: Callable[[PlannedAction], ActionModel],
) -> List[PlannedAction]:
    """Adds the actions that go on to the graph of a plan.

    A step of the plan follows the end of each that it interferes with, as in one plan for all.

    :param graph: of the plan; is changed.
    :param actions: its actions, by index.
    :param operator: gives the ground model of an action.
    :return: the actions by index, in `graph` as it is then.
    :raises PlanError: an action of the plan has the id of another one, or it does not begin with one that is
        new.
    """
    starts = {node.action: node for node in graph.nodes if node.type == NodeType.ACTION_START}
    ends = {node.action: node for node in graph.nodes if node.type == NodeType.ACTION_END}

    def is_first(index: int) -> bool:
        edges = graph.into(starts[index].id)
        return all(graph.nodes[edge.source].type == NodeType.PLAN_START for edge in edges)

    kept = _before(ongoing.kept)
    found = [*_taken_up(actions, ongoing, is_first), *kept]
    if not kept:
        return found
    for index, action in enumerate(kept, len(actions)):
        for nodes, type_, word in (
            (starts, NodeType.ACTION_START, "start"),
            (ends, NodeType.ACTION_END, "end"),
        ):
            nodes[index] = Node(len(graph.nodes), type_, f"{action.name}_{word}", index)
            graph.nodes.append(nodes[index])
        graph.connect(EdgeType.START_END, starts[index].id, ends[index].id)
    # Of one graph of all, in which the plan comes behind, the edges that lead from these to the plan.
    behind = max(action.duration for action in kept) + 1.0
    order = [*range(len(actions), len(found)), *range(len(actions))]
    steps = []
    for index in order:
        action = found[index]
        time = 0.0 if index >= len(actions) else behind + action.time
        steps.append(
            PlanStep(time, action.name, tuple(value for _, value in action.parameters), action.duration)
        )
    models = [operator(found[index]) for index in order]
    whole = build_graph(steps, models, reduce=len(actions) > LONG_PLAN)
    for edge in whole.edges:
        source, sink = whole.nodes[edge.source], whole.nodes[edge.sink]
        if not 0 <= source.action < len(kept) <= sink.action:
            continue
        # A planned separation stands for a wait that was not possible: here it is.
        at_start = source.type == NodeType.ACTION_START and edge.lower <= MIN_BOUND
        nodes = starts if sink.type == NodeType.ACTION_START else ends
        before = (starts if at_start else ends)[order[source.action]]
        graph.connect(edge.type, before.id, nodes[order[sink.action]].id)
    return found


def _before(kept: Sequence[PlannedAction]) -> List[PlannedAction]:
    """The actions that go on, with times that put their ends before the plan."""
    return [dataclasses.replace(action, time=-action.duration) for action in kept]


def _taken_up(
    actions: Sequence[PlannedAction], ongoing: Ongoing, is_first: Callable[[int], bool]
) -> List[PlannedAction]:
    """The actions of the plan; what runs already stands for the step that the plan begins with."""
    if any(action.id in ongoing.used for action in actions):
        raise PlanError("the ids of its actions were used before: it was not planned as one that follows")
    found = list(actions)
    for running in ongoing.others:
        for index, action in enumerate(actions):
            if found[index] is action and str(action).lower() == str(running).lower() and is_first(index):
                found[index] = dataclasses.replace(action, id=running.id)
                break
        else:
            if running.id in ongoing.new:
                raise PlanError(f"{running} has begun since it was made, and it does not begin with that")
    return found
