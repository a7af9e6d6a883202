"""Builds the plan graph: which starts and ends of a plan have to follow which others, and why."""

from typing import Dict, FrozenSet, Iterable, List, Optional, Sequence, Set

from merlin_rosplan.happening import Happening, expression_names, happening_of
from merlin_rosplan.operator_model import Atom, Operator
from merlin_rosplan.plan_graph import EdgeType, Node, NodeType, PlanGraph, TimedLiteral
from merlin_rosplan.plan_text import PlanStep

_DIGITS = 6  # of a time; sums of rounded times must not sort an end behind the start it makes possible


class _Run:
    """Consecutive nodes that all want an atom true (or all want it false), in the order of the plan."""

    __slots__ = ("positive", "nodes", "changes")

    def __init__(self, positive: bool) -> None:
        self.positive = positive
        self.nodes: List[int] = []
        self.changes = False  # whether one of them makes it so


class _Touched:
    """Who has needed or changed one atom so far."""

    __slots__ = ("runs", "last_adder", "last_deleter")

    def __init__(self) -> None:
        self.runs: List[_Run] = []
        self.last_adder: Optional[int] = None
        self.last_deleter: Optional[int] = None

    def note(self, node: int, positive: bool, changes: bool) -> None:
        """A node needs the atom true or false, or makes it so."""
        if not self.runs or self.runs[-1].positive != positive:
            self.runs.append(_Run(positive))
        self.runs[-1].nodes.append(node)
        self.runs[-1].changes |= changes
        if changes and positive:
            self.last_adder = node
        elif changes:
            self.last_deleter = node

    def against(self, positive: bool, reduce: bool) -> List[int]:
        """Earlier nodes that a node making the atom `positive` contradicts.

        Reduced: those behind two changes are left out. Each of them precedes the first change, that one the
        second, and the second the node.
        """
        nodes: List[int] = []
        for index in range(len(self.runs) - 1, -1, -1):
            run = self.runs[index]
            if run.positive == positive:
                continue
            nodes.extend(run.nodes)
            if reduce and run.changes and index > 0 and self.runs[index - 1].changes:
                break
        return nodes


class _Number:
    """Who has changed one function value last, and who has read it since."""

    __slots__ = ("writer", "readers")

    def __init__(self) -> None:
        self.writer: Optional[int] = None
        self.readers: List[int] = []


class _Dependants:
    """Who changed one predicate or function, and who read it in an expression, in alternating batches.

    Members of a batch need no order among themselves, and each batch follows the whole batch before it: two
    batches back follows from that.
    """

    __slots__ = ("changing", "writers", "readers")

    def __init__(self) -> None:
        self.changing = True
        self.writers: List[int] = []
        self.readers: List[int] = []

    def read(self, node: int) -> List[int]:
        """A node reads it; returns whom it follows."""
        if self.changing:
            self.changing, self.readers = False, []
        self.readers.append(node)
        return self.writers

    def write(self, node: int) -> List[int]:
        """A node changes it; returns whom it follows."""
        if not self.changing:
            self.changing, self.writers = True, []
        self.writers.append(node)
        return self.readers


def build_graph(
    steps: Sequence[PlanStep],
    actions: Sequence[Operator],
    timed: Iterable[TimedLiteral] = (),
    epsilon: float = 0.01,
    reduce: bool = False,
) -> PlanGraph:
    """Makes the graph of a plan.

    Parameters
    ----------
    steps: the plan.
    actions: its ground actions, one for each step.
    timed: timed literals, times from the start of the plan.
    epsilon: s by which a condition must be used before a timed literal breaks it.
    reduce: leave out interference edges that follow from others. ROSPlan draws them all, and their number
        grows with the square of the plan's length.
    """
    graph = PlanGraph([Node(0, NodeType.PLAN_START, "plan_start", -1)])
    for index, step in enumerate(steps):
        graph.nodes.append(Node(2 * index + 1, NodeType.ACTION_START, f"{step.name}_start", index))
        graph.nodes.append(Node(2 * index + 2, NodeType.ACTION_END, f"{step.name}_end", index))

    def time_of(node: Node) -> float:
        step = steps[node.action]
        return round(step.time + (step.duration if node.type == NodeType.ACTION_END else 0.0), _DIGITS)

    literals = _index(timed)
    touched: Dict[Atom, _Touched] = {}
    numbers: Dict[Atom, _Number] = {}
    dependants = {name: _Dependants() for name in _read_names(actions)}
    for node in sorted(graph.nodes[1:], key=lambda entry: (time_of(entry), entry.id)):
        action = actions[node.action]
        start = node.id - 1 if node.type == NodeType.ACTION_END else None
        happening = happening_of(action, node.type)
        if start is not None:
            duration = steps[node.action].duration
            graph.connect(EdgeType.START_END, start, node.id, duration, duration)
        supported = _support(graph, node, happening, touched, literals, time_of(node), epsilon)
        supported |= _interference(graph, node, start, happening, touched, reduce)
        supported |= _numeric_order(graph, node, start, happening, numbers)
        supported |= _expression_order(graph, node, start, happening, dependants)
        if not supported:
            graph.connect(EdgeType.CONDITION, 0, node.id)
        _remember(node.id, happening, touched)
    return graph


def _index(timed: Iterable[TimedLiteral]) -> Dict[Atom, List[TimedLiteral]]:
    literals: Dict[Atom, List[TimedLiteral]] = {}
    for literal in sorted(timed, key=lambda entry: entry.time):
        literals.setdefault(literal.atom.key, []).append(literal)
    return literals


def _read_names(actions: Sequence[Operator]) -> FrozenSet[str]:
    return frozenset().union(*(expression_names(a.at_start, a.over_all, a.at_end) for a in actions))


def _support(
    graph: PlanGraph,
    node: Node,
    happening: Happening,
    touched: Dict[Atom, _Touched],
    literals: Dict[Atom, List[TimedLiteral]],
    now: float,
    epsilon: float,
) -> bool:
    """Edges from whatever makes the node's conditions true; whether there is one from an action."""
    supported = False
    for negative, atoms in ((False, happening.positive), (True, happening.negative)):
        for atom in atoms:
            seen = touched.get(atom)
            provider = None
            if seen is not None:
                provider = seen.last_deleter if negative else seen.last_adder
            if provider is not None:
                graph.connect(EdgeType.CONDITION, provider, node.id)
                supported = True
            elif atom in literals:
                given = [entry.time for entry in literals[atom] if entry.negative == negative]
                past = [time for time in given if time <= now + epsilon]
                if past:
                    graph.connect(EdgeType.CONDITION, 0, node.id, lower=past[-1])
                    supported = True
    # Over-all conditions have to last until the end, so a literal that breaks them bounds the end node.
    end = node.type == NodeType.ACTION_END
    positive = list(happening.positive) + list(happening.keep_positive) if end else happening.positive
    negatives = list(happening.negative) + list(happening.keep_negative) if end else happening.negative
    for negative, atoms in ((False, positive), (True, negatives)):
        for atom in atoms:
            breaks = _first_break(literals.get(atom, ()), negative, now)
            if breaks is not None:
                graph.connect(EdgeType.CONDITION, 0, node.id, upper=breaks - epsilon)
                supported = True
    return supported


def _first_break(literals: Iterable[TimedLiteral], negative: bool, after: float) -> Optional[float]:
    for literal in literals:
        if literal.time > after and literal.negative != negative:
            return literal.time
    return None


def _interference(
    graph: PlanGraph,
    node: Node,
    start: Optional[int],
    happening: Happening,
    touched: Dict[Atom, _Touched],
    reduce: bool,
) -> bool:
    """Edges from every earlier node whose condition or effect this node's effects contradict."""
    earlier: Set[int] = set()
    for positive, atoms in ((True, happening.add), (False, happening.delete)):
        for atom in atoms:
            seen = touched.get(atom)
            if seen is not None:
                earlier.update(seen.against(positive, reduce))
    if start is not None:
        earlier.discard(start)
    for source in sorted(earlier):
        graph.connect(EdgeType.INTERFERENCE, source, node.id)
    return bool(earlier)


def _numeric_order(
    graph: PlanGraph, node: Node, start: Optional[int], happening: Happening, numbers: Dict[Atom, _Number]
) -> bool:
    """Edges that keep changes of a number in order, among themselves and with who reads it.

    ROSPlan has none of these: there, actions that use up the same resource start together.
    """
    supported = False
    for term in happening.reads:
        number = numbers.setdefault(term, _Number())
        if number.writer is not None and number.writer != start:
            graph.connect(EdgeType.CONDITION, number.writer, node.id)
            supported = True
    for term in happening.writes:
        number = numbers.setdefault(term, _Number())
        earlier = number.readers + ([number.writer] if number.writer is not None else [])
        for source in earlier:
            if source != start:
                graph.connect(EdgeType.INTERFERENCE, source, node.id)
                supported = True
        number.writer, number.readers = node.id, []
    for term in happening.reads:
        if term not in happening.writes:
            numbers[term].readers.append(node.id)
    return supported


def _expression_order(
    graph: PlanGraph,
    node: Node,
    start: Optional[int],
    happening: Happening,
    dependants: Dict[str, _Dependants],
) -> bool:
    """Edges that keep expressions behind earlier changes of what they read, and before later ones.

    Which change makes a disjunction or a quantified condition true is not looked into: a name counts. ROSPlan
    has none of these edges.
    """
    supported = False
    for names, note, edge_type in (
        (happening.depends, _Dependants.read, EdgeType.CONDITION),
        (happening.changes, _Dependants.write, EdgeType.INTERFERENCE),
    ):
        for name in sorted(names & dependants.keys()):
            for source in note(dependants[name], node.id):
                if source not in (start, node.id):
                    graph.connect(edge_type, source, node.id)
                    supported = True
    return supported


def _remember(node: int, happening: Happening, touched: Dict[Atom, _Touched]) -> None:
    for positive, changes, groups in (
        (True, False, (happening.positive, happening.keep_positive)),
        (False, False, (happening.negative, happening.keep_negative)),
        (False, True, (happening.delete,)),
        (True, True, (happening.add,)),
    ):
        for atoms in groups:
            for atom in atoms:
                record = touched.get(atom)
                if record is None:
                    record = touched[atom] = _Touched()
                record.note(node, positive, changes)
