# SPDX-License-Identifier: Apache-2.0
"""A plan carried out on paper, whole or without some steps: which conditions and goals fail then."""

import copy
from dataclasses import replace
from typing import AbstractSet, Dict, List, Mapping, NamedTuple, Optional, Sequence, Set, Tuple, Union

from merlin_pddl.domain import Domain, Operator
from merlin_pddl.evaluation import Evaluator, WorldState, changed, key_of, result_of
from merlin_pddl.formula import (
    END,
    OVER_ALL,
    START,
    Comparison,
    Condition,
    Effect,
    Formula,
    Special,
    ground,
    must_hold,
    terms,
    to_pddl,
)
from merlin_pddl.knowledge import ASSIGN, DECREASE, INCREASE, Fact, FunctionValue, Instance, Key
from merlin_pddl.plan_text import PlanStep, call_text
from merlin_pddl.problem import Problem

GOAL = -1  #: Stands for the goals where the number of a step is expected.
TIME = -2  #: Likewise for what comes by itself.
#: s by which the duration of a step may differ from what its action says: planners round.
TOLERANCE = 0.01
_DIGITS = 6  # of a time: what differs by less happens together


class PlanRunError(ValueError):
    """A step that is not an action of the domain; the text names it."""


class Unmet(NamedTuple):
    """A condition that does not hold when it has to.

    :ivar step: number of the step in the list, from 0; :data:`GOAL`: it is a goal.
    :ivar when: ``start``, ``over all``, ``end``; empty for a goal.
    :ivar condition: ground; a comparison with ``?duration`` where the duration is wrong, and of a number with
        itself where an effect has none.
    """

    step: int
    when: str
    condition: Condition


class PaperState(WorldState):
    """What holds at a moment of a plan. A copy of the problem's state, which changes."""

    def __init__(self, domain: Domain, problem: Problem) -> None:
        self.facts: Set[Key] = {fact.key for fact in problem.facts if not fact.negative}
        self.values: Dict[Key, float] = {value.key: value.value for value in problem.values}
        self._domain = domain
        self.known = problem.typed(domain.constants)
        """Objects and constants with their types."""

    def copy(self) -> "PaperState":
        """A state of its own."""
        other = copy.copy(self)
        other.facts, other.values = set(self.facts), dict(self.values)
        return other

    def holds(self, key: Key) -> bool:
        """Whether that fact is stored."""
        return key in self.facts

    def value(self, key: Key) -> Optional[float]:
        """The value of that function, None when it has none."""
        return self.values.get(key)

    def objects(self, types: Tuple[str, ...]) -> List[str]:
        """The objects of any of these types or of types below them."""
        return [name for name, has in self.known.items() if self._domain.accepts(types, has)]


class Outcome(NamedTuple):
    """How a plan ends on paper.

    :ivar unmet: in the order of the plan, goals last.
    :ivar state: at its end.
    :ivar reached: goals that held at the start or after a happening, each with the first time, s.
    :ivar clashes: two numbers of steps (the first may be :data:`TIME`), and a ground predicate or function
        that one of them changes at the moment at which the other needs or changes it.
    """

    unmet: List[Unmet]
    state: PaperState
    reached: Dict[Condition, float]
    clashes: List[Tuple[int, int, Key]]


class _Step(NamedTuple):
    """A ground step; times in s from the start of the plan."""

    number: int
    operator: Operator
    bindings: Dict[str, str]
    begin: float
    end: float
    needs: Dict[str, List[Condition]]

    def specials(self, passed: float) -> Dict[str, float]:
        """What ``?duration`` and ``#t`` stand for.

        :param passed: s.
        """
        return {"?duration": self.end - self.begin, "#t": passed}


class PlanRun:
    """Carries out one plan for one problem, as often as asked.

    Happenings of one time see the state before all of them. Numbers that change with time are followed at
    the happenings, so their rates have to stay the same in between.

    :param domain: with its operators.
    :param steps: the plan.
    :raises PlanRunError: a step is not an action of the domain.
    """

    def __init__(self, domain: Domain, problem: Problem, steps: Sequence[PlanStep]) -> None:
        self.domain = domain
        self.problem = problem
        self.goals: List[Condition] = [part for goal in problem.goals for part in must_hold(goal)]
        self.happenings: Dict[float, List[Tuple[_Step, bool]]] = {}
        """By time: steps, each with whether it ends then."""
        self.timed: Dict[float, List[Union[Instance, Fact, FunctionValue]]] = {}
        """What comes by itself, by time; the goals are judged behind the last of it."""
        self.start = PaperState(domain, problem)
        """What holds before the plan."""
        for step in (_ground(number, step, domain, self.start.known) for number, step in enumerate(steps)):
            self.happenings.setdefault(step.begin, []).append((step, False))
            if step.operator.durative:
                self.happenings.setdefault(step.end, []).append((step, True))
        for timed in problem.timed:
            at = round(timed.at / 1e9, _DIGITS)
            self.timed.setdefault(at, []).append(timed.item)
            self.happenings.setdefault(at, [])

    def run(self, left_out: AbstractSet[int] = frozenset(), falling: bool = False) -> Outcome:
        """Carries it out.

        :param left_out: numbers of steps that are left out.
        :param falling: a step that fails is left out, too, the first one first, until none fails; without it
            all others are carried out, whatever fails.
        """
        while True:
            paper = _Paper(self, left_out, falling)
            outcome = paper.run()
            failed = [each.step for each in outcome.unmet if each.step != GOAL] if falling else []
            if not failed:
                return outcome
            # It had begun, so what came after that counts no more.
            left_out = {*left_out, failed[0]}


def plan_fault(domain: Domain, problem: Problem, steps: Sequence[PlanStep], rounding: float = 0.0) -> str:
    """What is wrong with a plan, as a sentence; empty: nothing.

    Trajectory constraints, preferences, processes and events are left out of account.

    :param rounding: s by which an end may come too late, where a planner prints few decimals.
    """
    ends = [step.duration - rounding if step.duration > rounding else step.duration for step in steps]
    steps = [replace(step, duration=end) for step, end in zip(steps, ends)]
    try:
        outcome = PlanRun(domain, problem, steps).run()
    except PlanRunError as error:
        return str(error)
    for each in outcome.unmet:
        needs, what = "" if each.step == GOAL else f", which {steps[each.step]} needs", each.condition
        if isinstance(what, Comparison) and what == Comparison("=", what.left, what.left):
            return f"{to_pddl(what.left)} has no value{needs}"
        return f"{to_pddl(what)} does not hold{needs}"
    for one, other, key in sorted(outcome.clashes):
        first = "what is timed" if one == TIME else steps[one]
        both = f"{first} and {steps[other]} changes {call_text(key[0], key[1:])}"
        return f"one of {both} at the moment at which the other needs or changes it"
    return ""


class _Changes:
    """What one step, or time, changes at a moment, and what that depends on."""

    def __init__(self) -> None:
        self.deleted: Set[Key] = set()
        self.added: Set[Key] = set()
        self.numbers: List[Tuple[Key, str, Optional[float]]] = []
        self._touched: Set[Tuple[Key, str]] = set()

    def need(self, formulas: Sequence[Formula], bindings: Mapping[str, str]) -> None:
        """Takes what conditions and values depend on."""
        self._touched.update((key_of(term, bindings), "need") for each in formulas for term in terms(each))

    def note(self, effect: Effect, evaluator: Evaluator, bindings: Mapping[str, str]) -> None:
        """Takes an effect in the state before."""
        target = effect.atom or effect.fluent
        assert target is not None
        key, how = key_of(target, bindings), "delete" if effect.negative else "add"
        if effect.atom is not None:
            (self.deleted if effect.negative else self.added).add(key)
        elif effect.value is not None:
            self.numbers.append((key, effect.op, evaluator.number(effect.value, bindings)))
            how = INCREASE if effect.op == DECREASE else effect.op
            self.need([effect.value], bindings)
        self._touched.add((key, how))

    def come(self, item: Union[Instance, Fact, FunctionValue]) -> None:
        """Takes what comes by itself; of two that contradict each other the last one counts."""
        if isinstance(item, Fact):
            (self.added if item.negative else self.deleted).discard(item.key)
            (self.deleted if item.negative else self.added).add(item.key)
            self._touched.add((item.key, "delete" if item.negative else "add"))
        elif isinstance(item, FunctionValue):
            self.numbers.append((item.key, ASSIGN, item.value))
            self._touched.add((item.key, ASSIGN))

    def clash(self, other: "_Changes") -> Set[Key]:
        """What one changes and the other needs at the same moment, or changes in another way."""
        return {
            key
            for key, how in self._touched
            for another, way in other._touched
            if key == another and not how == way in ("need", "add", "delete", INCREASE)
        }


def _apply(parts: Sequence[_Changes], state: PaperState) -> None:
    """What is deleted and added at a moment is added."""
    for part in parts:
        state.facts -= part.deleted
    for part in parts:
        state.facts |= part.added
        for key, op, number in part.numbers:
            value = changed(op, state.values.get(key), number)
            if value is not None:
                state.values[key] = value


class _Paper:
    """One run of a plan."""

    def __init__(self, plan: PlanRun, left_out: AbstractSet[int], falling: bool) -> None:
        self._plan = plan
        self._left_out = set(left_out)
        self._falling = falling
        self.state = plan.start.copy()
        self._running: Dict[int, _Step] = {}
        self._allowed: Dict[Tuple[int, int], List[Dict[str, str]]] = {}
        self._unmet: Dict[Unmet, None] = {}
        self._reached: Dict[Condition, float] = {}
        self._clashes: List[Tuple[int, int, Key]] = []

    def run(self) -> Outcome:
        """Carries it out."""
        now = 0.0
        self._look_at_goals(now)
        for at in sorted(self._plan.happenings):
            self._pass(at - now)
            now = at
            self._happen(at)
            self._look_at_goals(at)
        evaluator = self._evaluator({})
        for goal in self._plan.goals:
            if not evaluator.holds(goal):
                self._unmet[Unmet(GOAL, "", goal)] = None
        return Outcome(list(self._unmet), self.state, self._reached, self._clashes)

    def _evaluator(self, specials: Mapping[str, float]) -> Evaluator:
        return Evaluator(self._plan.domain, self.state, specials)

    def _look_at_goals(self, at: float) -> None:
        evaluator = self._evaluator({})
        for goal in self._plan.goals:
            if goal not in self._reached and evaluator.holds(goal):
                self._reached[goal] = at

    def _pass(self, seconds: float) -> None:
        """What changes with time does so, and what has to hold meanwhile is looked at."""
        changes, running = _Changes(), self._running.values()
        changing = [step for step in running if any(e.when == OVER_ALL for e in step.operator.effects)]
        for step in changing:
            self._collect(changes, step, OVER_ALL, self._evaluator(step.specials(seconds)))
        if changing:
            _apply([changes], self.state)
            self._look_over_all()

    def _look_over_all(self) -> None:
        for step in self._running.values():
            self._need(step, OVER_ALL, self._evaluator(step.specials(0.0)))

    def _happen(self, at: float) -> None:
        parts: List[Tuple[int, _Changes]] = [(TIME, _Changes())]
        for item in self._plan.timed.get(at, ()):
            parts[0][1].come(item)
        begun: List[_Step] = []
        for step, at_end in self._plan.happenings[at]:
            if step.number in self._left_out or (at_end and step.number not in self._running):
                continue
            specials = step.specials(step.end - step.begin if at_end else 0.0)
            evaluator = self._evaluator(specials)
            when = END if at_end else START
            fine = self._need(step, when, evaluator)
            if not at_end:
                fine &= self._lasts(step, evaluator)
                if not fine and self._falling:
                    self._leave_out(step.number)
                    continue
                self._allow(step, evaluator)
                begun += [step] if step.operator.durative else []
            changes = _Changes()
            changes.need(step.needs.get(when, ()), {})
            self._collect(changes, step, when, evaluator)
            for other, before in parts:
                if other != step.number:
                    self._clashes += [(other, step.number, key) for key in changes.clash(before)]
            parts.append((step.number, changes))
        for step, at_end in self._plan.happenings[at]:
            if at_end:
                self._running.pop(step.number, None)
        _apply([changes for _, changes in parts], self.state)
        self._running.update({step.number: step for step in begun})
        self._look_over_all()

    def _need(self, step: _Step, when: str, evaluator: Evaluator) -> bool:
        """Notes what does not hold; whether all does."""
        failed = [part for part in step.needs.get(when, ()) if not evaluator.holds(part)]
        self._unmet.update({Unmet(step.number, when, part): None for part in failed})
        return not failed

    def _leave_out(self, number: int) -> None:
        self._left_out.add(number)
        self._unmet = {each: None for each in self._unmet if each.step != number}

    def _lasts(self, step: _Step, evaluator: Evaluator) -> bool:
        """Whether the step takes as long as its action says, judged at its start."""
        fine = True
        for duration in step.operator.durations:
            wanted = evaluator.number(duration.value, step.bindings)
            off = None if wanted is None else step.end - step.begin - wanted
            short, long = duration.op != "<=", duration.op != ">="  # what is wrong
            if off is None or (short and off < -TOLERANCE) or (long and off > TOLERANCE):
                needed = Comparison(duration.op, Special("?duration"), ground(duration.value, step.bindings))
                self._unmet[Unmet(step.number, START, needed)] = None
                fine = False
        return fine

    def _allow(self, step: _Step, evaluator: Evaluator) -> None:
        """For later effects that depend on the start: what their variables may stand for."""
        for number, effect in enumerate(step.operator.effects):
            begin = [timed.condition for timed in effect.conditions if timed.when == START]
            if effect.when != START and begin:
                self._allowed[step.number, number] = [
                    bindings
                    for bindings in evaluator.extend(effect.variables, step.bindings)
                    if all(evaluator.holds(condition, bindings) for condition in begin)
                ]

    def _collect(self, changes: _Changes, step: _Step, when: str, evaluator: Evaluator) -> None:
        """What the effects of a time do in this state."""
        for number, effect in enumerate(step.operator.effects):
            if effect.when != when:
                continue
            allowed = self._allowed.get((step.number, number))
            conditions = [
                timed.condition for timed in effect.conditions if allowed is None or timed.when != START
            ]
            everything = evaluator.extend(effect.variables, step.bindings)
            for bindings in everything if allowed is None else allowed:
                changes.need(conditions, bindings)
                if all(evaluator.holds(condition, bindings) for condition in conditions):
                    changes.note(effect, evaluator, bindings)
                    result = None if effect.fluent is None else ground(result_of(effect), bindings)
                    if result is not None and evaluator.number(result) is None:
                        self._unmet[Unmet(step.number, when, Comparison("=", result, result))] = None


def _ground(number: int, step: PlanStep, domain: Domain, known: Dict[str, Tuple[str, ...]]) -> _Step:
    operator = domain.operators.get(step.name.lower())
    if operator is None or len(operator.parameters) != len(step.arguments):
        raise PlanRunError(f"step {number + 1} of the plan, {step}, is no action of '{domain.name}'")
    bindings = {parameter.name: name for parameter, name in zip(operator.parameters, step.arguments)}
    for parameter, name in zip(operator.parameters, step.arguments):
        if name.lower() not in known or not domain.accepts(parameter.types, known[name.lower()]):
            kind = domain.type_name(parameter.types)
            raise PlanRunError(f"step {number + 1} of the plan, {step}: the problem has no {kind} '{name}'")
    needs: Dict[str, List[Condition]] = {}
    for timed in operator.conditions:
        needs.setdefault(timed.when, []).extend(must_hold(ground(timed.condition, bindings)))
    begin = round(step.time, _DIGITS)
    # Its end is a happening behind its start, however short it is.
    end = round(step.time + max(step.duration, 10.0**-_DIGITS), _DIGITS) if operator.durative else begin
    return _Step(number, operator, bindings, begin, end, needs)
