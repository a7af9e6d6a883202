# SPDX-License-Identifier: Apache-2.0
"""Builds the plan graph: which starts and ends of a plan have to follow which others, and why."""

from typing import Collection, Dict, Iterable, List, Mapping, Optional, Sequence, Set, Tuple, Union

from merlin_pddl.plan_text import PlanStep
from merlin_rosplan.dispatch.happening import Happening, happening_of, names_by_argument, rosplan_happening
from merlin_rosplan.dispatch.operator_model import ActionModel, Conditions, PlanTerm, TimedEffects
from merlin_rosplan.dispatch.plan_graph import EdgeType, Node, NodeType, PlanGraph, TimedLiteral, TimedValue
from merlin_rosplan.dispatch.plan_graph_history import Constrained, Named, NumberHistory, Touched
from merlin_rosplan.dispatch.plan_graph_order import plan_order
from merlin_rosplan.dispatch.plan_graph_waits import add_waits
from merlin_rosplan.dispatch.timed_numbers import TimedNumbers

_DIGITS = 6  # of a time; sums of rounded times must not sort an end behind the start it makes possible

Timed = Union[TimedLiteral, TimedValue]


def build_graph(
    steps: Sequence[PlanStep],
    actions: Sequence[ActionModel],
    timed: Iterable[Timed] = (),
    epsilon: float = 0.01,
    reduce: bool = False,
    values: Optional[Mapping[PlanTerm, float]] = None,
    as_rosplan: bool = False,
) -> PlanGraph:
    """Makes the graph of a plan.

    :param steps: the plan.
    :param actions: its ground actions, one for each step.
    :param timed: timed literals and function values, times from the start of the plan.
    :param epsilon: s by which a condition must be used before a timed literal breaks it.
    :param reduce: leave out interference edges that follow from others. ROSPlan draws them all, and their
        number grows with the square of the plan's length.
    :param values: what function terms are worth now, for conditions on timed values; terms as `PlanTerm.key`.
    :param as_rosplan: the edges that ROSPlan's own parser makes, and no more.
    """
    builder = _RosplanBuilder if as_rosplan else _Builder
    return builder(steps, actions, list(timed), epsilon, reduce, values or {}).build()


class _Builder:
    _happening = staticmethod(happening_of)

    def __init__(
        self,
        steps: Sequence[PlanStep],
        actions: Sequence[ActionModel],
        timed: List[Timed],
        epsilon: float,
        reduce: bool,
        values: Mapping[PlanTerm, float],
    ) -> None:
        self._steps = steps
        self._actions = actions
        self._epsilon = epsilon
        self._reduce = reduce
        self._graph = graph = PlanGraph([Node(0, NodeType.PLAN_START, "plan_start", -1)])
        self._times = [0.0]
        self._happenings = [Happening()]
        for index, (step, action) in enumerate(zip(steps, actions)):
            graph.nodes.append(Node(2 * index + 1, NodeType.ACTION_START, f"{step.name}_start", index))
            graph.nodes.append(Node(2 * index + 2, NodeType.ACTION_END, f"{step.name}_end", index))
            end = step.time + self._lasts(step, action)
            self._times += [round(step.time, _DIGITS), round(end, _DIGITS)]
            self._happenings.append(self._happening(action, NodeType.ACTION_START))
            self._happenings.append(self._happening(action, NodeType.ACTION_END))
        self._literals: Dict[PlanTerm, List[TimedLiteral]] = {}
        self._values_in_time: Dict[PlanTerm, List[float]] = {}
        for entry in sorted(timed, key=lambda entry: entry.time):
            if isinstance(entry, TimedLiteral):
                self._literals.setdefault(entry.atom.key, []).append(entry)
            else:
                self._values_in_time.setdefault(entry.term.key, []).append(entry.time)
        self._numbers_in_time = TimedNumbers(timed, values, epsilon)
        self._touched: Dict[PlanTerm, Touched] = {}
        self._numbers: Dict[PlanTerm, NumberHistory] = {}
        self._unchecked_numbers: Dict[PlanTerm, NumberHistory] = {}
        wanted: Set[str] = set()
        for happening in self._happenings:
            wanted |= happening.depends | happening.wild
        self._named = {name: Named() for name in wanted}
        self._unchecked_named = {name: Named() for name in wanted}
        constraints = dict.fromkeys(reads for action in actions for reads in action.constraints)
        self._constrained = list(map(Constrained, constraints))

    def _lasts(self, step: PlanStep, action: ActionModel) -> float:
        """In the plan a plain action is one happening, whatever its line says."""
        return step.duration if action.durative else 0.0

    def build(self) -> PlanGraph:
        """The graph."""
        order = plan_order(self._graph.nodes, self._times, self._happenings)
        for node in order:
            self._add(node)
        durations = [step.duration for step in self._steps]
        add_waits(self._graph, order, self._times, durations, self._deadlines(order))
        return self._graph

    def _deadlines(self, order: Iterable[Node]) -> Dict[int, float]:
        """Until when nodes have to come whose effects or numbers a later timed change overwrites."""
        deadlines: Dict[int, float] = {}
        for node in order if self._literals or self._values_in_time else ():
            happening = self._happenings[node.id]
            now = self._times[node.id]
            later = [
                _first_break(self._literals.get(atom, ()), negative, now)
                for negative, atoms in ((False, happening.add), (True, happening.delete))
                for atom in atoms
            ]
            for term in (*happening.writes, *happening.reads):
                later += [time for time in self._values_in_time.get(term, ()) if time > now][:1]
            deadlines.update({node.id: min(time for time in later if time is not None)} if any(later) else {})
        return deadlines

    def _add(self, node: Node) -> None:
        happening = self._happenings[node.id]
        start = node.id - 1 if node.type == NodeType.ACTION_END else None
        if start is not None:
            duration = self._steps[node.action].duration
            self._graph.connect(EdgeType.START_END, start, node.id, duration, duration)
        self._order(node, start, happening)
        if all(edge.source == start for edge in self._graph.into(node.id)):
            self._graph.connect(EdgeType.CONDITION, 0, node.id)
        self._remember(node.id, happening)

    def _order(self, node: Node, start: Optional[int], happening: Happening) -> None:
        """Makes the edges into a node, besides that from the start of its action."""
        self._support(node, start, happening)
        self._timed_numbers(node)
        self._timed_order(node, happening)
        self._interference(node, start, happening)
        self._numeric_order(node, start, happening)
        self._name_order(node, start, happening)
        self._constraint_order(node, start, happening)

    def _support(self, node: Node, start: Optional[int], happening: Happening) -> None:
        """Edges from whatever makes the node's conditions true."""
        now = self._times[node.id]
        for negative, atoms in ((False, happening.positive), (True, happening.negative)):
            for atom in atoms:
                seen = self._touched.get(atom)
                provider = None
                if seen is not None:
                    provider = seen.last_deleter if negative else seen.last_adder
                if provider is not None and provider != start:
                    self._graph.connect(EdgeType.CONDITION, provider, node.id, strict=start is not None)
                since = self._times[provider] if provider is not None else -self._epsilon
                given = [
                    entry.time
                    for entry in self._literals.get(atom, ())
                    if entry.negative == negative and since < entry.time <= now + self._epsilon
                ]
                if given:
                    self._graph.connect(EdgeType.CONDITION, 0, node.id, lower=given[-1])
        positive, negated = self._lasting(node, happening)
        for negative, atoms in ((False, positive), (True, negated)):
            for atom in atoms:
                breaks = _first_break(self._literals.get(atom, ()), negative, now)
                if breaks is not None:
                    self._graph.connect(EdgeType.CONDITION, 0, node.id, upper=breaks - self._epsilon)

    def _lasting(self, _: Node, happening: Happening) -> Tuple[Sequence[PlanTerm], Sequence[PlanTerm]]:
        """What must not be broken before the node: over-all conditions have to last until the end."""
        return (
            [*happening.positive, *happening.keep_positive],
            [*happening.negative, *happening.keep_negative],
        )

    def _timed_numbers(self, node: Node) -> None:
        """An edge from the start of the plan when the node's conditions wait for a timed value."""
        if not self._numbers_in_time:
            return
        action = self._actions[node.action]
        conditions = action.at_start + action.over_all
        if node.type == NodeType.ACTION_END:
            conditions = action.at_end
        changed = {
            term: self._times[number.writer]
            for term, number in self._numbers.items()
            if number.writer is not None
        }
        lower = self._numbers_in_time.since(conditions, self._times[node.id], changed)
        if lower is not None:
            self._graph.connect(EdgeType.CONDITION, 0, node.id, lower=lower)

    def _timed_order(self, node: Node, happening: Happening) -> None:
        """An edge from the start of the plan when the node's effects would be undone, or read too early.

        That is so before a timed change to the opposite, or of a number, that precedes the node in the plan.
        """
        action = self._actions[node.action]
        if not (self._literals or self._values_in_time) or (
            node.type == NodeType.ACTION_START and not action.durative
        ):
            return
        ends = action.durative and node.type == NodeType.ACTION_END
        effects = action.end_effects if ends else action.start_effects
        changes = [
            literal.time
            for negative, atoms in ((True, happening.add), (False, happening.delete))
            for atom in atoms
            for literal in self._literals.get(atom, ())
            if literal.negative == negative
        ]
        for term in (*happening.writes, *(term.key for term in effects.reads)):
            changes += self._values_in_time.get(term, ())
        earlier = [time for time in changes if 0.0 < time <= self._times[node.id]]
        if earlier:
            self._graph.connect(EdgeType.CONDITION, 0, node.id, lower=max(earlier))

    def _interference(self, node: Node, start: Optional[int], happening: Happening) -> None:
        """Edges from every earlier node whose condition or effect this node's effects contradict."""
        for positive, atoms in ((True, happening.add), (False, happening.delete)):
            for atom in atoms:
                seen = self._touched.get(atom)
                if seen is not None:
                    earlier = seen.against(positive, self._reduce)
                    self._follow(EdgeType.INTERFERENCE, earlier, node, start, seen.unchecked)

    def _numeric_order(self, node: Node, start: Optional[int], happening: Happening) -> None:
        """Edges that keep changes of a number in order with each other and with its readers.

        ROSPlan has none of these: there, actions that use up the same resource start together.
        """
        writes, additive = set(happening.writes), set(happening.additive)
        for numbers, reads in (
            (self._unchecked_numbers, happening.unchecked & set(happening.reads)),
            (self._numbers, set(happening.reads)),
        ):
            for term in dict.fromkeys((*happening.reads, *happening.writes)):
                if term not in reads and term not in writes:
                    continue
                number = numbers.setdefault(term, NumberHistory())
                earlier = number.touch(node.id, term in reads, term in writes, term in additive)
                type_ = EdgeType.INTERFERENCE if term in writes else EdgeType.CONDITION
                strict = earlier if numbers is self._unchecked_numbers else ()
                self._follow(type_, earlier, node, start, strict)

    def _name_order(self, node: Node, start: Optional[int], happening: Happening) -> None:
        """Edges that keep what is known by name only behind earlier changes, and before later ones.

        Which change makes a disjunction or a quantified condition true is not looked into, nor what a
        conditional effect does: a name counts. ROSPlan has none of these edges.
        """
        if not self._named:
            return
        unchecked = frozenset(atom.name for atom in happening.unchecked)
        for named, atoms, depends in (
            (self._unchecked_named, unchecked, happening.unchecked_names),
            (self._named, names_by_argument(happening), happening.depends),
        ):
            for names, note, type_ in (
                (atoms, Named.read_atom, EdgeType.CONDITION),
                (depends, Named.read, EdgeType.CONDITION),
                (happening.changes - happening.wild, Named.change_atom, EdgeType.INTERFERENCE),
                (happening.wild, Named.change, EdgeType.INTERFERENCE),
            ):
                for name in sorted(names & named.keys()):
                    earlier = note(named[name], node.id)
                    strict = earlier if named is self._unchecked_named else ()
                    self._follow(type_, earlier, node, start, strict)

    def _constraint_order(self, node: Node, start: Optional[int], happening: Happening) -> None:
        """Edges that keep changes of what one trajectory constraint reads in the plan's order.

        Nothing looks at a constraint when the plan is carried out. ROSPlan has none of these edges.
        """
        changed = (tuple(happening.add), tuple(happening.delete), tuple(happening.writes))
        effects = TimedEffects(*changed, wild=happening.wild)
        for constraint in self._constrained:
            earlier = constraint.change(node.id, effects)
            self._follow(EdgeType.INTERFERENCE, earlier, node, start, earlier)

    def _follow(
        self,
        type_: EdgeType,
        earlier: Iterable[int],
        node: Node,
        start: Optional[int],
        strict: Collection[int] = (),
    ) -> None:
        """Edges from earlier nodes; strict ones from those in `strict`, if the node is an end."""
        for source in sorted(set(earlier) - {start, node.id}):
            self._graph.connect(type_, source, node.id, strict=start is not None and source in strict)

    def _remember(self, node: int, happening: Happening) -> None:
        for positive, changes, atoms in (
            (True, False, happening.positive),
            (True, False, happening.keep_positive),
            (False, False, happening.negative),
            (False, False, happening.keep_negative),
            (False, True, happening.delete),
            (True, True, happening.add),
        ):
            for atom in atoms:
                touched = self._touched.setdefault(atom, Touched())
                touched.note(node, positive, changes)
                if atom in happening.unchecked:
                    touched.unchecked.add(node)


class _RosplanBuilder(_Builder):
    """ROSPlan's own graph: by time alone, and only with the orders that facts demand."""

    _happening = staticmethod(rosplan_happening)

    def build(self) -> PlanGraph:
        """The graph."""
        for node in sorted(self._graph.nodes[1:], key=lambda node: (self._times[node.id], node.id)):
            self._add(node)
        for edge in self._graph.edges:
            edge.strict = False  # ROSPlan has no such mark
        return self._graph

    def _lasts(self, step: PlanStep, action: ActionModel) -> float:
        return step.duration

    def _order(self, node: Node, start: Optional[int], happening: Happening) -> None:
        self._support(node, start, happening)
        self._interference(node, start, happening)

    def _lasting(self, node: Node, happening: Happening) -> Tuple[Sequence[PlanTerm], Sequence[PlanTerm]]:
        action = self._actions[node.action]
        lasting: Conditions = action.at_start
        if node.type == NodeType.ACTION_END:
            lasting = action.over_all + action.at_end
        return [atom.key for atom in lasting.positive], [atom.key for atom in lasting.negative]


def _first_break(literals: Iterable[TimedLiteral], negative: bool, after: float) -> Optional[float]:
    return next((each.time for each in literals if each.time > after and each.negative != negative), None)
