"""What a plan allows to start next: in the order of a list, or as a plan graph says."""

import abc
from dataclasses import dataclass, field
from typing import Any, Dict, Iterable, List, Optional, Set, Tuple

from merlin_rosplan.plan_graph import MIN_BOUND, NO_BOUND, EdgeType, Node, NodeType, PlanGraph

_PAST = 1e-6  # s after a latest time at which it has passed


class PlanError(ValueError):
    """A plan that cannot be dispatched; the text says why."""


@dataclass(frozen=True)
class PlannedAction:
    """A ground action of a plan.

    Parameters
    ----------
    id: unique in its plan.
    name: PDDL operator.
    parameters: (label, object), in the order of the operator's parameters.
    duration, time: planned, s.
    message: what the plan had it from, for whoever publishes it.
    """

    id: int
    name: str
    parameters: Tuple[Tuple[str, str], ...] = ()
    duration: float = 0.0
    time: float = 0.0
    message: Any = field(default=None, compare=False, repr=False)

    def __str__(self) -> str:
        return "(" + " ".join((self.name,) + tuple(value for _, value in self.parameters)) + ")"


class Schedule(abc.ABC):
    """The state of one run of a plan. Times are seconds of ROS time; not thread-safe."""

    def __init__(self, actions: Iterable[PlannedAction]) -> None:
        self.actions: Dict[int, PlannedAction] = {}
        for action in actions:
            if action.id in self.actions:
                raise PlanError(f"two actions of the plan have the id {action.id}")
            self.actions[action.id] = action

    @property
    @abc.abstractmethod
    def finished(self) -> bool:
        """Whether every action has succeeded."""

    def begin(self, now: float) -> None:  # noqa: B027 - nothing to do is a fine default
        """The plan starts."""

    @abc.abstractmethod
    def ready(self, now: float) -> List[PlannedAction]:
        """Actions that may start now and have not been started."""

    @abc.abstractmethod
    def started(self, action_id: int, now: float) -> None:
        """An action was dispatched."""

    @abc.abstractmethod
    def ended(self, action_id: int, now: float) -> None:
        """An action has succeeded."""

    def wake_time(self, now: float) -> Optional[float]:
        """The next time after now at which something becomes ready or late by itself; None: never."""
        return None

    def waits_for_time(self, action_id: int) -> bool:
        """Whether an action had to wait for a time, as for one that a timed literal needs."""
        return False

    def late(self, now: float) -> Optional[str]:
        """Which time bound is broken, one sentence; None when none is."""
        return None

    @abc.abstractmethod
    def waiting(self) -> List[str]:
        """Actions that have not been started, as text."""


class SequentialSchedule(Schedule):
    """One action after the other, in the order of the list; their times do not matter."""

    def __init__(self, actions: Iterable[PlannedAction]) -> None:
        ordered = list(actions)
        super().__init__(ordered)
        self._order = ordered
        self._next = 0
        self._running = False

    @property
    def finished(self) -> bool:
        """Whether every action has succeeded."""
        return self._next >= len(self._order) and not self._running

    def ready(self, now: float) -> List[PlannedAction]:
        """The next action, when the one before it has ended."""
        return [] if self._running else self._order[self._next : self._next + 1]

    def started(self, action_id: int, now: float) -> None:
        """The next action was dispatched."""
        self._running = True
        self._next += 1

    def ended(self, action_id: int, now: float) -> None:
        """It has succeeded."""
        self._running = False

    def waiting(self) -> List[str]:
        """The rest of the list."""
        return [str(action) for action in self._order[self._next :]]


class GraphSchedule(Schedule):
    """As the edges of a plan graph allow; actions run in parallel.

    Parameters
    ----------
    graph: ids of nodes and edges are their indices.
    actions: by index, as `Node.action` counts.
    bounds: whether the time bounds of edges are kept. Without, only the earliest times that timed literals
        set are: before them the world is not ready.
    fraction: by which bounds are widened.

    Raises
    ------
    PlanError: the graph is not one that can be run.
    """

    def __init__(
        self, graph: PlanGraph, actions: List[PlannedAction], bounds: bool = False, fraction: float = 0.0
    ) -> None:
        super().__init__(actions)
        self._graph = graph
        self._actions = actions
        self._bounds = bounds
        self._fraction = fraction
        self._start_of = {
            actions[node.action].id: node for node in graph.nodes if node.type == NodeType.ACTION_START
        }
        self._end_of = {
            actions[node.action].id: node for node in graph.nodes if node.type == NodeType.ACTION_END
        }
        if set(self._start_of) != set(self.actions) or set(self._end_of) != set(self.actions):
            raise PlanError("the plan graph does not have one start and one end node for each action")
        self._missing = [len(node.edges_in) for node in graph.nodes]  # incoming edges that are not active
        self._time: Dict[int, float] = {}  # of nodes that have happened
        self._started: Set[int] = set()
        self._completed: Set[int] = set()  # actions that ended; their end node may still wait for others
        self._candidates: Set[int] = set()  # nodes with all edges active that have not happened
        self._check_acyclic()

    @property
    def finished(self) -> bool:
        """Whether every node has happened."""
        return len(self._time) == len(self._graph.nodes)

    @property
    def active_edges(self) -> Set[int]:
        """Edges whose source has happened and whose sink has not."""
        return {
            edge
            for node in list(self._time)  # a copy: whoever draws reads while the dispatch goes on
            for edge in self._graph.nodes[node].edges_out
            if self._graph.edges[edge].sink not in self._time
        }

    def node_state(self, node: Node) -> str:
        """``waiting``, ``dispatched`` or ``completed``."""
        if node.type == NodeType.PLAN_START:
            return "plan_start"
        action = self._actions[node.action].id
        if action in self._completed:
            return "completed"
        return "dispatched" if action in self._started else "waiting"

    def begin(self, now: float) -> None:
        """The nodes without predecessors become possible; the start of the plan happens."""
        for node in self._graph.nodes:
            if not self._missing[node.id]:
                self._candidates.add(node.id)
        for node in self._graph.nodes:
            if node.type == NodeType.PLAN_START:
                self._happen(node.id, now)

    def ready(self, now: float) -> List[PlannedAction]:
        """Actions whose start node has all its edges active and is not too early."""
        return [
            self._actions[self._graph.nodes[node].action]
            for node in sorted(self._candidates)
            if self._graph.nodes[node].type == NodeType.ACTION_START and self._earliest(node) <= now
        ]

    def started(self, action_id: int, now: float) -> None:
        """The start node happens."""
        self._started.add(action_id)
        self._happen(self._start_of[action_id].id, now)

    def ended(self, action_id: int, now: float) -> None:
        """The end node happens, once its other edges allow it."""
        self._completed.add(action_id)
        self._happen_if_due(self._end_of[action_id].id, now)

    def wake_time(self, now: float) -> Optional[float]:
        """The next bound of a node that waits for nothing else."""
        times: List[float] = []
        for node in self._candidates:
            if self._graph.nodes[node].type == NodeType.ACTION_START:
                times.append(self._earliest(node))
            if self._bounds:
                times.append(self._latest(node) + _PAST)
        return min((time for time in times if now < time < NO_BOUND), default=None)

    def waits_for_time(self, action_id: int) -> bool:
        """Whether an edge bounds its start from below."""
        return self._earliest(self._start_of[action_id].id) > 0.0

    def late(self, now: float) -> Optional[str]:
        """The first node whose latest time has passed; without bounds nothing is late."""
        if not self._bounds:
            return None
        for node_id in sorted(self._candidates):
            latest = self._latest(node_id)
            if now > latest:
                node = self._graph.nodes[node_id]
                verb = "started" if node.type == NodeType.ACTION_START else "ended"
                return f"{self._actions[node.action]} should have {verb} {now - latest:.3f} s ago"
        return None

    def waiting(self) -> List[str]:
        """Actions that were not started."""
        return [str(action) for action in self._actions if action.id not in self._started]

    def _happen(self, node_id: int, now: float) -> None:
        self._time[node_id] = now
        self._candidates.discard(node_id)
        for edge_id in self._graph.nodes[node_id].edges_out:
            sink = self._graph.edges[edge_id].sink
            self._missing[sink] -= 1
            if not self._missing[sink] and sink not in self._time:
                self._candidates.add(sink)
                self._happen_if_due(sink, now)

    def _happen_if_due(self, node_id: int, now: float) -> None:
        node = self._graph.nodes[node_id]
        if (
            node.type == NodeType.ACTION_END
            and node_id in self._candidates
            and self._actions[node.action].id in self._completed
        ):
            self._happen(node_id, now)

    def _earliest(self, node_id: int) -> float:
        earliest = 0.0
        for edge_id in self._graph.nodes[node_id].edges_in:
            edge = self._graph.edges[edge_id]
            from_start = self._graph.nodes[edge.source].type == NodeType.PLAN_START
            literal = from_start and edge.type == EdgeType.CONDITION and edge.lower > MIN_BOUND
            if literal:  # no tolerance makes the world ready before its time
                earliest = max(earliest, self._time[edge.source] + edge.lower)
            elif self._bounds and edge.lower > MIN_BOUND:
                earliest = max(earliest, self._time[edge.source] + edge.lower * (1.0 - self._fraction))
        return earliest

    def _latest(self, node_id: int) -> float:
        latest = NO_BOUND
        for edge_id in self._graph.nodes[node_id].edges_in:
            edge = self._graph.edges[edge_id]
            if edge.upper < NO_BOUND:
                latest = min(latest, self._time[edge.source] + edge.upper * (1.0 + self._fraction))
        return latest

    def _check_acyclic(self) -> None:
        missing = list(self._missing)
        free = [node.id for node in self._graph.nodes if not missing[node.id]]
        seen = 0
        while free:
            seen += 1
            for edge_id in self._graph.nodes[free.pop()].edges_out:
                sink = self._graph.edges[edge_id].sink
                missing[sink] -= 1
                if not missing[sink]:
                    free.append(sink)
        if seen < len(self._graph.nodes):
            stuck = [node.name for node in self._graph.nodes if missing[node.id] > 0]
            raise PlanError(f"the plan graph has a cycle through {', '.join(stuck[:5])}")
