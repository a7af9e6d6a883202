# SPDX-License-Identifier: Apache-2.0
"""What is known about a task and a run after it: the rows of tasks.csv and runs.csv."""

from dataclasses import dataclass, field
from typing import Any, Dict, List, Optional, Tuple

from merlin_home.mission_list import MissionTask

#: A success this soon after the cancel (s of ROS time) crossed it on the way, and counts as before it.
CROSSING = 0.25

#: The columns of runs.csv that are settings of the run.
SETTINGS = ["mission", "approach", "seed", "real_time_factor", "rtf_policy", "cancel_after", "marked_share"]


@dataclass
class TaskRecord:
    """One task. Times are s of ROS time since the mission's first goal.

    :ivar task: from the list.
    :ivar start: x, y (m) and yaw (rad) of the robot when the task was sent, frame map.
    :ivar motion: speed (m/s) and turning speed (rad/s) at that moment: it may still brake for the task
        before.
    :ivar sent: when its goal was sent.
    :ivar first_dispatch: when its first action was dispatched; None: never.
    :ivar cancel_sent: when it was cancelled; None: never.
    :ivar robot_stopped: when the robot stood still after that (for a task that was not cancelled: at its
        end).
    :ivar idle: when the Executor was idle again.
    :ivar outcome: name of the outcome, as in Execute.action.
    :ivar stage: of the Executor in which it ended.
    :ivar reason: why, one sentence; empty when it succeeded.
    :ivar replans: plans beyond the first.
    :ivar distance: m.
    :ivar navigating: s in which the navigate action ran.
    :ivar speaking: s in which the ask action ran.
    :ivar disturbed: s in which the Executor worked for another client, or an operator held the base.
    :ivar oracle_time: s; None: not computed.
    :ivar oracle_distance: m.
    """

    task: MissionTask
    start: Optional[List[float]] = None
    motion: Tuple[float, float] = (0.0, 0.0)
    sent: float = 0.0
    first_dispatch: Optional[float] = None
    cancel_sent: Optional[float] = None
    robot_stopped: Optional[float] = None
    idle: float = 0.0
    outcome: str = ""
    stage: str = ""
    reason: str = ""
    replans: int = 0
    distance: float = 0.0
    navigating: float = 0.0
    speaking: float = 0.0
    disturbed: float = 0.0
    oracle_time: Optional[float] = None
    oracle_distance: Optional[float] = None

    @property
    def time(self) -> float:
        """From sending to idle without what disturbed it, s."""
        return self.idle - self.sent - self.disturbed

    @property
    def cancelled(self) -> bool:
        """Whether the task ended by its cancel."""
        return self.outcome == "CANCELLED"

    @property
    def succeeded(self) -> bool:
        """Whether its goal was reached."""
        return self.outcome == "SUCCEEDED"

    @property
    def right(self) -> bool:
        """Whether it ended as the list says; a marked task may have succeeded before its cancel."""
        if not self.task.marked:
            return self.succeeded
        in_time = self.cancel_sent is None or self.idle - self.cancel_sent <= CROSSING
        return self.cancelled or (self.succeeded and in_time)

    @property
    def deliberating(self) -> float:
        """From sending to the first action, s; the whole task when no action began."""
        return (self.idle if self.first_dispatch is None else self.first_dispatch) - self.sent

    @property
    def stopping(self) -> float:
        """From the cancel to idle, s; 0 without one."""
        return 0.0 if self.cancel_sent is None else self.idle - self.cancel_sent

    @property
    def efficiency(self) -> Optional[float]:
        """Oracle's time over the measured one."""
        return self.oracle_time / self.time if self.oracle_time is not None and self.time > 0 else None


@dataclass
class RunRecord:
    """One run of a mission.

    :ivar settings: the columns that were given: mission, approach, seed, real_time_factor, rtf_policy, …
    :ivar tasks: its tasks, in their order.
    :ivar wall: s of wall time.
    :ivar ended: `complete`, or why it ended early.
    :ivar versions: of the software that ran, one line.
    """

    settings: Dict[str, Any]
    tasks: List[TaskRecord] = field(default_factory=list)
    wall: float = 0.0
    ended: str = "complete"
    versions: str = ""

    @property
    def right(self) -> bool:
        """Whether every task ended as the list says."""
        return self.ended == "complete" and all(record.right for record in self.tasks)

    def run_row(self) -> Dict[str, Any]:
        """The row of runs.csv."""
        tasks = self.tasks
        cancelled = [record for record in tasks if record.cancelled]
        succeeded = [record for record in tasks if record.succeeded]
        return {
            **self.settings,
            "tasks": len(tasks),
            "marked": sum(record.task.marked for record in tasks),
            "cancelled": len(cancelled),
            "succeeded": len(succeeded),
            "right": sum(record.right for record in tasks),
            "time_s": sum(record.time for record in tasks),
            "distance_m": sum(record.distance for record in tasks),
            "oracle_time_s": total([record.oracle_time for record in tasks]),
            "oracle_distance_m": total([record.oracle_distance for record in tasks]),
            "efficiency": efficiency(tasks),
            "efficiency_completed": efficiency(succeeded),
            "efficiency_cancelled": efficiency(cancelled),
            "wall_s": self.wall,
            "ended": self.ended,
            "versions": self.versions,
        }

    def task_rows(self) -> List[Dict[str, Any]]:
        """The rows of tasks.csv."""
        return [self._task_row(record) for record in self.tasks]

    def _task_row(self, record: TaskRecord) -> Dict[str, Any]:
        x, y, yaw = record.start or (None, None, None)
        return {
            **{name: self.settings.get(name) for name in ("mission", "approach", "seed")},
            "task": record.task.number,
            "poi": record.task.poi,
            "marked": int(record.task.marked),
            "cancelled": int(record.cancelled),
            "outcome": record.outcome,
            "right": int(record.right),
            "sent": record.sent,
            "first_dispatch": record.first_dispatch,
            "cancel_sent": record.cancel_sent,
            "robot_stopped": record.robot_stopped,
            "idle": record.idle,
            "time_s": record.time,
            "distance_m": record.distance,
            "oracle_time_s": record.oracle_time,
            "oracle_distance_m": record.oracle_distance,
            "efficiency": record.efficiency,
            "deliberating_s": record.deliberating,
            "navigating_s": record.navigating,
            "speaking_s": record.speaking,
            "stopping_s": record.stopping,
            "disturbed_s": record.disturbed,
            "start_x": x,
            "start_y": y,
            "start_yaw": yaw,
            "start_speed": record.motion[0],
            "start_turn_rate": record.motion[1],
            "replans": record.replans,
            "stage": record.stage,
            "reason": record.reason,
        }


def total(values: List[Optional[float]]) -> Optional[float]:
    """The sum; None when one of them is not known."""
    known = [value for value in values if value is not None]
    return sum(known) if len(known) == len(values) else None


def efficiency(tasks: List[TaskRecord]) -> Optional[float]:
    """The oracle's time over the measured one, of all the tasks together; None: no tasks, or no oracle."""
    oracle, measured = total([record.oracle_time for record in tasks]), sum(record.time for record in tasks)
    return oracle / measured if oracle is not None and measured > 0 else None


_EMPTY = RunRecord(dict.fromkeys(SETTINGS), [TaskRecord(MissionTask(0, "", False))])
RUN_COLUMNS = tuple(_EMPTY.run_row())
TASK_COLUMNS = tuple(_EMPTY.task_rows()[0])
