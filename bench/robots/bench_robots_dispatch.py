# SPDX-License-Identifier: Apache-2.0
"""Ten robots in one plan: what the dispatcher needs from an end to the next start, and to stop all of them.

Real hosts, guards, bridges and Executor; the bases are simulated servers. Latencies are taken in one
process, on the monotonic clock, between messages that it receives. ACTIONS (500) drives, once of lengths
from a seed, so that they end one by one, and once all of 1 s, so that ten end together; CANCELS (100)
cancels of ten drives.
"""

import multiprocessing
import os
import tempfile
import threading
import time
from pathlib import Path
from typing import Any, Callable, Dict, List, Sequence

import rospy
from geometry_msgs.msg import Twist
from measuring.figures import figure
from measuring.ros_process import RosMaster
from rosplan_dispatch_msgs.msg import ActionDispatch, ActionFeedback
from rosplan_dispatch_msgs.srv import DispatchService, ParsingService
from std_srvs.srv import Empty

from merlin_executor.executor_client import MerlinExecutorClient
from merlin_sm.rosplan_assistant import MerlinROSPlanAssistant

ROBOTS = [f"robot{number}" for number in range(10)]
PLACES = ["kitchen", "bathroom", "dorm_room", "main_door"]  # that the points of interest name
ACTIONS = int(os.environ.get("ACTIONS", 500))
CANCELS = int(os.environ.get("CANCELS", 100))
TOGETHER = 1.0  # s of each drive
MEAN, SPREAD = 1.25, 0.375  # s; 95 % are between 0.5 and 2 s
LIMIT = 120.0  # s for anything to happen
PDDL = Path(__file__).resolve().parents[2] / "pddl" / "robots"


def problem(robots: Sequence[str]) -> str:
    """All robots, somewhere."""
    at = " ".join(f"(robot_at {robot} anywhere)" for robot in robots)
    return f"""(define (problem all) (:domain robots)
      (:objects {" ".join(robots)} - robot {" ".join(PLACES)} - place) (:init {at}) (:goal (and)))"""


def plan(drives: int, positions: Dict[str, str]) -> str:
    """Each robot drives from place to place; its next drive needs the one before, and nothing else does."""
    at, lines = dict(positions), []
    for number in range(drives):
        robot = ROBOTS[number % len(ROBOTS)]
        step = number // len(ROBOTS)
        here, at[robot] = at[robot], _next(at[robot])
        lines.append(f"{30.0 * step:.1f}: (drive {robot} {here} {at[robot]}) [30.0]\n")
    return "".join(lines)


class Robots:
    """What ten robots do, as this process hears it."""

    def __init__(self) -> None:
        self.changed = threading.Condition()  # guards the fields below
        self.moves = dict.fromkeys(ROBOTS, False)
        self.halted = dict.fromkeys(ROBOTS, 0.0)
        self.robot_of: Dict[Any, str] = {}
        self.latest: Dict[str, Any] = {}
        self.succeeded: Dict[str, float] = {}
        self.samples: List[float] = []
        rospy.Subscriber(
            "/rosplan_plan_dispatcher/action_dispatch", ActionDispatch, self._dispatched, tcp_nodelay=True
        )
        rospy.Subscriber(
            "/rosplan_plan_dispatcher/action_feedback", ActionFeedback, self._answered, tcp_nodelay=True
        )
        for robot in ROBOTS:
            rospy.Subscriber(f"/{robot}/cmd_vel", Twist, self._move, robot, tcp_nodelay=True)

    def until(self, holds: Callable[[], bool], what: str) -> None:
        """Waits until something is so."""
        with self.changed:
            if not self.changed.wait_for(holds, LIMIT):
                raise RuntimeError(f"waited {LIMIT:g} s for {what}")

    def _dispatched(self, message: ActionDispatch) -> None:
        now = time.monotonic()
        if message.name != "drive":
            return
        robot = message.parameters[0].value
        with self.changed:
            self.latest[robot] = message.plan_id, message.action_id
            self.robot_of[message.plan_id, message.action_id] = robot
            if robot in self.succeeded:
                self.samples.append((now - self.succeeded.pop(robot)) * 1e3)

    def _answered(self, message: ActionFeedback) -> None:
        now = time.monotonic()
        with self.changed:
            if message.status == ActionFeedback.ACTION_SUCCEEDED_TO_GOAL_STATE:
                action = message.plan_id, message.action_id
                robot = self.robot_of[action]
                if self.latest[robot] == action:
                    self.succeeded[robot] = now
                else:  # its next action was here before the news of this end, by another connection
                    self.samples.append(0.0)

    def _move(self, velocity: Twist, robot: str) -> None:
        with self.changed:
            moves = bool(velocity.linear.x)
            if self.moves[robot] and not moves:
                self.halted[robot] = time.monotonic()
            self.moves[robot] = moves
            self.changed.notify_all()


class Plans:
    """Has plans of our own dispatched."""

    def __init__(self, folder: Path) -> None:
        self._file = folder / "plan.pddl"
        self._knowledge = MerlinROSPlanAssistant()
        self._parse = rospy.ServiceProxy("/rosplan_parsing_interface/parse_plan_from_file", ParsingService)
        self._dispatch = rospy.ServiceProxy("/rosplan_plan_dispatcher/dispatch_plan", DispatchService)
        self._cancel = rospy.ServiceProxy("/rosplan_plan_dispatcher/cancel_dispatch", Empty, persistent=True)
        self.parse_s = 0.0
        end = time.monotonic() + LIMIT
        while len(self._knowledge.facts("available")) < len(ROBOTS):
            if time.monotonic() > end:
                raise RuntimeError(f"available are only {self._knowledge.facts('available')}")
            time.sleep(0.2)

    def positions(self) -> Dict[str, str]:
        """Where the robots are."""
        return dict(fact.strip("()").split()[1:] for fact in self._knowledge.facts("robot_at"))

    def read(self, drives: int) -> None:
        """Makes and parses a plan from where the robots are."""
        self._file.write_text(plan(drives, self.positions()))
        start = time.perf_counter()
        if not self._parse(str(self._file)).plan_parsed:
            raise RuntimeError("the plan was not parsed")
        self.parse_s = time.perf_counter() - start

    def run(self, drives: int) -> None:
        """Dispatches a plan to its end."""
        self.read(drives)
        if not self._dispatch().success:
            raise RuntimeError("the dispatch failed")

    def cancel(self, robots: Robots) -> List[float]:
        """Cancels ten drives at once, by the dispatcher's service.

        :return: ms to the end of the dispatch, and to the zero velocity of each robot.
        """
        self.read(len(ROBOTS))
        ended: List[float] = []

        def run() -> None:
            self._dispatch()
            ended.append(time.monotonic())

        thread = threading.Thread(target=run, name="dispatch", daemon=True)
        thread.start()
        robots.until(lambda: all(robots.moves.values()), "ten robots that drive")
        start = time.monotonic()
        self._cancel()
        thread.join(LIMIT)
        robots.until(lambda: not any(robots.moves.values()), "ten robots that stand")
        return [(when - start) * 1e3 for when in (*ended, *robots.halted.values())]

    def cancel_request(self, client: MerlinExecutorClient, robots: Robots) -> List[float]:
        """Cancels ten drives at once, by the Executor that has them as one goal.

        :return: ms to the answer, and to the zero velocity of each robot.
        """
        at = self.positions()
        goals = [f"(robot_at {robot} {_next(at[robot])})" for robot in ROBOTS]
        request = client.send(f"(and {' '.join(goals)})")
        robots.until(lambda: all(robots.moves.values()), "ten robots that drive")
        start = time.monotonic()
        request.cancel()
        request.wait(LIMIT)
        ended = time.monotonic()
        robots.until(lambda: not any(robots.moves.values()), "ten robots that stand")
        return [(when - start) * 1e3 for when in (ended, *robots.halted.values())]


def _next(position: str) -> str:
    return PLACES[(PLACES.index(position) + 1) % 4 if position in PLACES else 0]


def one_case(drive: float, spread: float, cancels: int) -> Dict[str, Any]:
    """Dispatches all drives, and cancels ten at a time; in a process of its own, as rospy begins once.

    :param drive, spread: mean length of a drive and its standard deviation, s.
    """
    with tempfile.TemporaryDirectory(prefix="merlin_bench_") as name, RosMaster() as master:
        folder = Path(name)
        (folder / "problem.pddl").write_text(problem(ROBOTS))
        master.launch(
            Path(__file__).with_name("robot_servers.launch"),
            robots=",".join(ROBOTS),
            domain=PDDL / "domain.pddl",
            problem=folder / "problem.pddl",
            drive=drive,
            spread=spread,
        )
        for robot in ROBOTS:
            master.wait_for_service(f"/{robot}/merlin/available")
        rospy.init_node("bench_robots_dispatch", anonymous=True, disable_signals=True)
        robots, plans = Robots(), Plans(folder)
        plans.run(len(ROBOTS))  # until every connection has been made once
        with robots.changed:
            robots.samples.clear()
            robots.succeeded.clear()
        start = time.perf_counter()
        plans.run(ACTIONS)
        seconds = time.perf_counter() - start
        with robots.changed:
            samples = list(robots.samples)
        figures = {
            "parse_s": round(plans.parse_s, 3),
            "dispatch_s": round(seconds, 1),
            "succeeded_to_dispatch_ms": figure(samples),
        }
        if cancels:
            figures.update(_cancels(plans, robots, cancels))
        rospy.signal_shutdown("done")
    return figures


def _cancels(plans: Plans, robots: Robots, number: int) -> Dict[str, Any]:
    cancels = [plans.cancel(robots) for _ in range(number)]
    client = MerlinExecutorClient()
    client.wait_for_executor(LIMIT)
    requests = [plans.cancel_request(client, robots) for _ in range(number)]
    return {
        "cancel_dispatch_ms": figure([ended for ended, *_ in cancels]),
        "cancel_dispatch_to_all_stopped_ms": figure([max(stops) for _, *stops in cancels]),
        "cancel_to_all_stopped_ms": figure([max(stops) for _, *stops in requests]),
        "cancel_to_idle_ms": figure([ended for ended, *_ in requests]),
    }


def measure() -> Dict[str, Any]:
    """All figures."""
    spawn = multiprocessing.get_context("spawn")
    with spawn.Pool(1, maxtasksperchild=1) as pool:
        ordinary = pool.apply(one_case, (MEAN, SPREAD, 0))
        together = pool.apply(one_case, (TOGETHER, 0.0, CANCELS))  # a short drive would end before its cancel
    same = {name: value for name, value in together.items() if name.startswith("cancel")}
    ends = {f"together_{name}": value for name, value in together.items() if name not in same}
    return {"robots_dispatch": {"robots": len(ROBOTS), "actions": ACTIONS, **ordinary, **ends, **same}}
