# SPDX-License-Identifier: Apache-2.0
"""Checks PDDL and plans, in this process: no planner sees bad input, no dispatcher a bad plan.

With kairos where it is installed; else our own reader reads, and plans are carried out on paper.
"""

import atexit
import functools
import gc
import importlib
import importlib.util
import math
import re
from dataclasses import dataclass
from types import ModuleType
from typing import Any, Iterable, List, Optional, Tuple

from merlin_pddl.analysis.plan_run import PlanRun, plan_fault
from merlin_pddl.constraint_reader import misplaced
from merlin_pddl.domain_reader import open_definition, parse_domain
from merlin_pddl.evaluation import Evaluator
from merlin_pddl.formula_reader import IN_CONSTRAINTS, TRAJECTORY
from merlin_pddl.plan_text import NO_DURATION, PlanStep
from merlin_pddl.problem_reader import parse_problem
from merlin_pddl.text_reader import PddlError, read_expression

# What kairos accepts with a warning, and what makes a plan impossible for a reason that is hard to find.
_FATAL_WARNINGS = ("dialect.undeclared_predicate", "dialect.undeclared_function")


#: s by which an end may be late in a plan whose times have three decimals: those of start and duration.
ROUNDING = 0.0015

_METRIC = re.compile(r"\(\s*:metric\s+(minimize|maximize)", re.IGNORECASE)


@functools.lru_cache(maxsize=None)
def available() -> bool:
    """Whether kairos is installed; does not load it."""
    return importlib.util.find_spec("kairos") is not None


@functools.lru_cache(maxsize=None)
def load() -> Optional[ModuleType]:
    """kairos, loaded when it is first needed: a node that plans in another process never needs it."""
    try:
        kairos = importlib.import_module("kairos")
    except ImportError:  # Python 3.8 of Noetic: kairos needs 3.10
        return None
    # Its bindings print all that is left of them when Python ends without a look for garbage, as nodes do.
    atexit.unregister(gc.freeze)
    return kairos


def rejected(log: Iterable[str]) -> str:
    """Why kairos rejects the plans that it finds: its check needs more numbers than its search.

    :param log: texts of its ``on_log``; empty when none of them says so.
    """
    found = (re.search(r"a plan failed validation: (?:plan: error: )?(.*?)(?: \[[^]]*\])?$", s) for s in log)
    return next((f"kairos rejects the plans that it finds: {each.group(1)}" for each in found if each), "")


def check_input(domain: str, problem: str, domain_name: str, problem_name: str) -> Optional[str]:
    """Checks a domain and a problem for it.

    :param domain, problem: PDDL text.
    :param domain_name, problem_name: file names for the messages.

    Returns ``file:line:column: what is wrong``, or None when nothing is.
    """
    kairos = load()
    if kairos is None:
        try:
            parse_problem(problem, parse_domain(domain, domain_name), problem_name, constraints=True)
        except PddlError as error:
            return str(error)
        return None
    fault = _misplaced_constraint(domain, problem, problem_name)
    if fault is not None:
        return fault
    for report in (
        kairos.check_domain(domain, domain_name),
        kairos.check_problem(problem, domain, problem_name, domain_name),
    ):
        for diagnostic in report.diagnostics:
            if diagnostic.severity == kairos.Severity.ERROR or diagnostic.code in _FATAL_WARNINGS:
                where = diagnostic.location
                place = f"{where.file}:{where.line}:{where.column}: " if where is not None else ""
                return f"{place}{diagnostic.message}"
        if not report.valid:
            return "kairos finds it invalid and does not say why"
    return None


def _misplaced_constraint(domain: str, problem: str, name: str) -> Optional[str]:
    """A trajectory constraint in the goal, which kairos takes for a condition that never holds."""
    if not any(word in problem.lower() for word in TRAJECTORY):
        return None
    try:
        declared = parse_domain(domain).predicates
        _, sections = open_definition(read_expression(problem, name), "problem")
    except PddlError:  # kairos says it better, and reads more
        return None
    for section in sections:
        found = misplaced(section) if section.head == ":goal" else None
        if found is not None and found.head not in declared:
            return str(found.error(f"'{found.head}' {IN_CONSTRAINTS}"))
    return None


@dataclass(frozen=True)
class PlanQuality:
    """How good a plan is.

    :param metric: its value of the problem's metric, negative where that is to be maximized; None without
        one.
    :param makespan: s.
    :param actions: how many.
    """

    metric: Optional[float]
    makespan: float
    actions: int

    def order(self) -> Tuple[float, float, int]:
        """The better plan has the smaller one."""
        return (math.inf if self.metric is None else self.metric, self.makespan, self.actions)


class PlanValidator:
    """Says whether plans solve one problem, and how good they are; reads the problem once.

    :param domain, problem: PDDL text.
    :raises ValueError: they cannot be read.
    """

    #: s by which a planner's durations may be off; POPF and LPG print three or four digits
    TOLERANCE = 0.01

    def __init__(self, domain: str, problem: str) -> None:
        self._kairos = load()
        # Where no metric is stated, kairos takes the length of the plan for it.
        found = _METRIC.search(re.sub(r";[^\n]*", "", problem))
        self._sense = 0.0 if found is None else -1.0 if found.group(1).lower() == "maximize" else 1.0
        if self._kairos is not None:
            try:
                self._problem = self._kairos.parse_problem(problem, self._kairos.parse_domain(domain))
            except self._kairos.PddlError as error:
                raise ValueError(str(error)) from None
            return
        try:
            model = parse_domain(domain)
            self._task = model, parse_problem(problem, model, constraints=True)
        except PddlError as error:
            raise ValueError(str(error)) from None

    def fault(self, steps: Iterable[PlanStep]) -> Optional[str]:
        """What is wrong with a plan, or None when it solves the problem."""
        if self._kairos is None:
            steps = list(steps)
            return (plan_fault(*self._task, steps) and plan_fault(*self._task, steps, ROUNDING)) or None
        try:
            report = self._report(list(steps))
        except self._kairos.PddlError as error:
            return str(error)
        status = self._kairos.ValidationStatus
        if report.status in (status.VALID, status.UNSUPPORTED):
            return None
        fatal = self._kairos.Severity.ERROR
        messages = [entry.message for entry in report.diagnostics if entry.severity == fatal]
        return "; ".join(messages) or "kairos' validator does not accept it and does not say why"

    def quality(self, steps: Iterable[PlanStep]) -> PlanQuality:
        """How good a plan is that has no fault."""
        steps = list(steps)
        length = max((s.time + s.duration for s in steps), default=0.0)
        value = None
        if self._kairos is not None:
            value = self._report(steps).metric if self._sense else None
        elif self._task[1].metric is not None:
            end = PlanRun(*self._task, steps).run().state
            value = Evaluator(self._task[0], end, {"total-time": length}).number(self._task[1].metric.value)
        return PlanQuality(None if value is None else self._sense * value, length, len(steps))

    def _report(self, steps: List[PlanStep]) -> Any:
        # An action without duration must not have one in the text either.
        text = "".join(
            f"{step.time:.6f}: {step}"
            + (f" [{step.duration:.6f}]\n" if step.duration != NO_DURATION else "\n")
            for step in steps
        )
        assert self._kairos is not None
        options = self._kairos.ValidateOptions()
        options.duration_tolerance = self.TOLERANCE
        return self._kairos.validate(self._problem, self._kairos.parse_plan(text), options)
