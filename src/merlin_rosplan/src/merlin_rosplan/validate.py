"""``rosrun merlin_rosplan validate domain.pddl [problem.pddl] [goal]``: checks PDDL, without ROS.

Says with file, line and column what is wrong, and, when a goal is stated, whether a plan exists. Our own
reader decides what the knowledge base can use; kairos, where it is installed, checks the rest and plans.
"""

import argparse
import importlib
import sys
from pathlib import Path
from typing import Any, List, Optional

from merlin_rosplan.domain import Domain
from merlin_rosplan.domain_reader import parse_domain
from merlin_rosplan.formula import to_pddl
from merlin_rosplan.knowledge import conjuncts
from merlin_rosplan.pddl_text import PddlError
from merlin_rosplan.problem import Problem
from merlin_rosplan.problem_reader import parse_condition, parse_problem
from merlin_rosplan.problem_writer import write_problem

VALID, INVALID, USAGE = 0, 1, 2


def kairos() -> Optional[Any]:
    """The planner's module; None where it is not installed (it needs Python 3.10)."""
    try:
        return importlib.import_module("kairos")
    except ImportError:
        return None


class Validation:
    """Checks a domain, then a problem, then a goal; collects what there is to tell.

    Parameters
    ----------
    time_limit: s for the search for a plan.
    """

    def __init__(self, time_limit: float = 10.0) -> None:
        self.messages: List[str] = []
        self.valid = True
        self._time_limit = time_limit
        self._kairos = kairos()

    def run(self, domain_path: str, problem_path: Optional[str] = None, goal: Optional[str] = None) -> bool:
        """Checks everything; returns whether it is valid and, if a goal is stated, solvable."""
        try:
            domain_text = _read(domain_path)
            domain = self._check_domain(domain_text, domain_path)
            if problem_path is None:
                return self.valid
            problem_text = _read(problem_path)
            problem = parse_problem(problem_text, domain, problem_path)
            if self._kairos is not None:
                self._report(
                    self._kairos.check_problem(problem_text, domain_text, problem_path, domain_path),
                    problem_path,
                )
            if goal is not None:
                known = {**domain.constants, **problem.objects}
                problem.goals = conjuncts(parse_condition(goal, domain, known, "goal"))
            if self.valid and problem.goals:
                self._plan(domain, domain_text, problem)
        except PddlError as error:
            self._invalid(str(error))
        return self.valid

    def _check_domain(self, text: str, path: str) -> Domain:
        if self._kairos is not None:
            self._report(self._kairos.check_domain(text, path), path)
        domain = parse_domain(text, path)
        if self.valid:
            self.messages.append(
                f"{path}: domain '{domain.name}': {len(list(domain.types))} types, "
                f"{len(domain.predicates)} predicates, {len(domain.functions)} functions, "
                f"{len(domain.operators)} operators"
            )
        return domain

    def _report(self, report: Any, path: str) -> None:
        for diagnostic in report.diagnostics:
            # of other files only what is an error: their warnings were told when they were checked
            place = diagnostic.location
            if place is None or place.file == path or diagnostic.severity == self._kairos.Severity.ERROR:
                message = str(diagnostic)
                if message not in self.messages:
                    self.messages.append(message)
        self.valid = self.valid and bool(report.valid)

    def _plan(self, domain: Domain, domain_text: str, problem: Problem) -> None:
        goals = " ".join(map(to_pddl, problem.goals))
        if self._kairos is None:
            self.messages.append("kairos is not installed here: whether a plan exists was not checked")
            return
        result = self._kairos.solve(domain_text, write_problem(problem, domain), timeout=self._time_limit)
        if result.status == self._kairos.Status.SOLVED:
            self.messages.append(f"a plan for {goals}:\n{str(result.plan).strip()}")
            return
        reasons = "; ".join(diagnostic.message for diagnostic in result.diagnostics)
        status = result.status.name.lower().replace("_", " ")
        self._invalid(f"no plan for {goals}: {status}" + (f": {reasons}" if reasons else ""))

    def _invalid(self, message: str) -> None:
        self.valid = False
        # kairos and our reader often see the same thing, a column apart
        line = message.split(": ", 1)[0].rsplit(":", 1)[0]
        if not any(known.startswith(f"{line}:") and ": error: " in known for known in self.messages):
            self.messages.append(message)


def _read(path: str) -> str:
    try:
        return Path(path).read_bytes().decode("utf-8-sig")
    except OSError as error:
        raise PddlError(f"cannot be read: {error.strerror or error}", path) from error
    except ValueError as error:
        raise PddlError(f"is not UTF-8 text: {error}", path) from error


def validate(arguments: List[str]) -> int:
    """Runs the command; returns its exit code: 0 valid, 1 not."""
    parser = argparse.ArgumentParser(
        prog="rosrun merlin_rosplan validate",
        description="Checks a PDDL domain, a problem for it, and whether a goal can be reached.",
    )
    parser.add_argument("domain", help="PDDL file of the domain")
    parser.add_argument("problem", nargs="?", help="PDDL file of a problem")
    parser.add_argument(
        "goal", nargs="?", help='goal instead of the problem\'s own, e.g. "(checked kitchen)"'
    )
    parser.add_argument("--time-limit", type=float, default=10.0, help="s for the search for a plan")
    given = parser.parse_args(arguments)
    validation = Validation(given.time_limit)
    valid = validation.run(given.domain, given.problem, given.goal)
    for message in validation.messages:
        print(message)
    print("valid" if valid else "NOT valid")
    return VALID if valid else INVALID


def main() -> None:
    """Entry point of ``rosrun merlin_rosplan validate``."""
    sys.exit(validate([argument for argument in sys.argv[1:] if not argument.startswith("__")]))
