# SPDX-License-Identifier: Apache-2.0
"""A robot on the empty floor whose drives take as long as the domain says, below a fast clock.

FACTOR: simulated s per s while the robot acts. SLOW: likewise while it waits for software; below 1 on a
machine that others use, too, as a process then has a part of a processor.
"""

import math
import os
import threading
import time
from typing import Callable, Dict, Optional, Tuple

import rospy
from merlin_msgs.msg import ExecutorStatus
from move_base_msgs.msg import MoveBaseAction, MoveBaseGoal
from rosgraph_msgs.msg import Clock

from executive.bench_together import LIMIT, Robot
from executive.floor import SPEED, TURNING, Floor
from merlin_actions.testing.behaviour import Act, Behaviour, Draw
from merlin_actions.testing.simulated_action_server import SimulatedActionServer
from merlin_executor.executor_client import ExecutorRequest
from merlin_ros.publishing import publish
from merlin_ros.work.threads import start_thread
from merlin_sm.rosplan_assistant import MerlinROSPlanAssistant

PERIOD = 0.02  # s of wall time between two messages of the clock
FACTOR, SLOW = float(os.environ.get("FACTOR", 30.0)), float(os.environ.get("SLOW", 1.0))
SETTLED = 0.5 / SLOW  # s of wall time for which the clock is slow after a request was sent or has ended
BEGIN = 1000.0  # s: the first time of the clock

Place = Tuple[float, float]


class FastClock:
    """Publishes ``/clock``, by FACTOR while the robot acts, and by SLOW while software works.

    :param busy: whether the robot waits for software now.
    """

    def __init__(self, busy: Callable[[], bool]) -> None:
        self._busy = busy
        self._publisher = rospy.Publisher("/clock", Clock, queue_size=1)
        self._slow_until = 0.0
        self._over = threading.Event()
        self._thread = start_thread("clock", self._run)

    def settle(self) -> None:
        """Is slow for a moment: something was sent, or has ended."""
        self._slow_until = time.monotonic() + SETTLED

    def stop(self) -> None:
        """Ends the clock."""
        self._over.set()
        self._thread.join()

    def _run(self) -> None:
        now, before = BEGIN, time.monotonic()
        while not self._over.wait(PERIOD):
            wall = time.monotonic()
            slow = wall < self._slow_until or self._busy()
            # A thread that did not run for long makes no leap.
            now += min(wall - before, 10.0 * PERIOD) * (SLOW if slow else FACTOR)
            before = wall
            publish(self._publisher, Clock(rospy.Time.from_sec(now)))


class Base(Behaviour):
    """A ``move_base`` that drives straight, and knows where it was stopped.

    :ivar metres: that it has driven.
    """

    def __init__(self, start: Place) -> None:
        super().__init__()
        self._lock = threading.Lock()  # guards the fields below
        self._from = self._to = start
        self._begun: Optional[float] = None  # ROS time of the drive that is under way, s
        self.metres = 0.0
        self._server = SimulatedActionServer(
            "move_base", MoveBaseAction, self, self._begin, self._halt, on_goal=self._aim
        )
        self._server.start()

    def place(self, place: Optional[Place] = None) -> Place:
        """Where it is, m; or puts it there while it stands."""
        with self._lock:
            if place is not None:
                self._from = self._to = place
            return self._at()[0]

    def driven(self) -> float:
        """Metres that it has driven until now."""
        with self._lock:
            return self.metres + self._at()[1]

    def draw(self, number: int) -> Draw:
        """The drive to the goal that came last."""
        with self._lock:
            return Draw(Act.SUCCEED, math.dist(self._from, self._to) / SPEED + TURNING)

    def _aim(self, goal: MoveBaseGoal) -> None:
        with self._lock:
            position = goal.target_pose.pose.position
            self._to = position.x, position.y

    def _begin(self) -> None:
        with self._lock:
            self._begun = rospy.get_time()

    def _halt(self) -> None:
        with self._lock:
            place, metres = self._at()
            self.metres += metres
            self._from = self._to = place
            self._begun = None

    def _at(self) -> Tuple[Place, float]:
        """The place, and the metres of the drive under way; it turns first."""
        whole = math.dist(self._from, self._to)
        if self._begun is None or not whole:
            return self._from, 0.0
        metres = min(whole, max(0.0, (rospy.get_time() - self._begun - TURNING) * SPEED))
        (x, y), (to_x, to_y) = self._from, self._to
        return (x + (to_x - x) * metres / whole, y + (to_y - y) * metres / whole), metres


class FloorRobot(Robot):
    """The launched robot with its clock and its base. ``/use_sim_time`` has to be set."""

    def __init__(self, floor: Floor) -> None:
        self.floor = floor
        self.ends: Dict[str, float] = {}  # request → ROS time of its end, s
        self.status = ExecutorStatus()
        self.base = Base(floor.place(floor.points[0]))
        self.clock = FastClock(self._software_works)
        super().__init__()
        self.knowledge = MerlinROSPlanAssistant()
        if not self.knowledge.knowledge.wait(LIMIT):
            raise RuntimeError(f"no knowledge base after {LIMIT:g} s")

    def send(self, point: str, **options: object) -> ExecutorRequest:
        """Sends an errand; the clock is slow while it is taken."""
        self.clock.settle()
        return super().send(point, **options)

    def begin(self, point: str = "", place: Optional[Place] = None) -> None:
        """Puts the robot to a point, or somewhere else on the floor, and forgets all visits."""
        facts = [*self.knowledge.facts("checked"), *self.knowledge.facts("robot_at")]
        self.knowledge.remove_facts(facts)
        self.knowledge.add_facts(f"(robot_at {point or 'anywhere'})")
        self.base.place(place or self.floor.place(point))
        with self.changed:
            self.ends.clear()

    def _note_end(self, request: ExecutorRequest) -> None:
        self.ends[request.id] = rospy.get_time()
        self.clock.settle()
        super()._note_end(request)

    def _software_works(self) -> bool:
        status = self.status
        return status.state != ExecutorStatus.IDLE and not status.running
