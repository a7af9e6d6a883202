# SPDX-License-Identifier: Apache-2.0
"""``rosrun merlin_rosplan validate domain.pddl [problem.pddl] [goal]``: checks PDDL, without ROS.

Says with file, line and column what is wrong, and, when a goal is stated, whether a plan exists. Our own
reader decides what the knowledge base can use; kairos, where it is installed, checks the rest and plans. All
of it happens in a process of its own, which is ended when its time is over.
"""

import argparse
import json
import os
import select
import signal
import sys
import time
import traceback
from typing import Any, Callable, List, Optional, Tuple

from merlin_pddl.analysis.shortfall import shortfall
from merlin_pddl.checks import portability
from merlin_pddl.checks.kairos_check import load, rejected
from merlin_pddl.domain import Domain
from merlin_pddl.domain_reader import parse_domain
from merlin_pddl.formula import to_pddl
from merlin_pddl.knowledge import conjuncts
from merlin_pddl.problem import Problem
from merlin_pddl.problem_reader import parse_condition, parse_problem
from merlin_pddl.problem_writer import write_problem
from merlin_pddl.text_reader import PddlError, text_of

VALID, INVALID, USAGE = 0, 1, 2
#: MB that a file may have; reading one MB takes about a second.
MAX_SIZE = 8.0
TIME_LIMIT = 10.0
LONGEST = 1e6  # s
#: s after its limit at which a check ends that has lost its parent.
SPARE = 5.0


class Validation:
    """Checks a domain, then a problem, then a goal; collects the messages.

    :param time_limit: s for the search for a plan.
    :param max_size: MB that a file may have.
    :param on_stage: called with what is done next.
    """

    def __init__(
        self,
        time_limit: float = TIME_LIMIT,
        max_size: float = MAX_SIZE,
        on_stage: Callable[[str], None] = lambda stage: None,
    ) -> None:
        # The best plan so far has to be sent before the time is over.
        self._ends = time.monotonic() + time_limit - min(1.0, 0.2 * time_limit)
        self._max_size = max_size
        self._stage = on_stage
        self.messages: List[str] = []
        self.valid = True
        self._kairos = load()

    def run(self, domain_path: str, problem_path: Optional[str] = None, goal: Optional[str] = None) -> bool:
        """Checks everything; returns whether it is valid and, if a goal is stated, solvable."""
        try:
            self._stage(f"reading {domain_path}")
            domain_text = _read(domain_path, self._max_size)
            domain = self._check_domain(domain_text, domain_path)
            if problem_path is None:
                return self.valid
            self._stage(f"reading {problem_path}")
            problem_text = _read(problem_path, self._max_size)
            problem = parse_problem(problem_text, domain, problem_path, constraints=True)
            self.messages.extend(portability.warnings(problem_text, problem_path))
            if self._kairos is not None:
                self._stage(f"checking {problem_path}")
                report = self._kairos.check_problem(problem_text, domain_text, problem_path, domain_path)
                self._report(report, problem_path, self._kairos.Severity.ERROR)
            if goal is not None:
                known = problem.typed(domain.constants)
                problem.goals = conjuncts(parse_condition(goal, domain, known, "goal"))
            if self.valid and problem.goals:
                self._plan(domain, domain_text, problem)
        except PddlError as error:
            self._invalid(str(error))
        return self.valid

    def _check_domain(self, text: str, path: str) -> Domain:
        if self._kairos is not None:
            self._report(self._kairos.check_domain(text, path), path, self._kairos.Severity.ERROR)
        # before the errors that come of them
        self.messages[:0] = portability.misspelt_supertypes(text, path)
        domain = parse_domain(text, path)
        self.messages.extend(portability.warnings(text, path))
        if self.valid:
            self.messages.append(
                f"{path}: domain '{domain.name}': {len(list(domain.types))} types, "
                f"{len(domain.predicates)} predicates, {len(domain.functions)} functions, "
                f"{len(domain.operators)} operators"
            )
        return domain

    def _report(self, report: Any, path: str, error: Any) -> None:
        for diagnostic in report.diagnostics:
            # of other files only what is an error: their warnings were printed when they were checked
            place = diagnostic.location
            if place is None or place.file == path or diagnostic.severity == error:
                message = str(diagnostic)
                if message not in self.messages:
                    self.messages.append(message)
        self.valid = self.valid and bool(report.valid)

    def _plan(self, domain: Domain, domain_text: str, problem: Problem) -> None:
        goals = " ".join(map(to_pddl, problem.goals))
        if self._kairos is None:
            self.messages.append("kairos is not installed here: whether a plan exists was not checked")
            return
        self._stage(f"looking for a plan for {goals}")
        left = max(0.1, self._ends - time.monotonic())
        problem_text = write_problem(problem, domain)
        log: List[str] = []
        options = {"timeout": left, "on_log": lambda level, channel, text: log.append(text)}
        result = self._kairos.solve(domain_text, problem_text, **options)
        if result.status == self._kairos.Status.SOLVED:
            self.messages.append(f"a plan for {goals}:\n{str(result.plan).strip()}")
            return
        reasons = rejected(log) or "; ".join(diagnostic.message for diagnostic in result.diagnostics)
        if result.status == self._kairos.Status.TIMEOUT:  # kairos names options of its own command
            reasons = f"none was found within {left:.3g} s; --time-limit gives it more"
        found, why = shortfall(domain_text, problem_text)
        failed = result.status == self._kairos.Status.INTERNAL_ERROR
        reasons = "; ".join(filter(None, (why if found else "", "" if found and failed else reasons)))
        status = "unsolvable" if found and failed else result.status.name.lower().replace("_", " ")
        self._invalid(f"no plan for {goals}: {status}" + (f": {reasons}" if reasons else ""))

    def _invalid(self, message: str) -> None:
        self.valid = False
        # kairos and our reader often see the same thing, a column apart
        line = message.split(": ", 1)[0].rsplit(":", 1)[0]
        if not any(known.startswith(f"{line}:") and ": error: " in known for known in self.messages):
            self.messages.append(message)


def _read(path: str, max_size: float) -> str:
    size = os.path.getsize(path) / 1e6 if os.path.isfile(path) else 0.0
    if size > max_size:
        raise PddlError(
            f"has {size:.1f} MB, and at most {max_size:g} are read (--max-size; each takes about 1 s)", path
        )
    return text_of(path)


def run_limited(
    files: Tuple[str, Optional[str], Optional[str]], time_limit: float, max_size: float
) -> Tuple[bool, List[str]]:
    """Checks in a child process, which does not outlive the limit whatever it is doing.

    :param files: domain, problem and goal.
    :param time_limit: s of running time for everything.
    :param max_size: MB that a file may have.
    :return: whether all is valid, and the messages.
    """
    reads, writes = os.pipe()
    pid = os.fork()
    if pid == 0:
        signal.signal(signal.SIGINT, signal.SIG_DFL)  # of a terminal: it is for this process, too
        signal.setitimer(signal.ITIMER_REAL, time_limit + SPARE)  # the parent may be killed
        _child(files, time_limit, max_size, writes)
    os.close(writes)
    deadline = time.monotonic() + time_limit
    received = b""
    ended = False
    while not ended and time.monotonic() < deadline:
        if select.select([reads], [], [], max(0.0, deadline - time.monotonic()))[0]:
            part = os.read(reads, 65536)
            received += part
            ended = not part
    os.close(reads)
    if not ended:
        os.kill(pid, signal.SIGKILL)
    _, status = os.waitpid(pid, 0)
    lines = [json.loads(line) for line in received.split(b"\n")[:-1]]
    if lines and "valid" in lines[-1]:
        return lines[-1]["valid"], lines[-1]["messages"]
    stage = lines[-1]["stage"] if lines else "starting"
    if not ended:
        return False, [f"not checked to the end: {stage} takes more than {time_limit:g} s (--time-limit)"]
    return False, [f"not checked to the end: {stage} ended with status {status} (is the memory full?)"]


def _child(
    files: Tuple[str, Optional[str], Optional[str]], time_limit: float, max_size: float, pipe: int
) -> None:
    """Checks, writes the result into the pipe to the parent, ends."""

    def send(**message: Any) -> None:
        data = json.dumps(message).encode() + b"\n"
        while data:
            data = data[os.write(pipe, data) :]

    try:
        validation = Validation(time_limit, max_size, lambda stage: send(stage=stage))
        valid = validation.run(*files)
        send(valid=valid, messages=validation.messages)
    except BaseException:
        traceback.print_exc()
        sys.stderr.flush()
        os._exit(1)
    os._exit(0)


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
    parser.add_argument("--time-limit", type=float, default=TIME_LIMIT, help="s for everything")
    parser.add_argument("--max-size", type=float, default=MAX_SIZE, help="MB that a file may have")
    given = parser.parse_args(arguments)
    if not (0.0 < given.time_limit <= LONGEST and given.max_size > 0.0):
        parser.error(f"--time-limit and --max-size are numbers above 0, --time-limit up to {LONGEST:g}")
    valid, messages = run_limited((given.domain, given.problem, given.goal), given.time_limit, given.max_size)
    for message in messages:
        print(message)
    print("valid" if valid else "NOT valid")
    return VALID if valid else INVALID


def main() -> None:
    """Entry point of ``rosrun merlin_rosplan validate``."""
    sys.exit(validate([argument for argument in sys.argv[1:] if not argument.startswith("__")]))
