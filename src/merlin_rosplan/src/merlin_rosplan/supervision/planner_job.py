# SPDX-License-Identifier: Apache-2.0
"""One planning from files to an outcome, as the supervising process has it done in a child.

Reading, checking, planning and validating all happen here, so that none of it keeps a node busy.
"""

import contextlib
import time
from pathlib import Path
from typing import Any, Dict, List, NamedTuple, Optional

from merlin_pddl.analysis.leave_out import leave_out
from merlin_pddl.analysis.shortfall import shortfall
from merlin_pddl.checks import kairos_check
from merlin_pddl.plan_text import format_plan
from merlin_pddl.text_reader import PddlError
from merlin_rosplan.planning.planner import Attempt, Planner, Task
from merlin_rosplan.planning.planner_command import parse_command
from merlin_rosplan.planning.planner_external import CommandPlanner
from merlin_rosplan.planning.planner_files import keep
from merlin_rosplan.planning.planner_kairos import KAIROS, KairosPlanner
from merlin_rosplan.planning.planner_race import Entry, PlannerRace
from merlin_rosplan.planning.planner_settings import PlannerSettings
from merlin_rosplan.planning.planning_outcome import PlannerState


class PlannerJob(NamedTuple):
    """What a planning needs to know; travels as JSON.

    :param domain_path, problem_path: absolute paths of the PDDL files.
    :param engines: ``kairos`` or whole command lines.
    :param name: of the engines, for messages.
    :param data_path: folder for the planner's output and the plan (``plan.pddl``); empty keeps nothing.
    :param planning_limit: running time for the engines, s; 0 means none.
    :param time_limit: running time for everything, reading and validating included, s; 0 means none.
    :param anytime, check_input, memory_limit, output_limit, without: see :class:`.planner.PlannerSettings`.
    :param reusable: whether its process can plan again: it cannot behind a search of kairos.
    """

    domain_path: str
    problem_path: str
    engines: List[str]
    name: str
    data_path: str
    planning_limit: float
    time_limit: float
    anytime: float
    check_input: bool
    memory_limit: float
    output_limit: float
    without: List[str]
    reusable: bool = False


_DOMAIN = """(define (domain warm) (:requirements :typing :durative-actions) (:types t)
  (:predicates (p ?x - t))
  (:durative-action a :parameters (?x - t) :duration (= ?duration 1) :condition ()
    :effect (at end (p ?x))))"""
_PLAN = "0.000: (a o) [1.000]"
_WARM = 10.0  # s for planning that
_PROBLEM = "(define (problem warm) (:domain warm) (:objects o - t) (:init) (:goal (p o)))"


def warm_up(folder: Path, last: Dict[str, Any]) -> None:
    """Plans once with each kind of engine that the last planning had, or with both.

    A forked process pays for each page that it touches first, and for the memory of each thread.

    :param folder: of the planning that follows.
    :param last: the message of the last planning; empty: there was none.
    """
    kinds = {engine == KAIROS for engine in last.get("engines", (KAIROS, ""))}
    with contextlib.suppress(OSError):  # the planning itself tells of a full disk
        for kind in kinds:
            engine, name = (KAIROS, "warm_kairos") if kind else (f"echo '{_PLAN}'", "warm_command")
            own = folder / name
            own.mkdir()
            domain, problem = own / "domain.pddl", own / "problem.pddl"
            domain.write_text(_DOMAIN)
            problem.write_text(_PROBLEM)
            files = str(domain), str(problem)
            _plan(PlannerJob(*files, [engine], name, "", _WARM, _WARM, 0.2, True, 0.0, 0.0, []), own)


def work(message: Dict[str, Any], folder: Path) -> Dict[str, Any]:
    """Runs a planning.

    :param message: a :class:`PlannerJob` as a mapping; further keys are left alone.
    :param folder: of this planning.
    :return: a mapping with state, reason, plan, planner, seconds, warning.
    """
    job = PlannerJob(**{key: message[key] for key in PlannerJob._fields})
    began = time.monotonic()
    outcome = _plan(job, folder)
    return {**outcome, "seconds": time.monotonic() - began}


def _plan(job: PlannerJob, folder: Path) -> Dict[str, Any]:
    try:
        domain = _read(job.domain_path)
        problem = _read(job.problem_path)
    except OSError as error:
        reason = f"cannot read {error.filename}: {error.strerror}"
        return _outcome(PlannerState.INVALID, reason, job.name)
    domain_path, problem_path = Path(job.domain_path), Path(job.problem_path)
    if job.without:
        try:
            domain, problem = leave_out(domain, problem, job.without)
        except PddlError as error:
            return _outcome(PlannerState.INVALID, str(error), job.name)
        domain_path, problem_path = folder / "domain_without.pddl", folder / "problem_without.pddl"
        domain_path.write_text(domain)
        problem_path.write_text(problem)
    keep_in = Path(job.data_path) if job.data_path else None
    planners: List[Planner] = [
        KairosPlanner() if engine == KAIROS else CommandPlanner(parse_command(engine), keep_in)
        for engine in job.engines
    ]
    settings = PlannerSettings(
        time_limit=job.planning_limit,
        anytime=job.anytime,
        memory_limit=job.memory_limit,
        output_limit=job.output_limit,
    )
    task = Task(domain_path, problem_path, domain, problem, folder, settings)

    def check() -> Optional[str]:
        if not job.check_input:
            return None
        return kairos_check.check_input(domain, problem, str(domain_path), str(problem_path))

    if job.engines == [KAIROS]:  # the check costs less than it would to begin at the same time
        fault = check()
        if fault is not None:
            return _outcome(PlannerState.INVALID, fault, KAIROS)
        return _answer_of(PlannerRace(planners, task).run(), keep_in, task)
    return _answer_of(PlannerRace(planners, task).run(check), keep_in, task)


def _read(path: str) -> str:
    return Path(path).read_text(errors="replace")


def _why(attempt: Attempt, task: Task) -> str:
    """Why an engine found no plan: which condition no action can reach, else its own words."""
    if attempt.state not in (PlannerState.UNSOLVABLE, PlannerState.NO_PLAN, PlannerState.TIMEOUT):
        return attempt.reason
    found, why = shortfall(task.domain, task.problem)
    if not why or (attempt.state is PlannerState.TIMEOUT and not found):
        return attempt.reason
    return why if found else f"{attempt.reason}; {why}"


def _answer_of(entry: Entry, keep_in: Optional[Path], task: Task) -> Dict[str, Any]:
    attempt = entry.attempt
    if attempt.state != PlannerState.SOLVED:
        return _outcome(attempt.state, _why(attempt, task), attempt.planner)
    text = format_plan(entry.plan)
    warning = keep(keep_in / "plan.pddl", text) if keep_in is not None else None
    length = max((step.time + step.duration for step in entry.plan), default=0.0)
    reason = (
        f"{len(entry.plan)} actions, {length:.1f} s"
        if entry.plan
        else "the goals hold already: the plan is empty"
    )
    return _outcome(PlannerState.SOLVED, reason, attempt.planner, text, warning)


def _outcome(
    state: PlannerState, reason: str, planner: str, plan: str = "", warning: Optional[str] = None
) -> Dict[str, Any]:
    return {"state": int(state), "reason": reason, "planner": planner, "plan": plan, "warning": warning}
