# SPDX-License-Identifier: Apache-2.0
"""One planning from files to an outcome, as the supervising process has it done in a child.

Reading, checking, planning and validating all happen here, so that none of it keeps a node busy.
"""

import contextlib
import dataclasses
import math
import time
from pathlib import Path
from typing import Any, Dict, List, NamedTuple, Optional, Sequence, Tuple

from merlin_pddl.analysis.deadlines import DeadlineTask, Due
from merlin_pddl.analysis.leave_out import leave_out
from merlin_pddl.analysis.shortfall import shortfall
from merlin_pddl.checks import kairos_check
from merlin_pddl.checks.kairos_check import PlanValidator
from merlin_pddl.plan_text import PlanStep, format_plan, restore_case
from merlin_pddl.text_reader import PddlError
from merlin_rosplan.planning.planner import Attempt, Planner, Task
from merlin_rosplan.planning.planner_command import parse_command
from merlin_rosplan.planning.planner_external import CommandPlanner
from merlin_rosplan.planning.planner_files import keep
from merlin_rosplan.planning.planner_kairos import KAIROS, KairosPlanner
from merlin_rosplan.planning.planner_race import Entry, PlannerRace
from merlin_rosplan.planning.planner_settings import PlannerSettings
from merlin_rosplan.planning.planning_outcome import NOT_KNOWN, PlannerState


class PlannerJob(NamedTuple):
    """What a planning needs to know; travels as JSON.

    :param domain_path, problem_path: absolute paths of the PDDL files.
    :param engines: ``kairos`` or whole command lines.
    :param name: of the engines, for messages.
    :param data_path: folder for the planner's output and the plan (``plan.pddl``); empty keeps nothing.
    :param settings: of the planner; its time limit is that of the engines.
    :param time_limit: running time for everything, reading and validating included, s; 0 means none.
    :param reusable: whether its process can plan again: not behind a search of kairos.
    """

    domain_path: str
    problem_path: str
    engines: List[str]
    name: str
    data_path: str
    settings: PlannerSettings
    time_limit: float
    reusable: bool = False

    def message(self) -> Dict[str, Any]:
        """What :func:`work` takes."""
        return {**self._asdict(), "settings": dataclasses.asdict(self.settings)}


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
            domain.write_text(_DOMAIN, encoding="utf-8")
            problem.write_text(_PROBLEM, encoding="utf-8")
            files = str(domain), str(problem)
            settings = PlannerSettings(time_limit=_WARM, memory_limit=0.0, output_limit=0.0)
            _plan(PlannerJob(*files, [engine], name, "", settings, _WARM), own)


def work(message: Dict[str, Any], folder: Path) -> Dict[str, Any]:
    """Runs a planning.

    :param message: a :class:`PlannerJob` as a mapping; further keys are left alone.
    :param folder: of this planning.
    :return: a mapping with state, reason, plan, planner, seconds, warning, and reached where goals have
        deadlines.
    """
    job = PlannerJob(**{key: message[key] for key in PlannerJob._fields})
    job = job._replace(settings=PlannerSettings(**message["settings"]))
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
    files = Path(job.domain_path), Path(job.problem_path)
    try:
        if job.settings.without:
            domain, problem = leave_out(domain, problem, job.settings.without)
            files = _written(folder, domain, problem)
        if job.settings.dues:
            return _plan_in_time(job, domain, problem, folder)
    except PddlError as error:
        return _outcome(PlannerState.INVALID, str(error), job.name)
    entry, task = _solve(job, (domain, problem), files, folder)
    if entry.attempt.state != PlannerState.SOLVED:
        return _outcome(*_why(entry.attempt, task), entry.attempt.planner)
    return _solved(job, entry.attempt.planner, entry.plan)


def _plan_in_time(job: PlannerJob, domain: str, problem: str, folder: Path) -> Dict[str, Any]:
    """Plans for goals with deadlines; where no plan is in time, once more without these.

    :raises PddlError: domain, problem or goals are not valid.
    """
    dues = [Due(tuple(goals), within) for goals, within in job.settings.dues]
    limit = job.settings.time_limit
    ends = time.monotonic() + limit
    proven = False
    endless = all(due.within == math.inf for due in dues)
    while True:
        part = folder / ("late" if proven else "in_time")
        part.mkdir()
        timed = DeadlineTask(domain, problem, dues, binding=not proven)
        texts = timed.domain, timed.problem
        entry, task = _solve(job, texts, _written(part, *texts), part)
        attempt = entry.attempt
        if attempt.state == PlannerState.SOLVED:
            steps, reached = timed.unmarked(entry.plan, PlanValidator(*texts).fault)
            if proven and any(time > due.within for due, time in zip(dues, reached)):
                outcome = _outcome(PlannerState.UNSOLVABLE, _late(dues, reached), attempt.planner)
            else:
                outcome = _solved(job, attempt.planner, restore_case(steps, problem))
            return {**outcome, "reached": reached}
        left = ends - time.monotonic() if limit else 0.0
        if proven or endless or attempt.state != PlannerState.UNSOLVABLE or left < 0.0:
            break
        job, proven = job._replace(settings=dataclasses.replace(job.settings, time_limit=left)), True
    state, reason = _why(attempt, dataclasses.replace(task, domain=domain, problem=timed.plain))
    if proven and attempt.state != PlannerState.UNSOLVABLE:
        # The first search has proved it; how late they are is what the second one has not found.
        reason = f"{_late(dues)}; without deadlines: {reason}"
        outcome = _outcome(PlannerState.UNSOLVABLE, reason, attempt.planner)
        return {**outcome, "reached": [NOT_KNOWN] * len(dues)}
    return _outcome(state, reason, attempt.planner)


def _late(dues: Sequence[Due], reached: Sequence[float] = ()) -> str:
    """That goals cannot be in time, as a sentence.

    :param reached: by a plan without the deadlines, s from its begin; empty: none is known.
    """
    texts = [
        f"{due.text} needs {time:.1f} s, its deadline is in {due.within:.1f} s"
        for due, time in zip(dues, reached)
        if time > due.within
    ] or [f"the deadline of {due.text} is in {due.within:.1f} s" for due in dues]
    return f"cannot {'all ' if len(dues) > 1 else ''}be in time: {'; '.join(texts)}"


def _written(folder: Path, domain: str, problem: str) -> Tuple[Path, Path]:
    """The files of a task that was changed."""
    files = folder / "domain_changed.pddl", folder / "problem_changed.pddl"
    for file, text in zip(files, (domain, problem)):
        file.write_text(text, encoding="utf-8")
    return files


def _solve(
    job: PlannerJob, texts: Tuple[str, str], files: Tuple[Path, Path], folder: Path
) -> Tuple[Entry, Task]:
    """Has the engines solve a task.

    :param texts, files: domain and problem.
    :param folder: of the engines.
    """
    keep_in = Path(job.data_path) if job.data_path else None
    apart = len(job.engines) > 1 and KAIROS not in job.engines  # both may write files of the same names
    planners: List[Planner] = [
        KairosPlanner()
        if engine == KAIROS
        else CommandPlanner(
            parse_command(engine), keep_in / f"engine{index}" if keep_in and apart else keep_in
        )
        for index, engine in enumerate(job.engines)
    ]
    task = Task(*files, *texts, folder, job.settings)

    def check() -> Optional[str]:
        if not job.settings.check_input:
            return None
        return kairos_check.check_input(*texts, *map(str, files))

    if job.engines == [KAIROS]:  # the check costs less than it would to begin at the same time
        fault = check()
        if fault is not None:
            return Entry(Attempt(KAIROS, PlannerState.INVALID, fault)), task
        return PlannerRace(planners, task).run(), task
    return PlannerRace(planners, task).run(check), task


def _read(path: str) -> str:
    return Path(path).read_text(encoding="utf-8", errors="replace")


def _why(attempt: Attempt, task: Task) -> Tuple[PlannerState, str]:
    """Why an engine found no plan: which condition no action can reach, else its own words.

    Such a condition is a proof also where the engine failed, as kairos does over a negative duration.
    """
    state, gave_up = attempt.state, attempt.state in (PlannerState.UNSOLVABLE, PlannerState.NO_PLAN)
    if not gave_up and state not in (PlannerState.TIMEOUT, PlannerState.CRASHED):
        return state, attempt.reason
    found, why = shortfall(task.domain, task.problem)
    if found:
        return PlannerState.UNSOLVABLE if state is PlannerState.CRASHED else state, why
    return state, f"{attempt.reason}; {why}" if why and gave_up else attempt.reason


def _solved(job: PlannerJob, planner: str, plan: Sequence[PlanStep]) -> Dict[str, Any]:
    text = format_plan(plan)
    warning = keep(Path(job.data_path) / "plan.pddl", text) if job.data_path else None
    length = max((step.time + step.duration for step in plan), default=0.0)
    reason = f"{len(plan)} actions, {length:.1f} s" if plan else "the goals hold already: the plan is empty"
    return _outcome(PlannerState.SOLVED, reason, planner, text, warning)


def _outcome(
    state: PlannerState, reason: str, planner: str, plan: str = "", warning: Optional[str] = None
) -> Dict[str, Any]:
    return {"state": int(state), "reason": reason, "planner": planner, "plan": plan, "warning": warning}
