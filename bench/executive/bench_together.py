# SPDX-License-Identifier: Apache-2.0
"""Requests that join, leave and interrupt a plan for twenty, while its first drive goes on.

ANYTIME: s that the planner looks for a better plan; 0.2 by default, as `robot.launch` has it.
"""

import os
import random
import tempfile
import threading
import time
from pathlib import Path
from typing import Any, Callable, Dict, List, Optional

import rospy
from actionlib_msgs.msg import GoalID
from geometry_msgs.msg import Twist
from measuring.figures import figure
from measuring.ros_process import RosMaster
from merlin_msgs.msg import ExecutorStatus
from rosplan_dispatch_msgs.msg import ActionDispatch

from executive.floor import Floor
from merlin_executor.executor_client import ExecutorRequest, MerlinExecutorClient
from merlin_planning.dispatch_progress import CANCEL_ACTION

JOINED = 20
POINTS = JOINED + 4
ROUNDS = 20
DRIVE = 600.0  # s: no drive ends by itself
LIMIT = 60.0  # s for anything to happen


class Robot:
    """What a launched robot does, with the times of its messages. Needs an initialised node."""

    def __init__(self) -> None:
        self.client = MerlinExecutorClient()
        self.changed = threading.Condition()  # guards the fields below
        self.status = ExecutorStatus()
        self.cancels = 0  # cancels of drives
        self.dispatched: List[ActionDispatch] = []
        self.halted = True
        self._ended: List[str] = []
        for topic, kind, receive in (
            ("merlin/status", ExecutorStatus, self._receive_status),
            ("cmd_vel", Twist, self._receive_velocity),
            ("rosplan_plan_dispatcher/action_dispatch", ActionDispatch, self._receive_dispatch),
            ("move_base/cancel", GoalID, self._receive_cancel),
        ):
            rospy.Subscriber(topic, kind, receive, tcp_nodelay=True)
        if not self.client.wait_for_executor(LIMIT):
            raise RuntimeError(f"no Executor after {LIMIT:g} s")
        self.wait("an idle Executor", self.idle)

    def send(self, point: str, **options: Any) -> ExecutorRequest:
        """Sends an errand."""
        return self.client.send(f"(checked {point})", on_done=self._note_end, **options)

    def idle(self) -> bool:
        """Whether the Executor does nothing; with the lock held, as all that is waited for."""
        return self.status.header.seq > 0 and self.status.state == ExecutorStatus.IDLE

    def ended(self, *requests: ExecutorRequest) -> bool:
        """Whether these requests have ended."""
        return {each.id for each in requests} <= set(self._ended)

    @property
    def running(self) -> List[str]:
        """The ids of the requests of the plan that is carried out; empty while nothing is under way."""
        status = self.status
        return [status.request, *(each.request for each in status.together)] if status.running else []

    def wait(self, what: str, holds: Callable[[], bool], begin: float = 0.0, limit: float = LIMIT) -> float:
        """Waits; returns the ms since `begin`, monotonic s.

        :raises RuntimeError: after `limit`, s.
        """
        with self.changed:
            if not self.changed.wait_for(holds, limit):
                raise RuntimeError(f"waited {limit:g} s for {what}; last status:\n{self.status}")
            return (time.monotonic() - begin) * 1e3

    def _note_end(self, request: ExecutorRequest) -> None:
        with self.changed:
            self._ended.append(request.id)
            self.changed.notify_all()

    def _receive_status(self, status: ExecutorStatus) -> None:
        with self.changed:
            self.status = status
            self.changed.notify_all()

    def _receive_velocity(self, velocity: Twist) -> None:
        with self.changed:
            self.halted = velocity == Twist()
            self.changed.notify_all()

    def _receive_dispatch(self, action: ActionDispatch) -> None:
        with self.changed:
            if action.name != CANCEL_ACTION:
                self.dispatched.append(action)
                self.changed.notify_all()

    def _receive_cancel(self, _: GoalID) -> None:
        with self.changed:
            self.cancels += 1


class Rounds:
    """Times of joining, leaving, interrupting and cancelling, ms."""

    def __init__(self, robot: Robot, points: List[str]) -> None:
        self._robot, self._points = robot, points
        self._random = random.Random(1)
        alike = ("preempt_to_urgent_ms", "cancel_to_stop_ms", "cancel_to_idle_ms")
        names = ("join_20th_ms", "leave_ms", *alike, *(f"alone_{name}" for name in alike))
        self.times: Dict[str, List[float]] = {name: [] for name in names}
        self.cancelled_drives = {"join": 0, "leave": 0}

    def round(self, number: int) -> None:
        """19 run, one joins, one leaves, and joins again; at times one interrupts; all are cancelled.

        Then the same with one that is alone, on the same floor.
        """
        robot = self._robot
        *points, urgent_point = self._random.sample(self._points, JOINED + 1)
        requests = {point: robot.send(point) for point in points[1:]}
        self._wait_running(requests)
        requests[points[0]] = self._join(points[0], requests)
        driven_for = robot.status.running[0].parameters[-1].value
        leaver = next(point for point in points if point != driven_for)
        leaving = requests.pop(leaver)
        cancels, begin = robot.cancels, time.monotonic()
        leaving.cancel()
        self.times["leave_ms"].append(robot.wait("its end", lambda: robot.ended(leaving), begin))
        self._wait_running(requests)
        self.cancelled_drives["leave"] += robot.cancels - cancels
        requests[leaver] = self._join(leaver, requests)
        self._stop(requests, urgent_point if number % 2 else "", "")
        alone = {points[0]: robot.send(points[0])}
        self._wait_running(alone)
        self._stop(alone, urgent_point if number % 2 else "", "alone_")

    def _stop(self, requests: Dict[str, ExecutorRequest], urgent_point: str, how: str) -> None:
        """Interrupts these, and cancels all."""
        robot = self._robot
        if urgent_point:
            self._interrupt(urgent_point, how)
            self._wait_running(requests)
        begin = time.monotonic()
        robot.client.cancel_all()
        self.times[f"{how}cancel_to_stop_ms"].append(robot.wait("zero", lambda: robot.halted, begin))
        self.times[f"{how}cancel_to_idle_ms"].append(robot.wait("an idle Executor", robot.idle, begin))
        robot.wait("the end of all", lambda: robot.ended(*requests.values()))

    def _wait_running(self, requests: Dict[str, ExecutorRequest]) -> None:
        """Until the plan of just these is under way, and the robot drives."""
        robot = self._robot
        ids = {each.id for each in requests.values()}
        robot.wait("the plan", lambda: set(robot.running) == ids and not robot.halted)

    def _join(self, point: str, requests: Dict[str, ExecutorRequest]) -> ExecutorRequest:
        robot = self._robot
        cancels, begin = robot.cancels, time.monotonic()
        newcomer = robot.send(point)
        self.times["join_20th_ms"].append(
            robot.wait("a newcomer", lambda: newcomer.id in robot.running, begin)
        )
        self._wait_running({**requests, point: newcomer})
        self.cancelled_drives["join"] += robot.cancels - cancels
        return newcomer

    def _interrupt(self, point: str, how: str) -> None:
        robot = self._robot
        with robot.changed:
            robot.dispatched.clear()
        begin = time.monotonic()
        urgent = robot.send(point, priority=1)
        self.times[f"{how}preempt_to_urgent_ms"].append(
            robot.wait("the urgent one", lambda: bool(robot.dispatched), begin)
        )
        urgent.cancel()
        robot.wait("its end", lambda: robot.ended(urgent))


def measure(rounds: Optional[int] = None) -> Dict[str, Any]:
    """The figures of :class:`Rounds`."""
    floor = Floor(POINTS)
    with tempfile.TemporaryDirectory(prefix="merlin_bench_") as folder, RosMaster() as master:
        floor.write(Path(folder))
        anytime = os.environ.get("ANYTIME", "0.2")
        launch = Path(__file__).with_name("together.launch")
        master.launch(launch, folder=folder, drive_duration=DRIVE, anytime=anytime)
        rospy.init_node("bench_together", disable_signals=True)
        measured = Rounds(Robot(), floor.points)
        for number in range(rounds or ROUNDS):
            measured.round(number)
            print({name: round(times[-1]) for name, times in measured.times.items() if times}, flush=True)
        rospy.signal_shutdown("done")
    figures: Dict[str, Any] = {name: figure(times) for name, times in measured.times.items() if times}
    figures["cancelled_drives"] = measured.cancelled_drives
    return {"together": figures}
