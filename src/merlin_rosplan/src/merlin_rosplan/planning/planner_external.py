# SPDX-License-Identifier: Apache-2.0
"""An external planner behind a command line as an engine."""

import contextlib
import signal
from pathlib import Path
from typing import List, Optional, Tuple

from merlin_pddl.plan_text import PlanStep, restore_case
from merlin_rosplan.planning.planner import Attempt, Task
from merlin_rosplan.planning.planner_command import PlannerCommand
from merlin_rosplan.planning.planner_files import keep, too_much
from merlin_rosplan.planning.planner_output import candidate_plans, is_plan_file, verdict
from merlin_rosplan.planning.planner_process import PlannerProcess, ProcessResult
from merlin_rosplan.planning.planning_outcome import PlannerState

# A planner that times itself may still print its best plan; it gets this much more than its limit, s.
PRINTING = 1.0


class CommandPlanner:
    """Plans with a command.

    :param command: the planner and how it is called.
    :param keep: folder that gets what the planner printed and wrote; None keeps nothing.
    """

    def __init__(self, command: PlannerCommand, keep: Optional[Path] = None) -> None:
        self.name = command.name
        self._command = command
        self._keep_in = keep
        self._process = PlannerProcess()

    def stop(self) -> None:
        """Kills the planner and its process group; a plan that it has left by then counts."""
        self._process.stop()

    def begin(self, task: Task) -> None:
        """Starts the command."""
        limit = self._limit(task)
        allowed = limit + PRINTING if limit > 0 and self._command.limit is not None else limit
        arguments = self._command.arguments(task.domain_path, task.problem_path, task.folder)
        self._process.start(arguments, task.folder, allowed)

    def _limit(self, task: Task) -> float:
        return task.settings.time_limit if self._command.limit is None else self._command.limit

    def plan(self, task: Task) -> Attempt:
        """Waits for the command and reads what it left behind."""
        limit, result = self._limit(task), self._process.wait()
        excess = too_much(task.folder, task.settings.output_limit)
        if excess is not None:
            return Attempt(self.name, PlannerState.CRASHED, f"{self.name} was ended: {excess}")
        files = [
            (path.name, path.read_text(encoding="utf-8", errors="replace"))
            for path in task.folder.iterdir()
            if is_plan_file(path.name)
        ]
        self._keep(result, files)
        plans: List[List[PlanStep]] = [
            restore_case(plan, task.problem) for plan in candidate_plans(result.stdout, files)
        ]
        if plans:
            return Attempt(self.name, PlannerState.SOLVED, "", plans)
        return Attempt(self.name, *self._without_plan(result, limit, task.settings.memory_limit))

    def _without_plan(
        self, result: ProcessResult, limit: float, memory_limit: float
    ) -> Tuple[PlannerState, str]:
        name = self.name
        if result.stopped:
            return PlannerState.TIMEOUT, f"{name} was stopped before it found a plan"
        killed_itself = self._command.limit is not None and result.returncode in (124, 137)
        if result.timed_out or killed_itself:
            return PlannerState.TIMEOUT, f"{name} found no plan within {limit:g} s"
        said = verdict(result.stdout, result.stderr, result.returncode, name)
        if said is not None:
            reason = f"{name}: {said.reason}"
            if "memory" in said.reason.lower() and memory_limit:
                reason += f" (~memory_limit is {memory_limit:g} MB)"
            return said.state, reason
        last = (result.stderr.strip() or result.stdout.strip()).splitlines()
        detail = f": {last[-1].strip()[:300]}" if last else ", printing nothing"
        code = result.returncode - 128 if result.returncode > 128 else -result.returncode
        if result.returncode < 0 or result.returncode > 128:
            return PlannerState.CRASHED, f"{name} was killed by {_signal_name(code)}{detail}"
        if result.returncode:
            return PlannerState.CRASHED, f"{name} ended with code {result.returncode}{detail}"
        return PlannerState.CRASHED, f"{name} ended without a plan and without a reason{detail}"

    def _keep(self, result: ProcessResult, files: List[Tuple[str, str]]) -> None:
        if self._keep_in is None:
            return
        for name, content in files:
            keep(self._keep_in / name, content)
        if result.stdout:
            keep(self._keep_in / "planner.log", result.stdout)


def _signal_name(number: int) -> str:
    with contextlib.suppress(ValueError):
        return f"signal {number} ({signal.Signals(number).name})"
    return f"signal {number}"
