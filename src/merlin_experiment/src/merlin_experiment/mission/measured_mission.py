# SPDX-License-Identifier: Apache-2.0
"""The Goal Dispatcher of the home: sends the tasks of a mission one after the other, and keeps the times.

Without ROS: what the mission needs of the robot is in ``executor_robot``.
"""

import threading
from typing import TYPE_CHECKING, Callable, List, NamedTuple, Optional, Sequence, Tuple

from merlin_experiment.records.task_record import TaskRecord
from merlin_home.mission_list import MissionTask

if TYPE_CHECKING:
    from merlin_experiment.mission.executor_robot import ExecutorRobot, SentRequest

#: By how much the clocks of two nodes may differ in a simulation, s: they learn of the time by messages.
CLOCK_TICK = 0.05

#: Time after the next task's first action in which a standstill still belongs to the task before, s.
BRAKING = 1.0


class RequestEnding(NamedTuple):
    """How a request ended.

    :ivar name: as in Execute.action: SUCCEEDED, CANCELLED, …
    :ivar stage: of the Executor in which it ended.
    :ivar reason: a sentence; empty after a success.
    :ivar replans: how often its plan was replaced.
    """

    name: str
    stage: str
    reason: str
    replans: int


class MissionStopped(Exception):
    """The mission cannot continue; the text says why."""


class MeasuredMission:
    """One run through a list of tasks.

    :ivar records: of the tasks done so far, and of the one under way.
    :ivar start: ROS time of the first goal, s; the times of the records count from it.
    """

    def __init__(
        self,
        tasks: Sequence[MissionTask],
        robot: "ExecutorRobot",
        cancel_after: float,
        before_cancel: Tuple[float, Callable[[], None]] = (0.0, lambda: None),
        on_change: Callable[[TaskRecord], None] = lambda record: None,
        wait_turn: Callable[[Callable[[], bool]], None] = lambda stopped: None,
    ) -> None:
        """:param tasks: the list.
        :param robot: what carries them out.
        :param cancel_after: s of ROS time between sending and cancelling a marked task.
        :param before_cancel: seconds before the cancel, and what to do then.
        :param on_change: called when a task begins, is cancelled and has ended.
        :param wait_turn: called before each task; a paused mission waits in it. Its argument is a function
            that returns whether the mission was stopped.
        """
        self.records: List[TaskRecord] = []
        self.start: Optional[float] = None
        self._tasks = list(tasks)
        self._robot = robot
        self._cancel_after = cancel_after
        self._before_cancel = before_cancel
        self._on_change = on_change
        self._wait_turn = wait_turn
        self._lock = threading.Lock()  # guards _request and the cancel_sent of the record under way
        self._request: Optional[SentRequest] = None
        self._stopped = False

    def run(self) -> List[TaskRecord]:
        """Carries the tasks out; returns their records.

        :raises MissionStopped: `stop` was called, or the robot is gone.
        """
        for task in self._tasks:
            self._wait_turn(lambda: self._stopped)
            if self._stopped:
                raise MissionStopped("interrupted")
            self._robot.forget(task.poi)
            record = TaskRecord(task)
            try:
                self._carry_out(record)
            except Exception:
                if record in self.records:
                    self.records.remove(record)  # half a task is not data
                raise
        return self.records

    def stop(self) -> None:
        """Cancels the task under way and sends no more; from any thread."""
        with self._lock:
            self._stopped = True
            if self._request is not None:
                self._request.cancel()

    def _carry_out(self, record: TaskRecord) -> None:
        robot, task = self._robot, record.task
        here = robot.trajectory.last()
        if here is not None:
            record.start = [here.x, here.y, here.yaw]
            record.motion = (here.speed, here.turn_rate)
        sent = robot.now()
        if self.start is None:
            self.start = sent
        record.sent = sent - self.start
        self.records.append(record)
        with self._lock:
            if self._stopped:
                raise MissionStopped("interrupted")
            request = self._request = robot.send(task.poi)
        self._on_change(record)
        calls = []
        if task.marked:
            ahead, prepare = self._before_cancel
            if 0.0 < ahead < self._cancel_after:
                calls.append(robot.call_after(self._cancel_after - ahead, prepare))
            calls.append(robot.call_after(self._cancel_after, lambda: self._cancel(record, request)))
        try:
            outcome = request.wait()
        finally:
            with self._lock:
                self._request = None
            for prevent in calls:
                prevent()
        if self._stopped:
            raise MissionStopped("interrupted")
        robot.wait_idle()
        record.idle = robot.now() - self.start
        record.outcome, record.stage = outcome.name, outcome.stage
        record.reason, record.replans = outcome.reason, outcome.replans
        self._measure(record)
        self._on_change(record)

    def _cancel(self, record: TaskRecord, request: "SentRequest") -> None:
        assert self.start is not None
        with self._lock:
            if self._request is not request:
                return  # it ended in this very moment
            record.cancel_sent = self._robot.now() - self.start
            request.cancel()
        self._on_change(record)

    def _measure(self, record: TaskRecord) -> None:
        assert self.start is not None
        start, track = self.start, self._robot.trajectory
        sent, idle = start + record.sent, start + record.idle
        record.disturbed = self._robot.disturbed(sent, idle)
        record.distance = track.distance(sent, idle)
        actions = self._robot.action_times(sent - CLOCK_TICK)
        if actions:
            record.first_dispatch = max(sent, min(begin for _, begin, _ in actions)) - start
        for operator, begin, end in actions:
            span = max(0.0, min(end, idle) - max(begin, sent))
            if operator == "navigate":
                record.navigating += span
            elif operator == "ask":
                record.speaking += span

    def measure_stops(self) -> None:
        """Fills in when the robot stood still; call it when the last stop is in the trajectory.

        A robot that is sent on before it stands has no such moment.
        """
        for index, record in enumerate(self.records):
            assert self.start is not None
            since = record.idle if record.cancel_sent is None else record.cancel_sent
            until = float("inf")
            if index + 1 < len(self.records):
                following = self.records[index + 1]
                until = (following.first_dispatch or following.idle) + BRAKING
            stopped = self._robot.trajectory.standstill_after(self.start + since)
            if stopped is not None and stopped - self.start <= until:
                record.robot_stopped = stopped - self.start
