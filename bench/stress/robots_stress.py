# SPDX-License-Identifier: Apache-2.0
"""Sends goals to several robots, cancels them and lets robots come and go, at random moments.

When all is idle, what the robots were seen to do has to fit the knowledge; see :class:`.RobotsRecord`.
"""

import os
import random
import signal
import threading
import time
from collections import Counter
from typing import Callable, Dict, List, Sequence, Set

import rospy
from actionlib_msgs.msg import GoalStatus, GoalStatusArray
from geometry_msgs.msg import Twist
from merlin_msgs.msg import DispatchStatus, ExecutorStatus, KnowledgeChanges, RobotHost
from merlin_msgs.srv import ListExecutions
from move_base_msgs.msg import MoveBaseActionGoal, MoveBaseActionResult
from std_srvs.srv import SetBool

from merlin_executor.executor_client import ExecutorRequest, MerlinExecutorClient, outcome_name
from merlin_ros.actions.peers import connected_peers
from merlin_sm.rosplan_assistant import MerlinROSPlanAssistant
from merlin_sm.states.navigation import POINTS_PARAM
from merlin_test.process_signals import strike
from stress.process_usage import pid_of
from stress.robots_record import ANYWHERE, RobotsRecord
from stress.stress_cycles import Cycle, Violation, arguments_of, draw, places_of, twice

LIMIT = 60.0  # s for anything to happen; exceeding it is a violation
DISPATCHER = "rosplan_plan_dispatcher"
UNGREETED = "unknown"  # rospy's name of a publisher whose connection is being made


class RobotsStress:
    """Several robots of one plan under stress, with the domain of ``pddl/robots``. Needs an initialised node.

    :param robots: names; their hosts run on this machine and are started again when they die.
    :param places: to visit.
    :param seed: of what is done; when it happens depends on the machine too.
    :param longest: s of wall time between two events of a cycle at the most.
    :param always_cancel: for robots whose drives do not end by themselves.
    """

    def __init__(
        self,
        robots: Sequence[str],
        places: Sequence[str],
        seed: int = 0,
        longest: float = 2.0,
        always_cancel: bool = False,
    ) -> None:
        self._robots, self._places = list(robots), list(places)
        self._random = random.Random(seed)
        self._longest, self._always = longest, always_cancel
        self._changed = threading.Condition()  # guards the fields down to _idle
        self._happenings = 0
        self._lives: Dict[str, str] = {}  # of the hosts
        self._killed: Set[str] = set()
        self._record = RobotsRecord(robots)
        self._idle = False
        self.done: Counter[str] = Counter()
        """Counts of events and outcomes."""
        self._knowledge = MerlinROSPlanAssistant()
        self._executions = rospy.ServiceProxy("rosplan_knowledge_base/executions", ListExecutions)
        self._client = MerlinExecutorClient()
        rospy.Subscriber("rosplan_knowledge_base/changes", KnowledgeChanges, self._note_change)
        rospy.Subscriber("rosplan_knowledge_base/robots", RobotHost, self._note_host)
        if not (self._client.wait_for_executor(LIMIT) and self._knowledge.knowledge.wait(LIMIT)):
            raise Violation(f"no executor, or no knowledge base, after {LIMIT:g} s")
        self._until("robots that are there", self._missing)
        self._follow()
        # What was before is not known.
        where = [fact for fact in self._knowledge.facts("robot_at") if fact.split()[1] in robots]
        self._knowledge.change_facts([f"(robot_at {robot} {ANYWHERE})" for robot in robots], where)

    def _follow(self) -> None:
        """Subscribes to everything that shows what the robots do."""
        points = {robot: rospy.get_param(f"{robot}/{POINTS_PARAM}") for robot in self._robots}
        self._points = {
            robot: {(point["x"], point["y"]): name for name, point in of_robot.items()}
            for robot, of_robot in points.items()
        }
        subscribers = [
            rospy.Subscriber("merlin/status", ExecutorStatus, self._note_status, tcp_nodelay=True),
            rospy.Subscriber(
                f"{DISPATCHER}/dispatch_status", DispatchStatus, self._note_running, tcp_nodelay=True
            ),
        ]
        for robot in self._robots:
            for topic, kind, callback in (
                ("cmd_vel", Twist, self._note_velocity),
                ("move_base/goal", MoveBaseActionGoal, self._note_goal),
                ("move_base/status", GoalStatusArray, self._note_driving),
                ("move_base/result", MoveBaseActionResult, self._note_result),
            ):
                subscribers.append(
                    rospy.Subscriber(f"{robot}/{topic}", kind, callback, robot, tcp_nodelay=True)
                )
        # A drive of which nothing is seen would contradict the knowledge.
        end = time.monotonic() + LIMIT
        while not all(connected_peers(subscriber) - {UNGREETED} for subscriber in subscribers):
            if time.monotonic() > end:
                raise Violation(f"not all topics of the robots have publishers after {LIMIT:g} s")
            time.sleep(0.01)

    def run(self, cycles: int, progress: Callable[[int], None] = lambda number: None) -> None:
        """Runs cycles.

        :raises Violation: at the first thing that must not happen.
        """
        for number in range(cycles):
            cycle = draw(self._random, self._robots, self._places, self._longest)
            try:
                self._run(cycle._replace(cancel=cycle.cancel or self._always))
            except Violation as violation:
                raise Violation(f"cycle {number}, {cycle}: {violation}") from violation
            progress(number)

    # --- one cycle

    def _run(self, cycle: Cycle) -> None:
        with self._changed:
            self._record.begin()
        self._knowledge.remove_facts(self._knowledge.facts("visited"))
        request = self._client.send(f"(and {' '.join(f'(visited {place})' for place in cycle.goals)})")
        time.sleep(cycle.pauses[0])
        back = self._let_leave(cycle)
        time.sleep(cycle.pauses[1])
        self._look_at_executions()
        if cycle.cancel:
            request.cancel()
            self.done["cancel"] += 1
        else:
            back()  # without robots a plan may not be there
        self._wait_for_end(request, cycle.goals)
        self._until("an idle executor", lambda: [] if self._idle else ["it is busy"])
        self._until("the end of everything", lambda: self._record.restless)
        with self._changed:
            killed = cycle.how == "kill"
            struck = killed or (cycle.how == "stop" and cycle.cancel)  # that one hangs still
            self._record.rest(rospy.get_time(), cycle.victim if struck else "", killed)
        back()
        self._check()

    def _let_leave(self, cycle: Cycle) -> Callable[[], None]:
        """Makes a robot leave; returns a function that brings it back (after a kill, its launch does)."""
        if cycle.how:
            self.done[cycle.how] += 1
        if cycle.how == "out":
            available = rospy.ServiceProxy(f"{cycle.victim}/merlin/available", SetBool)
            available(False)
            return lambda: self._take_in(available)
        if cycle.how == "kill":
            with self._changed:
                self._killed.add(self._lives[cycle.victim])
        if cycle.how:
            host = pid_of(f"/{cycle.victim}/merlin_fsm_host")
            strike(host, signal.SIGKILL if cycle.how == "kill" else signal.SIGSTOP)
            if cycle.how == "stop":
                return lambda: os.kill(host, signal.SIGCONT)
        return lambda: None

    @staticmethod
    def _take_in(available: rospy.ServiceProxy) -> None:
        available(True)

    def _wait_for_end(self, request: ExecutorRequest, goals: Sequence[str]) -> None:
        if not request.wait(LIMIT) or request.result is None:
            raise Violation(f"a request has not ended after {LIMIT:g} s")
        outcome = outcome_name(request.result.outcome)
        self.done[outcome] += 1
        if outcome == "SUCCEEDED" and not set(goals) <= set(self._visited()):
            raise Violation(f"a request has succeeded, and visited are only {self._visited()}")

    # --- what has to hold

    def _look_at_executions(self) -> None:
        robots = [execution.parameters[0].value for execution in self._executions("").executions]
        doubled = twice(robots)
        if doubled:
            raise Violation(f"two executions are open on {', '.join(doubled)}")

    def _check(self) -> None:
        """Everything is as the knowledge says, and the robots come back."""
        self._until("the truth", self._contradictions)
        self._until("robots that are back", self._missing)
        # A host that continues may have sent a goal, and taken it back.
        self._until("the end of everything", lambda: [*self._record.restless, *self._contradictions()])
        with self._changed:
            wrong = [*self._record.wrong, *self._record.restless]
        if wrong:
            raise Violation("; ".join(wrong))

    def _contradictions(self) -> List[str]:
        positions = places_of(self._knowledge.facts("robot_at"))
        visited = self._visited()
        found = [f"{execution.operator_name} is open" for execution in self._executions("").executions]
        found += [f"the goal {goal} is left" for goal in self._knowledge.goals()]
        with self._changed:
            return [*found, *self._record.contradictions(positions, visited)]

    def _visited(self) -> List[str]:
        return arguments_of(self._knowledge.facts("visited"))

    def _missing(self) -> List[str]:
        """Robots that take no actions as the knowledge says, or whose host was killed and is not back."""
        there = set(arguments_of(self._knowledge.facts("available")))
        with self._changed:
            there &= {robot for robot, life in self._lives.items() if life not in self._killed}
        return sorted(set(self._robots) - there)

    def _until(self, what: str, lacks: Callable[[], Sequence[str]]) -> None:
        """Waits until nothing is lacking; looks after each message, without the lock."""
        end = time.monotonic() + LIMIT
        seen = -1
        lacking: Sequence[str] = [what]
        while lacking:
            if not self._wait_for_more(seen, end):
                raise Violation(f"waited {LIMIT:g} s for {what}: {'; '.join(lacking)}")
            seen = self._happenings
            lacking = lacks()

    def _wait_for_more(self, seen: int, end: float) -> bool:
        with self._changed:
            left = end - time.monotonic()
            return left > 0.0 and self._changed.wait_for(lambda: self._happenings != seen, left)

    def _happened(self) -> None:
        with self._changed:
            self._happenings += 1
            self._changed.notify_all()

    # --- what is seen

    def _note_status(self, status: ExecutorStatus) -> None:
        with self._changed:
            self._idle = status.state == ExecutorStatus.IDLE
            self._happened()

    def _note_change(self, _: KnowledgeChanges) -> None:
        self._happened()

    def _note_host(self, word: RobotHost) -> None:
        with self._changed:
            self._lives[word.robot] = word.life
            self._happened()

    def _note_running(self, status: DispatchStatus) -> None:
        actions = [
            [action.name, *(parameter.value for parameter in action.parameters)] for action in status.running
        ]
        with self._changed:
            self._record.running(actions)
            self._happened()

    def _note_velocity(self, velocity: Twist, robot: str) -> None:
        with self._changed:
            self._record.moved(robot, velocity != Twist())
            self._happened()

    def _note_goal(self, goal: MoveBaseActionGoal, robot: str) -> None:
        position = goal.goal.target_pose.pose.position
        place = self._points[robot].get((position.x, position.y), "")
        with self._changed:
            self._record.sent(robot, goal.goal_id.id, place, goal.goal_id.stamp.to_sec())
            self._happened()

    def _note_driving(self, statuses: GoalStatusArray, robot: str) -> None:
        active = (GoalStatus.ACTIVE, GoalStatus.PREEMPTING)
        with self._changed:
            goals = [entry.goal_id.id for entry in statuses.status_list if entry.status in active]
            self._record.carries_out(robot, goals)
            self._happened()

    def _note_result(self, result: MoveBaseActionResult, robot: str) -> None:
        with self._changed:
            succeeded = result.status.status == GoalStatus.SUCCEEDED
            self._record.ended(robot, result.status.goal_id.id, succeeded)
            self._happened()
