# SPDX-License-Identifier: Apache-2.0
"""Sends goals, cancels and interrupts them at random moments, and checks what must hold when all is idle.

Latencies are taken in this one process on the monotonic clock: from the call that cancels to the message that
shows the effect.
"""

import random
import threading
import time
from typing import Callable, List, Optional, Sequence, Tuple

import rospy
from actionlib_msgs.msg import GoalStatus, GoalStatusArray
from geometry_msgs.msg import Point, Twist
from merlin_msgs.msg import ExecutorStatus
from nav_msgs.msg import Odometry
from rosplan_dispatch_msgs.msg import ActionDispatch

from merlin_executor.executor_client import ExecutorRequest, MerlinExecutorClient
from merlin_planning.dispatch_progress import CANCEL_ACTION
from merlin_sm.rosplan_assistant import MerlinROSPlanAssistant
from merlin_sm.states.navigation import POINTS_PARAM
from stress.idle_rules import IdleRobot, violations
from stress.stress_cycles import CycleTimes, Violation

LIMIT = 60.0  # s for anything to happen; exceeding it is a violation


class CancelStress:
    """One robot under stress. Needs an initialised node.

    :param goals: PDDL goals to choose from; each is made false again before it is sent.
    :param seed: of the choices.
    :param position: predicate of which exactly one fact has to hold when idle.
    :param longest: s of ROS time between sending and cancelling at the most.
    """

    def __init__(
        self, goals: Sequence[str], seed: int = 0, position: str = "robot_at", longest: float = 3.0
    ) -> None:
        self._goals = list(goals)
        self._random = random.Random(seed)
        self._position = position
        self._longest = longest
        self._client = MerlinExecutorClient()
        self._knowledge = MerlinROSPlanAssistant()
        self._changed = threading.Condition()  # guards the fields below
        self._status: Optional[ExecutorStatus] = None
        self._driving = False
        self._halted_at = 0.0
        self._idle_at = 0.0
        self._dispatched_at = 0.0
        self._navigation: List[int] = []
        self._place: Optional[Point] = None
        self.times: List[CycleTimes] = []
        for topic, message_class, callback in (
            ("merlin/status", ExecutorStatus, self._receive_status),
            ("cmd_vel", Twist, self._receive_velocity),
            ("ground_truth", Odometry, self._receive_place),
            ("rosplan_plan_dispatcher/action_dispatch", ActionDispatch, self._receive_dispatch),
            ("move_base/status", GoalStatusArray, self._receive_navigation),
        ):
            rospy.Subscriber(topic, message_class, callback, tcp_nodelay=True)
        if not self._client.wait_for_executor(LIMIT):
            raise Violation(f"no executor after {LIMIT:g} s")
        self._wait("an idle executor", self._idle)
        self._given = self._knowledge.goals()  # those of the problem

    def run(self, cycles: int, progress: Callable[[int], None] = lambda number: None) -> List[CycleTimes]:
        """Runs cycles.

        :raises Violation: at the first thing that must not happen.
        """
        for number in range(cycles):
            try:
                self.times.append(self._cycle())
                self._check()
            except Violation as violation:
                raise Violation(f"cycle {number}: {violation}") from violation
            progress(number)
        return self.times

    def _cycle(self) -> CycleTimes:
        goal = self._random.choice(self._goals)
        self._knowledge.remove_facts(goal)
        sent_at = time.monotonic()
        request = self._client.send(goal)
        self._pause()
        with self._changed:
            dispatch = (self._dispatched_at - sent_at) * 1e3 if self._dispatched_at >= sent_at else None
        urgent_ms = None
        requests = [request]
        if self._random.random() < 0.2:
            urgent, urgent_ms = self._interrupt(goal)
            requests.append(urgent)
        with self._changed:
            driving, stage = self._driving, self._status.stage if self._status else ""
            begin = time.monotonic()
        for sent in requests:
            sent.cancel()
            if self._random.random() < 0.2:
                sent.cancel()
        for sent in requests:
            self._wait_for_end(sent)
        self._wait("an idle executor", self._idle)
        if driving:
            self._wait("a zero velocity command", lambda: self._halted_at >= begin)
        with self._changed:
            stop = (self._halted_at - begin) * 1e3 if driving else None
            idle = (self._idle_at - begin) * 1e3 if self._idle_at >= begin else None
        return CycleTimes(stop, idle, dispatch, urgent_ms, stage)

    def _interrupt(self, present: str) -> Tuple[ExecutorRequest, Optional[float]]:
        others = [goal for goal in self._goals if goal != present] or self._goals
        goal = self._random.choice(others)
        self._knowledge.remove_facts(goal)
        begin = time.monotonic()
        urgent = self._client.send(goal, priority=1)
        self._wait("the urgent request's first action", lambda: self._dispatched_at >= begin or urgent.done)
        with self._changed:
            dispatched = self._dispatched_at
        return urgent, (dispatched - begin) * 1e3 if dispatched >= begin else None

    def _pause(self) -> None:
        """Half of the cancels come while the Executor plans, half while the robot moves."""
        short = self._random.random() < 0.5
        self._let_pass(self._random.uniform(0.0, 0.1 if short else self._longest))

    @staticmethod
    def _let_pass(duration: float) -> None:  # s of ROS time
        if duration > 0.002:
            over = threading.Event()
            timer = rospy.Timer(rospy.Duration(duration), lambda _: over.set(), oneshot=True)
            over.wait(LIMIT)
            timer.shutdown()

    @staticmethod
    def _wait_for_end(request: ExecutorRequest) -> None:
        if not request.wait(LIMIT):
            raise Violation(f"a cancelled request has not ended after {LIMIT:g} s")

    def _check(self) -> None:
        self._wait("the end of all navigation goals", lambda: not self._navigation)
        # The last velocity may come behind the status and the result, which have connections of their own.
        self._wait("a zero velocity command", lambda: not self._driving)
        points = rospy.get_param(POINTS_PARAM, {})
        goals = [goal for goal in self._knowledge.goals() if goal not in self._given]
        positions = self._knowledge.facts(self._position)
        with self._changed:
            robot = IdleRobot(
                goals,
                positions,
                (self._place.x, self._place.y) if self._place is not None else None,
                {name: (point["x"], point["y"]) for name, point in points.items()},
                self._driving,
            )
        for violation in violations(robot, self._position):
            raise Violation(violation)

    def _idle(self) -> bool:
        return self._status is not None and self._status.state == ExecutorStatus.IDLE

    def _wait(self, what: str, holds: Callable[[], bool]) -> None:
        with self._changed:
            if not self._changed.wait_for(holds, LIMIT):
                raise Violation(f"waited {LIMIT:g} s for {what}; last status:\n{self._status}")

    def _receive_status(self, status: ExecutorStatus) -> None:
        with self._changed:
            if status.state == ExecutorStatus.IDLE and not self._idle():
                self._idle_at = time.monotonic()
            self._status = status
            self._changed.notify_all()

    def _receive_velocity(self, velocity: Twist) -> None:
        with self._changed:
            moving = velocity != Twist()
            if self._driving and not moving:
                self._halted_at = time.monotonic()
            self._driving = moving
            self._changed.notify_all()

    def _receive_place(self, odometry: Odometry) -> None:
        with self._changed:
            self._place = odometry.pose.pose.position

    def _receive_dispatch(self, dispatch: ActionDispatch) -> None:
        with self._changed:
            if dispatch.name != CANCEL_ACTION and dispatch.action_id == 0:
                self._dispatched_at = time.monotonic()
                self._changed.notify_all()

    def _receive_navigation(self, statuses: GoalStatusArray) -> None:
        live = (GoalStatus.PENDING, GoalStatus.ACTIVE, GoalStatus.PREEMPTING, GoalStatus.RECALLING)
        with self._changed:
            self._navigation = [goal.status for goal in statuses.status_list if goal.status in live]
            self._changed.notify_all()
