# SPDX-License-Identifier: Apache-2.0
"""The plan graph ("Esterel plan"): a simple temporal network of action starts and ends.

Numbers, names and bounds are those of ROSPlan's Esterel parser: node 0 is the start of the plan, action k has
the start node 2k+1 and the end node 2k+2, edge ids are indices.
"""

import sys
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Dict, List, NamedTuple, Tuple

from merlin_rosplan.dispatch.operator_model import PlanTerm

NO_BOUND = sys.float_info.max  # "no upper bound" on the wire
MIN_BOUND = 0.001  # what a bound of zero becomes, s


class NodeType(IntEnum):
    """Kind of a node; the numbers are those of EsterelPlanNode."""

    ACTION_START = 0
    ACTION_END = 1
    PLAN_START = 2


class EdgeType(IntEnum):
    """Kind of an edge; the numbers are those of EsterelPlanEdge."""

    CONDITION = 0
    START_END = 1
    INTERFERENCE = 2


@dataclass
class Node:
    """A start, an end, or the start of the plan. `action` is the action's index, -1 for the plan's start."""

    id: int
    type: NodeType
    name: str
    action: int
    edges_in: List[int] = field(default_factory=list)
    edges_out: List[int] = field(default_factory=list)


@dataclass
class Edge:
    """`sink` happens between `lower` and `upper` seconds after `source`.

    `strict`: when an action ends before the source of such an edge into its end has happened, the plan was
    not carried out, and nothing else would notice.
    """

    id: int
    type: EdgeType
    source: int
    sink: int
    lower: float = MIN_BOUND
    upper: float = NO_BOUND
    strict: bool = False


class TimedLiteral(NamedTuple):
    """A fact that becomes true (or false, if negative) at a time of the plan, s from its start."""

    time: float
    atom: PlanTerm
    negative: bool = False


class TimedValue(NamedTuple):
    """A function term that gets a value at a time of the plan, s from its start."""

    time: float
    term: PlanTerm
    value: float


@dataclass
class PlanGraph:
    """Nodes and edges; both lists are indexed by id."""

    nodes: List[Node] = field(default_factory=list)
    edges: List[Edge] = field(default_factory=list)
    _pairs: Dict[Tuple[int, int], int] = field(default_factory=dict, repr=False)

    def connect(
        self,
        type_: EdgeType,
        source: int,
        sink: int,
        lower: float = 0.0,
        upper: float = NO_BOUND,
        strict: bool = False,
    ) -> Edge:
        """Adds an edge; a second one between the same nodes only tightens the first."""
        lower = max(lower, MIN_BOUND)
        upper = max(upper, MIN_BOUND)
        known = self._pairs.get((source, sink))
        if known is not None:
            edge = self.edges[known]
            edge.lower = max(edge.lower, lower)
            edge.upper = min(edge.upper, upper)
            edge.strict |= strict
            return edge
        edge = Edge(len(self.edges), type_, source, sink, lower, upper, strict)
        self.edges.append(edge)
        self._pairs[(source, sink)] = edge.id
        self.nodes[source].edges_out.append(edge.id)
        self.nodes[sink].edges_in.append(edge.id)
        return edge

    def into(self, node: int) -> List[Edge]:
        """The edges that lead to a node."""
        return [self.edges[edge] for edge in self.nodes[node].edges_in]

    def snapshot(self) -> List[Tuple[float, float, bool]]:
        """The edges as they are, for :meth:`restore`."""
        return [(edge.lower, edge.upper, edge.strict) for edge in self.edges]

    def restore(self, snapshot: List[Tuple[float, float, bool]]) -> None:
        """Takes back what was connected since."""
        for edge in self.edges[len(snapshot) :]:
            self.nodes[edge.source].edges_out.remove(edge.id)
            self.nodes[edge.sink].edges_in.remove(edge.id)
            del self._pairs[edge.source, edge.sink]
        del self.edges[len(snapshot) :]
        for edge, kept in zip(self.edges, snapshot):
            edge.lower, edge.upper, edge.strict = kept
