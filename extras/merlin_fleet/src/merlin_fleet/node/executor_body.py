# SPDX-License-Identifier: Apache-2.0
"""The body of a robot in a fleet: its own Executor does the goals, its own planner estimates their cost."""

import threading
from typing import TYPE_CHECKING, Callable, Dict, Optional, Tuple

import rospy

from merlin_executor.core.standstill import Halt
from merlin_executor.executor_client import MerlinExecutorClient, outcome_name
from merlin_executor.executor_request import ExecutorRequest
from merlin_fleet.core.records import Goal
from merlin_fleet.fleet_client import ACHIEVED
from merlin_fleet.fleet_robot import Stopped

if TYPE_CHECKING:
    from merlin_fleet.node.planned_cost import PlannedCost

#: s before the end of the stop time at which the base is halted: what is left for the guard.
HALT_TIME = 0.5
PATIENCE = 10.0  # s for an Executor to answer, before a robot says that it does not
NO_EXECUTOR = "its Executor does not answer"


class _Execution:
    """A goal that runs."""

    def __init__(self, ended: Stopped) -> None:
        self.ended = ended
        self.request: Optional[ExecutorRequest] = None
        self.alarm: Optional[threading.Timer] = None


class ExecutorBody:
    """Executes goals of a fleet with the robot's own Executor.

    The Executor checks them as it checks local ones, and cancels them when this node dies.

    :param client: of the Executor; with CANCEL for a client that is lost.
    :param costs: of goals.
    :param halt: has the guard hold the base.
    :param stop_time: s from a cancel until nothing of a goal may move any more.
    :param priority: of goals of the fleet; local ones with a higher one interrupt them.
    :param unfit: why the robot takes nothing at present; empty: it does.
    """

    def __init__(
        self,
        client: MerlinExecutorClient,
        costs: "PlannedCost",
        halt: Callable[[], Halt],
        stop_time: float,
        priority: int = 0,
        unfit: Callable[[], str] = lambda: "",
    ) -> None:
        self._client = client
        self._costs = costs
        self._halt = halt
        self._patience = max(0.0, stop_time - HALT_TIME)
        self._priority = priority
        self._unfit = unfit
        self._lock = threading.Lock()  # guards the field below
        self._running: Dict[str, _Execution] = {}

    def cost(self, goal: Goal, behind: Tuple[Goal, ...]) -> Tuple[Optional[float], str]:
        """What a goal costs, s; None, and why it cannot be done."""
        unfit = self._unfit() or ("" if self._there() else NO_EXECUTOR)
        return (None, unfit) if unfit else self._costs.cost(goal, behind)

    def _there(self) -> bool:
        """Whether the Executor answers; one that has just been started is waited for."""
        return self._client.executor_alive or self._client.wait_for_executor(PATIENCE)

    def begin(self, goal: Goal, ended: Stopped) -> None:
        """Sends a goal to the Executor."""
        execution = _Execution(ended)
        with self._lock:
            self._running[goal.id] = execution
        try:
            execution.request = self._client.send(
                list(goal.goals),
                priority=self._priority,
                on_done=lambda request: self._done(goal.id, request),
            )
        except Exception as error:  # whatever a goal does, the robot's part in the fleet continues
            self._end(goal.id, False, "REFUSED", f"the Executor was not asked: {error}")

    def stop(self, goal: str, reason: str) -> None:
        """Cancels a goal; the Executor's answer is its end. The guard stops what does not end in time."""
        with self._lock:
            execution = self._running.get(goal)
            if execution is None or execution.request is None or execution.alarm is not None:
                return
            execution.alarm = threading.Timer(self._patience, self._overrun, (goal, reason))
            execution.alarm.name = "fleet stop"
            execution.alarm.daemon = True
            execution.alarm.start()
        execution.request.cancel()

    def _overrun(self, goal: str, reason: str) -> None:
        with self._lock:
            if goal not in self._running:
                return
        rospy.logerr(
            f"{goal} has not ended {self._patience:g} s after its cancel ({reason}); {self._halt().words}"
        )

    def _done(self, goal: str, request: ExecutorRequest) -> None:
        result = request.result
        assert result is not None
        outcome = outcome_name(result.outcome)
        self._end(goal, outcome in ACHIEVED, outcome, result.reason)

    def _end(self, goal: str, achieved: bool, outcome: str, reason: str) -> None:
        with self._lock:
            execution = self._running.pop(goal, None)
        if execution is None:
            return
        if execution.alarm is not None:
            execution.alarm.cancel()
        execution.ended(achieved, outcome, reason)
