# SPDX-License-Identifier: Apache-2.0
"""kairos as an engine, in the process that plans."""

import os
import threading
import time
from typing import Any, List, Optional

from merlin_pddl.checks.kairos_check import PlanValidator, load, rejected
from merlin_pddl.plan_text import NO_DURATION, PlanStep, restore_case
from merlin_pddl.text_reader import PddlError
from merlin_rosplan.planning.metric_goal import MetricGoal
from merlin_rosplan.planning.plan_shortcuts import PlanShortcuts, has_detours
from merlin_rosplan.planning.planner import Attempt, Task
from merlin_rosplan.planning.planner_settings import PlannerSettings
from merlin_rosplan.planning.planning_outcome import PlannerState

Plan = List[PlanStep]

KAIROS = "kairos"
MISSING = (
    "there is no planner: kairos needs Python 3.10 (pip install kairos-planner); "
    "install popf or lpg, or set ~planner_command to another one, with DOMAIN and PROBLEM"
)
_DAY = 86400.0  # s
_LOOK = 60.0  # s, for kairos' sake: plans and the end of a search wake the wait by themselves
_THREADS = 4  # more bring nothing for the problems of a robot

# kairos' status → how it ended; a status that is not here is an error of kairos.
_ENDED = {
    "UNSOLVABLE": (PlannerState.UNSOLVABLE, "the problem has no plan"),
    "NO_PLAN_FOUND": (
        PlannerState.NO_PLAN,
        "the search ended without a plan; this is not a proof that there is none",
    ),
    "TIMEOUT": (PlannerState.TIMEOUT, "kairos found no plan within the time limit"),
    "CANCELLED": (PlannerState.TIMEOUT, "kairos was stopped before it found a plan"),
    "INVALID_INPUT": (PlannerState.INVALID, "kairos does not accept the input"),
    "UNSUPPORTED": (PlannerState.CRASHED, "kairos does not support a feature of the task"),
    "GROUNDING_TOO_LARGE": (PlannerState.CRASHED, "the task is too large for kairos when grounded"),
    "OUT_OF_MEMORY": (PlannerState.CRASHED, "kairos ran out of memory"),
}


class KairosPlanner:
    """Plans with kairos."""

    name = KAIROS

    def __init__(self) -> None:
        self._lock = threading.Lock()  # guards the two fields below
        self._stopped = False
        self._search: Optional[Any] = None
        self._log: List[str] = []  # errors of kairos

    def stop(self) -> None:
        """Ends the search; the best plan so far counts."""
        with self._lock:
            self._stopped = True
            search = self._search
        if search is not None:
            search.stop()

    def begin(self, task: Task) -> None:
        """Nothing: it works in this process."""

    def plan(self, task: Task) -> Attempt:
        """Plans in this thread; an attempt without a plan says why."""
        kairos = load()
        if kairos is None:
            return Attempt(KAIROS, PlannerState.CRASHED, MISSING)
        try:
            domain = kairos.parse_domain(task.domain, str(task.domain_path))
            problem = kairos.parse_problem(task.problem, domain, str(task.problem_path))
        except kairos.PddlError as error:
            return Attempt(KAIROS, PlannerState.INVALID, str(error).splitlines()[0])
        settings = task.settings
        began = time.monotonic()
        search = self._start(kairos, problem, settings, settings.time_limit, settings.anytime)
        if search is None:
            return Attempt(KAIROS, *_ENDED["CANCELLED"])
        plan = _best_plan(search)
        if plan is not None:
            first = _steps(plan)
            if not settings.anytime:
                return Attempt(KAIROS, PlannerState.SOLVED, "", [first])
            left = settings.time_limit - (time.monotonic() - began) if settings.time_limit else _DAY
            seconds = min(left, settings.anytime)
            goal = MetricGoal.of(task.problem)
            if goal is None:
                better = self._direct(task, first, seconds)
            else:
                better = self._improved(kairos, domain, task, goal, first, seconds)
            return Attempt(KAIROS, PlannerState.SOLVED, "", [better, first])
        result = search.wait()
        name = result.status.name
        state, reason = _ENDED.get(name, (PlannerState.CRASHED, f"internal error of kairos ({name})"))
        if name == "TIMEOUT":  # kairos adds the same, and options that only its own command has
            return Attempt(KAIROS, state, f"kairos found no plan within {settings.time_limit:g} s")
        why = rejected(self._log) or _why([entry.message for entry in result.diagnostics])
        return Attempt(KAIROS, state, f"{reason}: {why}" if why else reason)

    def _start(
        self, kairos: Any, problem: Any, settings: PlannerSettings, limit: float, anytime: float
    ) -> Optional[Any]:
        """A search; None when it was stopped before it began."""
        log = self._log  # what is called back must not keep this planner
        options = {
            # kairos knows no search without an end; a day is more than a robot waits.
            "timeout": limit or _DAY,
            "anytime": anytime > 0,
            "stop_after_no_improvement": anytime or None,
            "memory_limit_mb": int(settings.memory_limit),
            "threads": min(_THREADS, os.cpu_count() or 1),
            "log_level": kairos.LogLevel.ERROR,
            "on_log": lambda level, channel, text: log.append(text),
        }
        with self._lock:
            if self._stopped:
                return None
            self._search = kairos.Planner().start(problem, **options)
            return self._search

    def _direct(self, task: Task, plan: Plan, seconds: float) -> Plan:
        """A plan without the detours that are found in some seconds; the plan itself where it has none."""
        end = time.monotonic() + seconds
        if not has_detours(plan):
            return plan
        try:
            shortcuts = PlanShortcuts(task.domain, task.problem, PlanValidator(task.domain, task.problem))
        except (ValueError, PddlError):  # the readers are stricter than kairos
            return plan
        return shortcuts.taken(
            restore_case(plan, task.problem), lambda: not self._stopped and time.monotonic() < end
        )

    def _improved(
        self, kairos: Any, domain: Any, task: Task, goal: MetricGoal, best: Plan, seconds: float
    ) -> Plan:
        """The best plan found by asking again and again for a better metric, which no search here follows.

        Each success is followed by a longer stride, a failure by the shortest one, whose failure ends it.
        """
        sign = -1.0 if goal.maximize else 1.0
        validator = PlanValidator(task.domain, task.problem)
        value = validator.quality(best).metric
        end = time.monotonic() + seconds
        stride = 0.0
        while value is not None:
            left = end - time.monotonic()
            if left <= 0:
                break
            try:
                wanted = kairos.parse_problem(goal.better_than(sign * value, stride), domain)
            except kairos.PddlError:
                break
            search = self._start(kairos, wanted, task.settings, left / 2 if stride else left, 0.0)
            plan = _best_plan(search) if search is not None else None
            steps = restore_case(_steps(plan), task.problem) if plan is not None else None
            if steps is not None and validator.fault(steps) is None:
                before, best, value = value, steps, validator.quality(steps).metric
                stride = 2.0 * (before - value) if value is not None else 0.0
            elif stride and search is not None:
                stride = 0.0
            else:
                break
        return best


def _best_plan(search: Any) -> Optional[Any]:
    """Waits for the end of a search: its last plan, which is its best.

    ``wait()`` would look for the end every 5 ms, which is more than most searches take.
    """
    best = None
    while True:
        plan = search.next_plan(_LOOK)
        if plan is not None:
            best = plan
        elif not search.running():
            return search.next_plan(0.0) or best


def _steps(plan: Any) -> List[PlanStep]:
    # An action without duration has the duration 0 in kairos.
    return [
        PlanStep(float(step.time), step.name, tuple(step.args), step.duration or NO_DURATION)
        for step in plan.steps
    ]


def _why(messages: List[str]) -> str:
    """What kairos tried, in one line; hints that do not speak of the missing plan are left out."""
    texts = [" ".join(message.split()) for message in messages]
    decisive = [text for text in texts if text.startswith("no plan")] or texts
    return "; ".join(text[len("no plan: ") :] if text.startswith("no plan: ") else text for text in decisive)
