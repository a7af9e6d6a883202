# SPDX-License-Identifier: Apache-2.0
"""What to wait for so that a plan's ends come in their order, though a dispatcher only controls starts.

An order into an end, "u before the end of B", is kept by waiting at the start of B:

- B waits for u, where nothing of u needs B to have started. Then the order holds whatever anything lasts.
- Where u can only happen while B runs (required concurrency), B is a window: it does not start before
  everything is done that u waits for besides B. From then on the window lasts as long as its content, as
  planned. An action that began earlier and ends inside the window, and a timed literal inside it, are met by
  keeping the start of B as far behind as it was planned.

Where the plan's own durations and deadlines do not allow a wait, the planned separation of the starts is kept
in its place; where that contradicts other waits, all separations are kept as planned and nothing waits for
more.
"""

from typing import Dict, List, Mapping, Optional, Sequence, Set, Tuple

from merlin_rosplan.dispatch.plan_graph import MIN_BOUND, NO_BOUND, EdgeType, Node, NodeType, PlanGraph

_REACTION = 0.5  # s that the steps between an end and the next start may take, at most
_STEP = 0.1  # s that a step takes in a plan whose waits differ from what was planned
_TOLERANCE = 1e-4  # s that a plan's rounded times may be off


def add_waits(
    graph: PlanGraph,
    order: Sequence[Node],
    times: Sequence[float],
    durations: Sequence[float],
    deadlines: Mapping[int, float],
) -> None:
    """Adds the edges to starts that keep the orders into ends; see above.

    :param graph: with all orders that the plan needs; every edge goes forward in `order`.
    :param order: of the plan; without its start.
    :param times: planned, by node id.
    :param durations: planned, by action.
    :param deadlines: by node id, times until which a node has to happen, besides the upper bounds of edges.
    """
    before = graph.snapshot()
    if not _Waits(graph, order, times, durations, deadlines, planned=False).add():
        graph.restore(before)
        _Waits(graph, order, times, durations, deadlines, planned=True).add()


class _Waits:
    def __init__(
        self,
        graph: PlanGraph,
        order: Sequence[Node],
        times: Sequence[float],
        durations: Sequence[float],
        deadlines: Mapping[int, float],
        planned: bool,
    ) -> None:
        self._planned = planned  # keep the plan's separations, and wait for nothing that comes later in it
        self._possible = True
        self._graph = graph
        self._deadlines = deadlines
        self._order = order
        self._times = times
        self._durations = durations
        self._position = {node.id: index for index, node in enumerate(order)}
        self._before = [0] * len(graph.nodes)  # ancestors of each node, as bits
        self._settled: Set[Tuple[int, int]] = set()  # (start, node): the plan's own separation is kept
        self._network: Optional[_Network] = None

    def add(self) -> bool:
        """Adds the edges; False: the plan's times do not allow for some that are needed."""
        self._await_timed_ends()
        sources: Dict[int, List[int]] = {}  # by start node: what must precede its end
        for node in self._order:
            if node.type == NodeType.ACTION_END:
                for edge in self._graph.into(node.id):
                    if edge.source not in (0, node.id - 1):
                        sources.setdefault(node.id - 1, []).append(edge.source)
        for node in self._order:
            self._gather(node)
            earlier = [u for u in sources.get(node.id, ()) if self._position[u] < self._position[node.id]]
            for u in sorted(earlier, key=self._position.__getitem__, reverse=True):
                if not self._before[node.id] >> u & 1:
                    self._graph.connect(EdgeType.INTERFERENCE, u, node.id)
                    self._before[node.id] |= self._before[u] | 1 << u
        inside = [
            (start, u)
            for start, found in sources.items()
            for u in found
            if self._position[u] > self._position[start]
        ]
        changed = bool(inside)
        while changed:  # each turn adds an edge to a finite order
            changed = False
            for start, u in inside:
                changed |= self._keep(start, u)
        return self._possible

    def _await_timed_ends(self) -> None:
        """An action whose end waits for a time does not start earlier than planned."""
        for node in self._order:
            start = node.id - 1
            is_later = node.type == NodeType.ACTION_END and self._times[start] > MIN_BOUND
            if is_later and self._awaits_time(node.id):
                self._graph.connect(EdgeType.CONDITION, 0, start, self._times[start])

    def _gather(self, node: Node) -> None:
        found = 0
        for edge in self._graph.into(node.id):
            found |= self._before[edge.source] | 1 << edge.source
        self._before[node.id] = found

    def _keep(self, start: int, u: int) -> bool:
        """Keeps u before the end of the action of a start node; whether that changed the graph."""
        if self._before[start] >> u & 1:
            return False
        if not self._before[u] >> start & 1:
            return (start, u) not in self._settled and self._wait(start, u)
        return self._keep_window(start, u)

    def _wait(self, start: int, u: int) -> bool:
        later = self._position[u] > self._position[start]
        if not (self._planned and later) and self._connect(u, start, 0.0):
            return True
        self._settled.add((start, u))
        begin = u - 1 if self._graph.nodes[u].type == NodeType.ACTION_END else u
        first, second = sorted((start, begin), key=self._position.__getitem__)
        added = self._connect(first, second, max(0.0, self._times[second] - self._times[first]))
        self._possible &= added
        return added

    def _keep_window(self, start: int, u: int) -> bool:
        changed = False
        while True:
            inner = self._after(start)
            outer = self._before[u] & ~(self._before[start] | inner | 1 << start | 1)
            open_ = [w for w in _bits(outer) if (start, w) not in self._settled]
            if not open_:
                break
            # what was planned before the window first: its order with the window is the plan's
            here = self._position[start]
            last = max(open_, key=lambda w: (self._position[w] < here, self._position[w]))
            changed |= self._wait(start, last)
        within = inner & (self._before[u] | 1 << u)
        return self._separate(start, u, within) | self._await_time(start, within) | changed

    def _separate(self, start: int, u: int, within: int) -> bool:
        """Keeps the distance to actions that began before the window and end in it."""
        changed = False
        for end in _bits(within):
            begin = end - 1
            node = self._graph.nodes[end]
            if node.type != NodeType.ACTION_END or begin == start or not self._before[start] >> begin & 1:
                continue
            if (start, end) in self._settled:
                continue
            self._settled.add((start, end))
            rest = self._durations[node.action] + self._distance(end, u)
            if rest > self._durations[self._graph.nodes[start].action] - _REACTION:
                added = self._connect(begin, start, self._times[start] - self._times[begin])
                self._possible &= added
                changed |= added
        return changed

    def _await_time(self, start: int, within: int) -> bool:
        """Keeps the planned time of a window in which something waits for a time."""
        kept = (start, 0) in self._settled or self._times[start] <= MIN_BOUND
        if kept or not any(map(self._awaits_time, _bits(within))):
            return False
        self._settled.add((start, 0))
        return self._connect(0, start, self._times[start], EdgeType.CONDITION)

    def _awaits_time(self, node: int) -> bool:
        """Whether a node does not come before some time of the plan."""
        return any(edge.source == 0 and edge.lower > MIN_BOUND for edge in self._graph.into(node))

    def _connect(self, source: int, sink: int, lower: float, type_: EdgeType = EdgeType.INTERFERENCE) -> bool:
        if source == sink or self._before[source] >> sink & 1:
            return False  # it would be a cycle
        if self._network is None:
            self._network = _Network(self._graph, self._times, self._deadlines)
        if not self._network.add(source, sink, lower):
            return False
        self._graph.connect(type_, source, sink, lower)
        found = self._before[source] | 1 << source
        for node in [sink, *_bits(self._after(sink))]:
            self._before[node] |= found
        return True

    def _after(self, node: int) -> int:
        """Descendants of a node, as bits."""
        return sum(1 << other for other, before in enumerate(self._before) if before >> node & 1)

    def _distance(self, source: int, target: int) -> float:
        """The longest way between two nodes with planned durations, s."""
        ways = {source: 0.0}
        between = [n for n in _bits(self._before[target] | 1 << target) if self._before[n] >> source & 1]
        for node in sorted(between, key=lambda n: bin(self._before[n]).count("1")):
            for edge in self._graph.into(node):
                if edge.source in ways:
                    lasts = _least(edge.lower)
                    if edge.type == EdgeType.START_END:
                        lasts = self._durations[self._graph.nodes[node].action]
                    ways[node] = max(ways.get(node, 0.0), ways[edge.source] + lasts)
        return ways.get(target, 0.0)


class _Network:
    """The simple temporal network of a plan with its planned durations, and one solution of it.

    Starts with the plan itself as the solution. Every further edge moves it as far as needed; one that
    leaves no solution is refused.
    """

    def __init__(self, graph: PlanGraph, times: Sequence[float], deadlines: Mapping[int, float]) -> None:
        self._time = list(times)
        self._out: List[List[Tuple[int, float]]] = [[] for _ in graph.nodes]
        for node, latest in deadlines.items():
            self._out[node].append((0, -latest))
        for edge in graph.edges:
            if edge.type == EdgeType.START_END:
                lasts = times[edge.sink] - times[edge.source]  # none for a plain action
                self._out[edge.source].append((edge.sink, lasts))
                self._out[edge.sink].append((edge.source, -lasts))
                continue
            room = min(_STEP, times[edge.sink] - times[edge.source])  # the plan may be tighter than that
            self._out[edge.source].append((edge.sink, max(room, _least(edge.lower))))
            if edge.upper < NO_BOUND:
                self._out[edge.sink].append((edge.source, -edge.upper))

    def add(self, source: int, sink: int, lower: float) -> bool:
        """Adds "sink at least `lower` s after source"; False: it contradicts the others."""
        lower = lower or _STEP
        moved: Dict[int, float] = {}
        waiting = [(sink, self._time[source] + lower)]
        while waiting:
            node, earliest = waiting.pop()
            if earliest <= self._time[node] + _TOLERANCE:
                continue
            if node in (source, 0):
                for other, time in moved.items():
                    self._time[other] = time
                return False
            moved.setdefault(node, self._time[node])
            self._time[node] = earliest
            waiting.extend((after, earliest + least) for after, least in self._out[node])
        self._out[source].append((sink, lower))
        return True


def _least(lower: float) -> float:
    return lower if lower > MIN_BOUND else 0.0


def _bits(mask: int) -> List[int]:
    return [index for index, digit in enumerate(reversed(bin(mask)[2:])) if digit == "1"]
