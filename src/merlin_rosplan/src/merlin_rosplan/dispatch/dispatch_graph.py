# SPDX-License-Identifier: Apache-2.0
"""What a plan allows to start next: actions run in parallel, or in the order of a list."""

from typing import Dict, Iterable, List, Optional, Set, Tuple

from merlin_ros.work.passed_time import PassedTime
from merlin_rosplan.dispatch.dispatch_schedule import Overtaken, PlanError, PlannedAction
from merlin_rosplan.dispatch.plan_graph import MIN_BOUND, NO_BOUND, EdgeType, Node, NodeType, PlanGraph

_PAST = 1e-6  # s after a latest time at which it has passed


class GraphSchedule:
    """One run of a plan, as the edges of its graph allow; actions run in parallel. Not thread-safe.

    Its times are s of ROS time as it passes: where the clock is set back, what has passed has passed.

    :param graph: ids of nodes and edges are their indices.
    :param actions: by index, as `Node.action` counts.
    :param bounds: whether all time bounds of edges are kept. Without, only the earliest times of starts are:
        before a timed literal the world is not ready, and the plan needs two starts separated.
    :param fraction: by which bounds are widened.
    :raises PlanError: the graph is not one that can be run.
    """

    def __init__(
        self, graph: PlanGraph, actions: List[PlannedAction], bounds: bool = False, fraction: float = 0.0
    ) -> None:
        self.actions = {action.id: action for action in actions}
        for action in actions:
            if self.actions[action.id] is not action:
                raise PlanError(f"two actions of the plan have the id {action.id}")
        self._graph = graph
        self._actions = actions
        self._bounds = bounds
        self._fraction = fraction
        self._start_of, self._end_of = (
            {actions[node.action].id: node for node in graph.nodes if node.type == kind}
            for kind in (NodeType.ACTION_START, NodeType.ACTION_END)
        )
        if set(self._start_of) != set(self.actions) or set(self._end_of) != set(self.actions):
            raise PlanError("the plan graph does not have one start and one end node for each action")
        self._missing = [len(node.edges_in) for node in graph.nodes]  # incoming edges that are not active
        self._clock = PassedTime(0.0)  # of the nodes
        self._time: Dict[int, float] = {}  # of nodes that have happened
        self._started: Set[int] = set()
        self._completed: Set[int] = set()  # actions that ended; their end node may still wait for others
        self._candidates: Set[int] = set()  # nodes with all edges active that have not happened
        # Start nodes of dispatched actions whose effects were not seen, and when those were dispatched.
        self._unseen: Dict[int, float] = {}
        self._unseen_into = [0] * len(graph.nodes)  # edges from those
        self._blocked: Set[int] = set()  # nodes that wait for nothing else
        self._too_late: Set[int] = set()  # edges whose sink happened before their source was dispatched
        self._overtaking: Set[int] = set()  # end nodes of actions that have ended, waiting for others
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
            for node in list(self._time)  # a copy: the drawing thread reads while the dispatch continues
            for edge in self._graph.nodes[node].edges_out
            if self._graph.edges[edge].sink not in self._time
        }

    def happenings(self) -> List[Tuple[int, bool]]:
        """The start (False) and the end (True) of every action, by its id, in the order of the plan."""
        # Times of messages are float32: an end and a start of one moment may differ by some µs.
        timed = [(round(each.time, 3), True, each.id) for each in self.actions.values()]
        timed += [(round(each.time + each.duration, 3), False, each.id) for each in self.actions.values()]
        return [(action_id, not is_start) for _, is_start, action_id in sorted(timed)]

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
        self._clock = PassedTime(now)
        self._candidates.update(node.id for node in self._graph.nodes if not self._missing[node.id])
        for node in self._graph.nodes:
            if node.type == NodeType.PLAN_START:
                self._happen(node.id, now)

    def ready(self, now: float) -> List[PlannedAction]:
        """Actions whose start node has all its edges active and is not too early."""
        now = self._clock.look(now)
        return [
            self._actions[self._graph.nodes[node].action]
            for node in sorted(self._candidates)
            if self._graph.nodes[node].type == NodeType.ACTION_START and self._earliest(node) <= now
        ]

    def started(self, action_id: int, now: float, seen: bool = True) -> None:
        """An action was dispatched; not `seen`: whether its start effects are applied is not known yet."""
        now = self._clock.look(now)
        self._started.add(action_id)
        node = self._start_of[action_id]
        if seen:
            self._happen(node.id, now)
            return
        self._candidates.discard(node.id)
        self._unseen[node.id] = now
        for sink in self._others_after(node):
            self._unseen_into[sink] += 1
            self._block(sink)

    def seen(self, action_id: int, now: float) -> None:
        """The start effects of an action are applied: its start node happens."""
        node = self._start_of[action_id]
        if node.id in self._unseen:
            sent = self._unseen.pop(node.id)
            for sink in self._others_after(node):
                self._unseen_into[sink] -= 1
            self._happen(node.id, self._clock.look(now))
            self._time[node.id] = sent  # it is looked for only when something waits for it

    def awaited(self) -> List[int]:
        """Actions whose start node is all that another start, or the end of an ended action, waits for."""
        awaited = {
            edge.source
            for sink in self._blocked
            if self._graph.nodes[sink].type == NodeType.ACTION_START or sink in self._overtaking
            for edge in self._graph.into(sink)
        }
        # With bounds each is awaited: the time of an end counts from its start.
        nodes = [node for node in self._unseen if self._bounds or node in awaited]
        return sorted(self._actions[self._graph.nodes[node].action].id for node in nodes)

    def ended(self, action_id: int, now: float) -> None:
        """An action has succeeded: its end node happens, once its other edges allow it."""
        self.seen(action_id, now)
        self._completed.add(action_id)
        node = self._end_of[action_id]
        self._overtaking.add(node.id)
        for edge in self._graph.into(node.id):
            source = self._graph.nodes[edge.source]
            if source.action >= 0 and self._actions[source.action].id not in self._started:
                self._too_late.add(edge.id)
        self._happen_if_due(node.id, self._clock.look(now))

    def overtaken(self) -> List[Overtaken]:
        """Actions whose end node waits for the source of a strict edge."""
        found: List[Overtaken] = []
        for node_id in sorted(self._overtaking):
            node = self._graph.nodes[node_id]
            for edge in self._graph.into(node_id):
                if edge.strict and edge.source not in self._time:
                    source = self._graph.nodes[edge.source]
                    verb = "started" if source.type == NodeType.ACTION_START else "ended"
                    first, second = self._actions[source.action], self._actions[node.action]
                    text = (
                        f"{second} has ended before {first} {verb}; the plan needs them the other way round"
                    )
                    found.append(Overtaken(second.id, text, edge.id in self._too_late))
                    break
        return found

    def wake_time(self, now: float) -> Optional[float]:
        """The next time at which a node that waits for nothing else becomes ready or late; None: never."""
        times: List[float] = []
        for node in self._candidates:
            if self._graph.nodes[node].type == NodeType.ACTION_START:
                times.append(self._earliest(node))
            if self._bounds:
                times.append(self._latest(node) + _PAST)
        now = self._clock.at(now)
        wake = min((time for time in times if now < time < NO_BOUND), default=None)
        return None if wake is None else self._clock.clock(wake)

    def waits_for_time(self, action_id: int) -> bool:
        """Whether an edge bounds its start from below."""
        return self._earliest(self._start_of[action_id].id) > 0.0

    def late(self, now: float) -> Optional[str]:
        """The first node whose latest time has passed, one sentence; without bounds nothing is late."""
        if not self._bounds:
            return None
        now = self._clock.look(now)
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
        self._overtaking.discard(node_id)
        self._blocked.discard(node_id)
        for edge_id in self._graph.nodes[node_id].edges_out:
            sink = self._graph.edges[edge_id].sink
            self._missing[sink] -= 1
            self._block(sink)
            if not self._missing[sink] and sink not in self._time:
                self._candidates.add(sink)
                self._happen_if_due(sink, now)

    def _others_after(self, node: Node) -> List[int]:
        """Nodes after a start node, except the end of the same action."""
        sinks = [self._graph.edges[edge].sink for edge in node.edges_out]
        return [sink for sink in sinks if self._graph.nodes[sink].action != node.action]

    def _block(self, node_id: int) -> None:
        blocked = 0 < self._missing[node_id] == self._unseen_into[node_id]
        (self._blocked.add if blocked else self._blocked.discard)(node_id)

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
        for edge in self._graph.into(node_id):
            from_start = self._graph.nodes[edge.source].type == NodeType.PLAN_START
            literal = from_start and edge.type == EdgeType.CONDITION and edge.lower > MIN_BOUND
            separated = not self._bounds and edge.type != EdgeType.START_END and edge.lower > MIN_BOUND
            if literal or separated:  # no tolerance makes the world ready before its time
                earliest = max(earliest, self._time[edge.source] + edge.lower)
            elif self._bounds and edge.lower > MIN_BOUND:
                earliest = max(earliest, self._time[edge.source] + edge.lower * (1.0 - self._fraction))
        return earliest

    def _latest(self, node_id: int) -> float:
        bounds = [edge for edge in self._graph.into(node_id) if edge.upper < NO_BOUND]
        times = [self._time[edge.source] + edge.upper * (1.0 + self._fraction) for edge in bounds]
        return min(times, default=NO_BOUND)

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


class SequentialSchedule(GraphSchedule):
    """One action after the other, in the order of the list; their times do not matter."""

    def __init__(self, actions: Iterable[PlannedAction]) -> None:
        ordered = list(actions)
        graph = PlanGraph([Node(0, NodeType.PLAN_START, "plan_start", -1)])
        for index, action in enumerate(ordered):
            start, end = 2 * index + 1, 2 * index + 2
            graph.nodes.append(Node(start, NodeType.ACTION_START, f"{action.name}_start", index))
            graph.nodes.append(Node(end, NodeType.ACTION_END, f"{action.name}_end", index))
            graph.connect(EdgeType.CONDITION, start - 1, start)
            graph.connect(EdgeType.START_END, start, end)
        super().__init__(graph, ordered)

    def happenings(self) -> List[Tuple[int, bool]]:
        """Each action ends before the next one starts."""
        return [(action_id, at_end) for action_id in self.actions for at_end in (False, True)]
