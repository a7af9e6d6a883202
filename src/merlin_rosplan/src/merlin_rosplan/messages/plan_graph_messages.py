# SPDX-License-Identifier: Apache-2.0
"""Plan graphs as EsterelPlan messages and as DOT text."""

from typing import Callable, Dict, List, Sequence, Tuple

from rosplan_dispatch_msgs.msg import ActionDispatch, EsterelPlan, EsterelPlanEdge, EsterelPlanNode

from merlin_rosplan.dispatch.dispatch_schedule import PlanError
from merlin_rosplan.dispatch.plan_graph import NO_BOUND, EdgeType, Node, NodeType, PlanGraph

_EDGE_TYPES = {int(kind): kind for kind in EdgeType}
_EDGE_COLOURS = {EdgeType.CONDITION: "green", EdgeType.START_END: "red", EdgeType.INTERFERENCE: "blue"}


#: `signal_type` of an edge that an action must not overtake; ROSPlan leaves it 0.
STRICT = 1


def graph_to_message(graph: PlanGraph, actions: Sequence[ActionDispatch]) -> EsterelPlan:
    """A graph on the wire; `actions` by index."""
    nothing = ActionDispatch()
    return EsterelPlan(
        nodes=[
            EsterelPlanNode(
                node_type=int(node.type),
                node_id=node.id,
                name=node.name,
                action=actions[node.action] if node.action >= 0 else nothing,
                edges_out=node.edges_out,
                edges_in=node.edges_in,
            )
            for node in graph.nodes
        ],
        edges=[
            EsterelPlanEdge(
                edge_type=int(edge.type),
                edge_id=edge.id,
                edge_name=f"edge_{edge.id}",
                signal_type=STRICT if edge.strict else 0,
                source_ids=[edge.source],
                sink_ids=[edge.sink],
                duration_lower_bound=edge.lower,
                duration_upper_bound=edge.upper,
            )
            for edge in graph.edges
        ],
    )


def graph_from_message(plan: EsterelPlan) -> Tuple[PlanGraph, List[ActionDispatch]]:
    """A graph from the wire, and its actions by index.

    :raises PlanError: ids are not unique, or an edge ends nowhere.
    """
    position = {node.node_id: index for index, node in enumerate(plan.nodes)}
    if len(position) < len(plan.nodes):
        raise PlanError("two nodes of the plan graph have the same id")
    actions: List[ActionDispatch] = []
    index_of: Dict[int, int] = {}
    graph = PlanGraph()
    for index, node in enumerate(plan.nodes):
        action = -1
        if node.node_type != NodeType.PLAN_START:
            if node.action.action_id not in index_of:
                index_of[node.action.action_id] = len(actions)
                actions.append(node.action)
            action = index_of[node.action.action_id]
        try:
            kind = NodeType(node.node_type)
        except ValueError:
            raise PlanError(
                f"node {node.node_id} of the plan graph has the unknown type {node.node_type}"
            ) from None
        graph.nodes.append(Node(index, kind, node.name, action))
    for edge in plan.edges:
        edge_type = _EDGE_TYPES.get(edge.edge_type, EdgeType.CONDITION)
        for source in edge.source_ids:
            for sink in edge.sink_ids:
                if source not in position or sink not in position:
                    raise PlanError(
                        f"edge {edge.edge_id} of the plan graph joins nodes that it does not have"
                    )
                graph.connect(
                    edge_type,
                    position[source],
                    position[sink],
                    edge.duration_lower_bound,
                    edge.duration_upper_bound,
                    edge.signal_type == STRICT,
                )
    return graph, actions


def graph_to_dot(
    graph: PlanGraph,
    actions: Sequence[ActionDispatch],
    state: Callable[[Node], str],
    active: Callable[[int], bool],
    display_edge_type: bool = False,
) -> str:
    """The graph as ROSPlan draws it.

    :param state: of a node: ``plan_start``, ``waiting``, ``dispatched`` or ``completed``.
    :param active: of an edge id.
    :param display_edge_type: colour edges by their type and not by whether they are active.
    """
    lines = ["digraph plan {"]
    for node in graph.nodes:
        label = node.name
        if node.action >= 0:
            label += "\\n(" + ",".join(entry.value for entry in actions[node.action].parameters) + ")"
        style = {
            "plan_start": ",style=filled,fillcolor=black,fontcolor=white",
            "completed": ",style=filled,fillcolor=darkolivegreen,fontcolor=white",
            "dispatched": ",style=filled,fillcolor=darkgoldenrod2",
        }.get(state(node), "")
        lines.append(f'{node.id}[ label="{label}"{style}];')
    for edge in graph.edges:
        upper = "inf" if edge.upper >= NO_BOUND else f"{edge.upper:g}"
        colour = "red" if active(edge.id) else "black"
        if display_edge_type:
            colour = _EDGE_COLOURS[edge.type]
        lines.append(
            f'"{edge.source}" -> "{edge.sink}" [ label="[{edge.lower:g}, {upper}]" '
            f', penwidth=2, color="{colour}"]'
        )
    lines.append("}")
    return "\n".join(lines) + "\n"
