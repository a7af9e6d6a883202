"""Checks PDDL and plans with kairos, in this process: no planner sees bad input, no dispatcher a bad plan."""

import importlib
from types import ModuleType
from typing import Iterable, Optional

from merlin_rosplan.plan_text import NO_DURATION, PlanStep

# What kairos lets pass with a warning and what makes a plan impossible for a reason nobody would find.
_FATAL_WARNINGS = ("dialect.undeclared_predicate", "dialect.undeclared_function")


def _load() -> Optional[ModuleType]:
    try:
        return importlib.import_module("kairos")
    except ImportError:  # Python 3.8 of Noetic: kairos needs 3.10
        return None


_kairos = _load()


def available() -> bool:
    """Whether kairos is there; without it nothing is checked here and everything passes."""
    return _kairos is not None


def check_input(domain: str, problem: str, domain_name: str, problem_name: str) -> Optional[str]:
    """Checks a domain and a problem for it.

    Parameters
    ----------
    domain, problem: PDDL text.
    domain_name, problem_name: file names for the messages.

    Returns ``file:line:column: what is wrong``, or None when nothing is.
    """
    if _kairos is None:
        return None
    for report in (
        _kairos.check_domain(domain, domain_name),
        _kairos.check_problem(problem, domain, problem_name, domain_name),
    ):
        for diagnostic in report.diagnostics:
            if diagnostic.severity == _kairos.Severity.ERROR or diagnostic.code in _FATAL_WARNINGS:
                where = diagnostic.location
                place = f"{where.file}:{where.line}:{where.column}: " if where is not None else ""
                return f"{place}{diagnostic.message}"
        if not report.valid:
            return "kairos finds it invalid and does not say why"
    return None


class PlanValidator:
    """Says whether plans solve one problem; reads the problem once.

    Parameters
    ----------
    domain, problem: PDDL text.

    Raises
    ------
    ValueError: they cannot be read.
    """

    #: s by which a planner's durations may be off; POPF and LPG print three or four digits
    TOLERANCE = 0.01

    def __init__(self, domain: str, problem: str) -> None:
        self._problem = None
        if _kairos is not None:
            try:
                self._problem = _kairos.parse_problem(problem, _kairos.parse_domain(domain))
            except _kairos.PddlError as error:
                raise ValueError(str(error)) from None

    def fault(self, steps: Iterable[PlanStep]) -> Optional[str]:
        """What is wrong with a plan, or None when it solves the problem (or nobody can tell)."""
        if _kairos is None or self._problem is None:
            return None
        steps = list(steps)
        # An action without duration must not have one in the text either.
        text = "".join(
            f"{step.time:.6f}: {step}"
            + (f" [{step.duration:.6f}]\n" if step.duration != NO_DURATION else "\n")
            for step in steps
        )
        try:
            plan = _kairos.parse_plan(text)
        except _kairos.PddlError as error:
            return str(error)
        options = _kairos.ValidateOptions()
        options.duration_tolerance = self.TOLERANCE
        report = _kairos.validate(self._problem, plan, options)
        if report.status in (_kairos.ValidationStatus.VALID, _kairos.ValidationStatus.UNSUPPORTED):
            return None
        messages = [entry.message for entry in report.diagnostics if entry.severity == _kairos.Severity.ERROR]
        return "; ".join(messages) or "kairos' validator does not accept it and does not say why"
