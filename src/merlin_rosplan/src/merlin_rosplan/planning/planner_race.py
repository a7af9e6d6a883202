# SPDX-License-Identifier: Apache-2.0
"""One or two engines on one task at a time; the best plan that validates wins."""

import contextlib
import dataclasses
import threading
import time
from dataclasses import dataclass
from typing import Callable, Collection, Dict, List, Optional, Sequence

from merlin_pddl.checks.kairos_check import PlanQuality, PlanValidator
from merlin_pddl.plan_text import PlanStep
from merlin_ros.work.threads import log_failure, start_thread
from merlin_rosplan.planning.planner import Attempt, Planner, Task
from merlin_rosplan.planning.planning_outcome import PlannerState

# Of engines that found no plan, the first state of this list is reported: certain ones first.
_TOLD_FIRST = (
    PlannerState.UNSOLVABLE,
    PlannerState.NO_PLAN,
    PlannerState.TIMEOUT,
    PlannerState.INVALID,
    PlannerState.CRASHED,
)


@dataclass(frozen=True)
class Entry:
    """An engine's attempt, judged.

    :param attempt: how it ended; SOLVED only with a plan that validated.
    :param plan: that plan.
    :param quality: of the plan.
    """

    attempt: Attempt
    plan: List[PlanStep] = dataclasses.field(default_factory=list)
    quality: Optional[PlanQuality] = None


class PlannerRace:
    """Runs engines, each in a folder of its own, and in a thread where there are several.

    When one has a plan that validates, the others may continue for ``anytime`` s; when one has proved that
    there is no plan, they are stopped at once.

    :param planners: the engines.
    :param task: for all of them.
    """

    def __init__(self, planners: Sequence[Planner], task: Task) -> None:
        self._planners = list(planners)
        self._task = task
        self._changed = threading.Condition()  # guards the field below
        self._entries: Dict[int, Entry] = {}  # by index of the engine: two may have the same name
        self._judging = threading.Lock()  # held while a plan is validated, and guards the field below
        self._validator: Optional[PlanValidator] = None

    def run(self, check: Optional[Callable[[], Optional[str]]] = None) -> Entry:
        """Runs them to the end; `check` looks at the input meanwhile and says what is wrong with it."""
        if len(self._planners) == 1:  # nothing to race against
            return self._run_alone(self._planners[0], check)
        threads = [
            start_thread(f"engine {planner.name}", self._run_one, planner, index)
            for index, planner in enumerate(self._planners)
        ]
        fault = check() if check is not None else None
        if fault is not None:
            self._stop_others([])
        else:
            self._wait()
        for thread in threads:
            thread.join()
        if fault is not None:
            return Entry(Attempt(self._planners[0].name, PlannerState.INVALID, fault))
        return self._best()

    def _run_alone(self, planner: Planner, check: Optional[Callable[[], Optional[str]]]) -> Entry:
        """While the engine works this thread checks the input and reads it for the validator.

        In a process that was just forked another thread costs a millisecond, and more where others wait.
        """
        faults: List[str] = []

        def meanwhile() -> None:
            fault = check() if check is not None else None
            if fault is not None:
                faults.append(fault)
                planner.stop()
            elif check is not None:
                with contextlib.suppress(ValueError):  # it is reported when a plan is there
                    self._make_validator()

        self._run_one(planner, 0, meanwhile)
        return Entry(Attempt(planner.name, PlannerState.INVALID, faults[0])) if faults else self._best()

    def _run_one(self, planner: Planner, index: int, meanwhile: Callable[[], None] = lambda: None) -> None:
        try:
            folder = self._task.folder / f"engine{index}"
            folder.mkdir()
            task = dataclasses.replace(self._task, folder=folder)
            planner.begin(task)
            meanwhile()
            attempt = planner.plan(task)
            entry = self._judge(attempt) if attempt.state == PlannerState.SOLVED else Entry(attempt)
        except MemoryError:
            reason = f"{planner.name} needs more than {self._task.settings.memory_limit:g} MB (~memory_limit)"
            entry = Entry(Attempt(planner.name, PlannerState.CRASHED, reason))
        except OSError as error:
            reason = f"{planner.name} cannot be started: {error}"
            entry = Entry(Attempt(planner.name, PlannerState.CRASHED, reason))
        except BaseException:  # the race waits for an entry of each engine
            reason = f"{planner.name} failed: {log_failure(planner.name)}"
            entry = Entry(Attempt(planner.name, PlannerState.CRASHED, reason))
        with self._changed:
            self._entries[index] = entry
            self._changed.notify_all()

    def _judge(self, attempt: Attempt) -> Entry:
        faults: List[str] = []
        with self._judging:
            try:
                validator = self._make_validator()
                for plan in attempt.plans:
                    fault = validator.fault(plan)
                    if fault is None:
                        return Entry(attempt, plan, validator.quality(plan))
                    faults.append(fault)
            except ValueError as error:
                return Entry(Attempt(attempt.planner, PlannerState.INVALID, str(error)))
        reason = f"{attempt.planner} returned a plan that is not valid: {faults[0]}"
        return Entry(Attempt(attempt.planner, PlannerState.INVALID, reason))

    def _make_validator(self) -> PlanValidator:
        if self._validator is None:
            self._validator = PlanValidator(self._task.domain, self._task.problem)
        return self._validator

    def _wait(self) -> None:
        anytime = self._task.settings.anytime
        deadline: Optional[float] = None
        with self._changed:
            while len(self._entries) < len(self._planners):
                states = {entry.attempt.state for entry in self._entries.values()}
                if PlannerState.UNSOLVABLE in states:
                    break
                if PlannerState.SOLVED in states and deadline is None:
                    deadline = time.monotonic() + anytime
                if deadline is not None and time.monotonic() >= deadline:
                    break
                self._changed.wait(None if deadline is None else max(0.0, deadline - time.monotonic()))
            ended = list(self._entries)
        self._stop_others(ended)

    def _stop_others(self, ended: Collection[int]) -> None:
        for index, planner in enumerate(self._planners):
            if index not in ended:
                planner.stop()

    def _best(self) -> Entry:
        entries = list(self._entries.values())
        solved = [entry for entry in entries if entry.attempt.state == PlannerState.SOLVED]
        if solved:
            return min(solved, key=lambda entry: entry.quality.order() if entry.quality else ())
        if len(entries) == 1:
            return entries[0]
        first = min(entries, key=lambda entry: _TOLD_FIRST.index(entry.attempt.state)).attempt
        if first.state == PlannerState.UNSOLVABLE:
            return Entry(first)
        return Entry(dataclasses.replace(first, reason="; ".join(e.attempt.reason for e in entries)))
