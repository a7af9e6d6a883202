# SPDX-License-Identifier: Apache-2.0
"""A planning task whose goals have deadlines, as PDDL that planners with timed initial literals read.

Each goal with a deadline gets an action that marks it: its condition is the goal and a fact that a timed
literal ends at the deadline. The marks are the goals of the new task, and are taken out of its plans again.
"""

import math
from typing import Callable, Dict, Iterable, List, NamedTuple, Optional, Sequence, Set, Tuple

from merlin_pddl.analysis.domain_text import require, section, unused, words
from merlin_pddl.domain import Domain, depends_on
from merlin_pddl.domain_reader import DomainReader
from merlin_pddl.formula import (
    END,
    And,
    Atom,
    Condition,
    Equal,
    Exists,
    Forall,
    Not,
    Or,
    ground,
    preferences,
    terms,
    to_pddl,
    walk,
)
from merlin_pddl.knowledge import Fact, Timed, conjuncts
from merlin_pddl.plan_text import PlanStep
from merlin_pddl.problem import Problem
from merlin_pddl.problem_reader import LATEST, NANOSECONDS, parse_condition, parse_problem
from merlin_pddl.problem_writer import object_lines, write_problem
from merlin_pddl.text_reader import Expression, PddlError, read_expression, read_text

#: s between what makes a goal true and its mark; planners separate happenings by as much.
SEPARATION = 0.001
#: s for which the deadline stays open, so that a goal that comes true at the deadline can still be marked.
GRACE = 0.01

_TIMED = ":timed-initial-literals"
_REQUIRED: Dict[type, str] = {
    Not: ":negative-preconditions",
    Or: ":disjunctive-preconditions",
    Forall: ":universal-preconditions",
    Exists: ":existential-preconditions",
    Equal: ":equality",
}
Term = Tuple[str, ...]


class Due(NamedTuple):
    """Goals that have to hold together at one moment, in time. Afterwards those of the problem have to."""

    goals: Tuple[str, ...]
    """PDDL text."""
    within: float
    """s from the begin of the plan; infinite: they are reached at any time."""

    @property
    def text(self) -> str:
        """The goals as one text."""
        return " ".join(self.goals)


class Marked(NamedTuple):
    """The steps of a plan without the marks, and when each goal with a deadline is reached."""

    steps: List[PlanStep]
    reached: Tuple[float, ...]
    """s from the begin of the plan, in the order of the deadlines."""


class _Mark(NamedTuple):
    """The action that marks one goal, and what of the world its goal depends on."""

    action: str
    goal: Condition
    open: str
    done: str


class DeadlineTask:
    """Domain and problem as text in which some goals have to be reached in time.

    The goals of the problem have to hold at the end, also those that have a deadline. Where no action has a
    duration no time passes, and every goal that can be reached is in time.

    :param domain, problem: PDDL text.
    :param dues: the goals with deadlines.
    :param binding: whether the deadlines count; otherwise the goals are marked at any time.
    :raises PddlError: the text is not PDDL, or what has a deadline is not a goal of this domain.
    :ivar plain: the problem with what has a deadline as further goals.
    """

    def __init__(self, domain: str, problem: str, dues: Sequence[Due], binding: bool = True) -> None:
        node = read_expression(domain, "domain")
        self._model = DomainReader(read_expression(domain, "domain")).read()
        found = parse_problem(problem, self._model, constraints=True)
        objects = found.typed(self._model.constants)
        goals = [_goal(due, self._model, objects) for due in dues]
        self._marks = _named(goals, words([node, read_expression(problem, "problem")]))
        self._timed = found.timed
        rest = found.goals
        found.goals = [*rest, *goals]
        self.plain = write_problem(found, self._model)
        self._declare(node, found)
        self.domain = node.text()
        found.goals = [*rest, *(Atom(mark.done) for mark in self._marks)]
        found.facts += [Fact(mark.open, ()) for mark in self._marks]
        self._passes = any(operator.durative for operator in self._model.operators.values())
        if binding and self._passes:
            found.timed = self._timed + [
                Timed(int((max(0.0, due.within) + GRACE) * NANOSECONDS), Fact(mark.open, (), negative=True))
                for due, mark in zip(dues, self._marks)
                if due.within < math.inf
            ]
        self.problem = write_problem(found, self._model)

    def unmarked(self, plan: Sequence[PlanStep], fault: Callable[[List[PlanStep]], Optional[str]]) -> Marked:
        """A plan of the task without its marks.

        :param fault: says what is wrong with a plan of the task, if anything is: a search sets marks late.
        :raises PddlError: the plan is not one of this task.
        """
        actions = {mark.action for mark in self._marks}
        steps = [step for step in plan if step.name.lower() not in actions]
        if not self._passes:
            return Marked(steps, (0.0,) * len(self._marks))
        marks: Dict[str, PlanStep] = {}
        for step in plan:
            if step.name.lower() in actions:
                marks.setdefault(step.name.lower(), step)
        reached = []
        for mark in self._marks:
            if mark.action not in marks:  # it was not validated
                raise PddlError(f"the plan does not reach {to_pddl(mark.goal)}")
            step = marks[mark.action]
            others = [*steps, *(other for other in marks.values() if other is not step)]
            for time in self._moments(mark.goal, steps):
                moved = PlanStep(time + SEPARATION, step.name, (), step.duration)
                together = sorted([*others, moved], key=lambda other: other.time)
                if moved.time >= step.time or fault(together) is None:
                    reached.append(min(time, step.time))
                    break
            else:
                reached.append(step.time)
        return Marked(steps, tuple(reached))

    def _declare(self, node: Expression, problem: Problem) -> None:
        """Adds the marks to the domain; objects that they name become constants of it."""
        named = words([read_expression(to_pddl(mark.goal)) for mark in self._marks]) & set(problem.objects)
        constants = Problem("", "", {name: problem.objects.pop(name) for name in sorted(named)})
        # In front: behind an untyped list its names would get the type too.
        section(node, ":constants")[1:1] = [
            word for line in object_lines(constants, self._model) for word in read_text(line)
        ]
        found = {type(each) for mark in self._marks for each in walk(mark.goal)}
        needed = [requirement for kind, requirement in _REQUIRED.items() if kind in found]
        require(node, [_TIMED, *sorted(needed)])
        for mark in self._marks:
            section(node, ":predicates").extend(
                [read_expression(f"({mark.open})"), read_expression(f"({mark.done})")]
            )
            condition = to_pddl(And((Atom(mark.open), *conjuncts(mark.goal))))
            node.append(
                read_expression(
                    f"(:action {mark.action} :parameters () :precondition {condition} :effect ({mark.done}))"
                )
            )

    def _moments(self, goal: Condition, steps: Iterable[PlanStep]) -> List[float]:
        """When something that a goal depends on may change, s from the begin of a plan, in order."""
        wanted = {(term.name, *term.args) for term in terms(goal)}
        derived = depends_on(goal, self._model.derived) - {term[0] for term in wanted}

        def concerns(term: Term) -> bool:
            return term[0] in derived or any(_may_be(term, other) for other in wanted)

        found = {0.0, *(row.at / NANOSECONDS for row in self._timed if concerns(row.item.key))}
        for step in steps:
            operator = self._model.operators.get(step.name.lower())
            if operator is None:
                continue
            values = {
                parameter.name: value.lower() for parameter, value in zip(operator.parameters, step.arguments)
            }
            for effect in operator.effects:
                changed = ground(effect.atom or effect.fluent, values)
                if changed is not None and concerns((changed.name, *changed.args)):
                    at_end = effect.when == END and operator.durative
                    found.add(step.time + (step.duration if at_end else 0.0))
        return sorted(found)


def _goal(due: Due, domain: Domain, objects: Dict[str, Tuple[str, ...]]) -> Condition:
    if not due.goals:
        raise PddlError("a deadline has no goals")
    if math.isnan(due.within) or LATEST < due.within < math.inf:
        raise PddlError(
            f"the deadline of {due.text} is {due.within:g} s from the begin of the plan; "
            f"it has to be a number, at most {LATEST}, or inf for none"
        )
    goal = And(
        tuple(part for text in due.goals for part in conjuncts(parse_condition(text, domain, objects)))
    )
    if preferences(goal):
        raise PddlError(f"{due.text} has a preference, which cannot have a deadline")
    return goal


def _named(goals: Sequence[Condition], used: Set[str]) -> List[_Mark]:
    """Marks whose names do not stand in the task yet."""
    names = ("collect", "open", "done")
    marks = ((goal, [unused(f"{name}-{index}", used) for name in names]) for index, goal in enumerate(goals))
    return [_Mark(action, goal, open_, done) for goal, (action, open_, done) in marks]


def _may_be(term: Term, other: Term) -> bool:
    """Whether two terms can mean the same; a variable can be any object."""
    return len(term) == len(other) and all(
        one == two or "?" in (one[:1], two[:1]) for one, two in zip(term, other)
    )
