"""One planning, from files to an outcome: kairos, or an external planner behind a command line."""

import logging
import shutil
import sys
import tempfile
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import List, Optional, Tuple

from merlin_rosplan import pddl_check
from merlin_rosplan.plan_text import PlanStep, format_plan, restore_case
from merlin_rosplan.planner_command import PlannerCommand, PlannerCommandError, parse_command
from merlin_rosplan.planner_output import candidate_plans, is_plan_file, verdict
from merlin_rosplan.planner_presets import expand
from merlin_rosplan.planner_process import PlannerProcess, ProcessResult
from merlin_rosplan.planning_outcome import PlannerState, PlanningOutcome

_log = logging.getLogger(__name__)

KAIROS = "kairos"
# Exit codes of the kairos command, as `kairos --help` lists them.
_KAIROS_EXIT = {
    1: (PlannerState.CRASHED, "internal error of kairos"),
    2: (PlannerState.INVALID, "kairos does not accept the input"),
    10: (PlannerState.UNSOLVABLE, "the problem has no plan"),
    11: (PlannerState.TIMEOUT, "no plan within the time limit"),
    12: (PlannerState.CRASHED, "kairos ran out of memory"),
    13: (PlannerState.CRASHED, "kairos does not support a feature of the task"),
    14: (PlannerState.UNSOLVABLE, "the search ended without a plan; this is no proof that there is none"),
}


@dataclass(frozen=True)
class PlannerSettings:
    """How to plan.

    Parameters
    ----------
    command: external planner with DOMAIN and PROBLEM, or just ``fast-downward`` or ``lpg``; empty: kairos.
    fallback: use kairos when the command's program is missing.
    time_limit: wall time for one planning, s; 0 means never. A ``timeout N`` in the command wins.
    anytime: s that kairos may go on looking for better plans after the first; 0 takes the first one.
    check_input: check domain and problem before planning.
    """

    command: str = ""
    fallback: bool = True
    time_limit: float = 60.0
    anytime: float = 0.0
    check_input: bool = True


class Planning:
    """One planning of one problem. :meth:`cancel` ends it from any thread.

    Parameters
    ----------
    settings: how.
    domain_path, problem_path: PDDL files.
    data_path: folder for the planner's output and the plan (``plan.pddl``); None keeps nothing.
    """

    def __init__(
        self, settings: PlannerSettings, domain_path: str, problem_path: str, data_path: Optional[str] = None
    ) -> None:
        self._settings = settings
        self._domain = Path(domain_path).absolute()
        self._problem = Path(problem_path).absolute()
        self._data = Path(data_path) if data_path else None
        self._lock = threading.Lock()  # guards the two fields below
        self._cancelled = False
        self._process: Optional[PlannerProcess] = None
        self.warning: Optional[str] = None

    def cancel(self) -> None:
        """Kills the planner; :meth:`run` then returns CANCELLED."""
        with self._lock:
            self._cancelled = True
            process = self._process
        if process is not None:
            process.cancel()

    def run(self) -> PlanningOutcome:
        """Plans and says how it ended; raises nothing."""
        started = time.monotonic()
        state, reason, plan, planner = self._run()
        return PlanningOutcome(state, reason, plan, planner, time.monotonic() - started)

    def _run(self) -> Tuple[PlannerState, str, str, str]:
        planner = KAIROS
        try:
            domain = self._domain.read_text(errors="replace")
            problem = self._problem.read_text(errors="replace")
        except OSError as error:
            return PlannerState.INVALID, f"cannot read {error.filename}: {error.strerror}", "", planner
        except ValueError as error:  # a path with a null byte
            return (
                PlannerState.INVALID,
                f"cannot read {self._domain!s} and {self._problem!s}: {error}",
                "",
                planner,
            )
        try:
            command = self._command()
        except PlannerCommandError as error:
            return PlannerState.CRASHED, str(error), "", planner
        if command is not None:
            planner = command.name
        if self._settings.check_input:
            fault = pddl_check.check_input(domain, problem, str(self._domain), str(self._problem))
            if fault is not None:
                return PlannerState.INVALID, fault, "", planner
        try:
            with tempfile.TemporaryDirectory(prefix="planner-") as folder:
                return self._plan(command, domain, problem, Path(folder)) + (planner,)
        except OSError as error:
            return PlannerState.CRASHED, f"{planner} cannot be started: {error}", "", planner

    def _command(self) -> Optional[PlannerCommand]:
        if not self._settings.command.strip():
            return None
        command = parse_command(expand(self._settings.command))
        if command.program_path() is not None:
            return command
        if not self._settings.fallback:
            raise PlannerCommandError(f"the planner {command.program} is not installed")
        self.warning = f"the planner {command.program} is not installed; kairos plans instead"
        return None

    def _arguments(self, command: Optional[PlannerCommand], folder: Path, limit: float) -> List[str]:
        if command is not None:
            return command.arguments(self._domain, self._problem, folder, limit)
        beside = Path(sys.executable).parent / KAIROS  # the command of our own virtual environment
        program = str(beside) if beside.exists() else shutil.which(KAIROS)
        if program is None:
            raise PlannerCommandError(
                "there is no planner: kairos needs Python 3.10 (pip install kairos-planner); "
                "set ~planner_command to another one, with DOMAIN and PROBLEM"
            )
        arguments = [program, str(self._domain), str(self._problem), "--format", "json"]
        if limit > 0:
            arguments += ["--timeout", f"{limit:g}"]
        if self._settings.anytime > 0:
            arguments += ["--no-improvement", f"{self._settings.anytime:g}"]
        else:
            arguments.append("--no-anytime")
        return arguments

    def _plan(
        self, command: Optional[PlannerCommand], domain: str, problem: str, folder: Path
    ) -> Tuple[PlannerState, str, str]:
        limit = self._settings.time_limit
        if self._settings.command.strip():
            own_limit = (command or parse_command(expand(self._settings.command))).limit
            limit = own_limit if own_limit is not None else limit
        try:
            arguments = self._arguments(command, folder, limit)
        except PlannerCommandError as error:
            return PlannerState.CRASHED, str(error), ""
        # A planner that times itself may still print its best plan; it gets a second more than it was told.
        times_itself = command is None or command.limit is not None
        process = PlannerProcess(arguments, folder, limit + 1.0 if limit > 0 and times_itself else limit)
        with self._lock:
            if self._cancelled:
                return PlannerState.CANCELLED, "cancelled before it began", ""
            self._process = process
        result = process.run()
        files = [
            (path.name, path.read_text(errors="replace"))
            for path in folder.iterdir()
            if is_plan_file(path.name)
        ]
        self._keep(result, files)
        if result.cancelled:
            return PlannerState.CANCELLED, f"cancelled after {result.seconds:.2f} s", ""
        plans = [restore_case(plan, problem) for plan in candidate_plans(result.stdout, files)]
        fault: Optional[str] = None
        if plans:
            try:
                validator = pddl_check.PlanValidator(domain, problem)
            except ValueError as error:
                return PlannerState.INVALID, str(error), ""
            for plan in plans:
                problem_found = validator.fault(plan)
                if problem_found is None:
                    return self._solved(plan)
                fault = fault or problem_found
        return self._unsolved(command, result, limit, fault) + ("",)

    def _solved(self, plan: List[PlanStep]) -> Tuple[PlannerState, str, str]:
        text = format_plan(plan)
        if self._data is not None:
            self._write("plan.pddl", text)
        length = max((step.time + step.duration for step in plan), default=0.0)
        reason = (
            f"{len(plan)} actions, {length:.1f} s" if plan else "the goals hold already: the plan is empty"
        )
        return PlannerState.SOLVED, reason, text

    def _unsolved(
        self, command: Optional[PlannerCommand], result: ProcessResult, limit: float, fault: Optional[str]
    ) -> Tuple[PlannerState, str]:
        name = command.name if command is not None else KAIROS
        if fault is not None:
            return PlannerState.INVALID, f"{name} returned a plan that is not valid: {fault}"
        killed_itself = command is not None and command.limit is not None and result.returncode in (124, 137)
        if result.timed_out or killed_itself:
            return PlannerState.TIMEOUT, f"{name} found no plan within {limit:g} s"
        if command is None and result.returncode in _KAIROS_EXIT:
            state, reason = _KAIROS_EXIT[result.returncode]
            return state, _because(reason, result.stderr)
        said = verdict(result.stdout, result.stderr, result.returncode, name)
        if said is not None:
            return said.state, f"{name}: {said.reason}"
        last = (result.stderr.strip() or result.stdout.strip()).splitlines()
        detail = f": {last[-1].strip()}" if last else ", printing nothing"
        code = result.returncode - 128 if result.returncode > 128 else -result.returncode
        if result.returncode < 0 or result.returncode > 128:
            return PlannerState.CRASHED, f"{name} was killed by signal {code}{detail}"
        if result.returncode:
            return PlannerState.CRASHED, f"{name} ended with code {result.returncode}{detail}"
        return PlannerState.CRASHED, f"{name} ended without a plan and without a reason{detail}"

    def _keep(self, result: ProcessResult, files: List[Tuple[str, str]]) -> None:
        if self._data is None:
            return
        for name, content in files:
            self._write(name, content)
        if result.stdout:
            self._write("planner.log", result.stdout)

    def _write(self, name: str, content: str) -> None:
        try:
            if self._data is not None:
                (self._data / name).write_text(content)
        except OSError as error:
            _log.warning("cannot write %s: %s", error.filename, error.strerror)
            self.warning = f"cannot write {error.filename}: {error.strerror}"


def _because(reason: str, errors: str) -> str:
    """kairos explains in a note, over several lines, that ends with the code in brackets."""
    notes = errors.split("note: ", 1)
    if len(notes) < 2:
        lines = errors.strip().splitlines()
        return f"{reason}: {lines[0]}" if lines else reason
    note = notes[1].split("\nkairos:", 1)[0]
    note = " ".join(note.rsplit(" [", 1)[0].split())
    if note.startswith("no plan: "):
        note = note[len("no plan: ") :]
    return f"{reason}: {note}"
