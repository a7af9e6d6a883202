# SPDX-License-Identifier: Apache-2.0
"""The home with one robot and with two, on the same lists: total time, way, and the least possible time.

The tasks of a list are sent two at a time, as one goal, and the next two when both are done; with
TOGETHER=1 all at once, each as a request of its own, so that one visit serves all tasks of a point. No task
is cancelled. SEEDS (3) lists of TASKS (6) tasks, from the same start each, at real-time factor RTF (2). The
bound is that of `robots.shared_tasks`, from where the robots were when something was sent.
"""

import math
import multiprocessing
import os
import threading
from pathlib import Path
from typing import Any, Dict, List, Tuple

import rospy
from measuring.ros_process import RosMaster
from merlin_msgs.msg import KnowledgeChanges
from nav_msgs.msg import Odometry

from merlin_executor.executor_client import MerlinExecutorClient, outcome_name
from merlin_experiment.mission.speech_length import speech_length
from merlin_experiment.oracle.motion_limits import MotionLimits
from merlin_experiment.oracle.oracle import Oracle
from merlin_experiment.oracle.outlines import outlines_of_world
from merlin_experiment.oracle.shortest_path import ShortestPaths
from merlin_home.mission_list import make_mission
from merlin_sim.world.world_file import load_world
from merlin_sm.rosplan_assistant import MerlinROSPlanAssistant
from robots.shared_tasks import SharedTasks, Stand

PDDL = Path(__file__).resolve().parents[2] / "pddl" / "home"
LAUNCH = Path(__file__).with_name("robots_home.launch")
WORLD = Path(__file__).resolve().parents[2] / "src" / "merlin_sim" / "worlds" / "apartment.yaml"
ROBOTS = ("ann", "bob")
START = 120.0  # s of wall time for the robots to be ready
LONGEST = 900.0  # s of wall time for a goal


class Truth:
    """Where a robot is and how far it has driven, as the simulator knows it."""

    def __init__(self, robot: str) -> None:
        self.way = 0.0
        self._stand = Stand(0.0, 0.0, 0.0)
        self._known = threading.Event()
        rospy.Subscriber(f"/{robot}/ground_truth", Odometry, self._receive, tcp_nodelay=True)

    @property
    def stand(self) -> Stand:
        """Where it is.

        :raises RuntimeError: nothing comes from the simulator.
        """
        if not self._known.wait(START):
            raise RuntimeError("the simulator does not say where the robots are")
        return self._stand

    def _receive(self, message: Odometry) -> None:
        at, turn = message.pose.pose.position, message.pose.pose.orientation
        here = Stand(at.x, at.y, 2.0 * math.atan2(turn.z, turn.w))
        if self._known.is_set():
            self.way += math.dist(here[:2], self._stand[:2])
        self._stand = here
        self._known.set()


def one_list(robots: Tuple[str, ...], seed: int, tasks: int, factor: float, together: bool) -> Dict[str, Any]:
    """Does one list; runs in a process of its own, because rospy begins once in each."""
    world = load_world(WORLD)
    points = {name: (point.x, point.y) for name, point in world.points_of_interest.items()}
    limits = MotionLimits()
    paths = ShortestPaths(outlines_of_world(world), limits.radius)
    shared = SharedTasks(Oracle(paths, limits, speech_length(), goal_tolerance=0.1), paths)
    listed = [task.poi for task in make_mission(list(points), tasks, seed, 0.0)]
    with RosMaster() as master:
        master.launch(LAUNCH, robots=",".join(robots), rtf=factor, seed=seed)
        master.wait_for_service(f"/{robots[-1]}/merlin/available")  # by then the clock is the simulator's
        rospy.init_node("bench_robots_home", disable_signals=True)
        client, knowledge = MerlinExecutorClient(), MerlinROSPlanAssistant()
        if not client.wait_for_executor(START):
            raise RuntimeError(f"no Executor:\n{master.output('launch')}")
        truths = [Truth(robot) for robot in robots]
        if not _come(knowledge, robots):
            raise RuntimeError(f"{', '.join(robots)} do not come:\n{master.output('launch')}")
        time, bound = 0.0, 0.0
        step = tasks if together else 2
        for number in range(0, tasks, step):
            part = listed[number : number + step]
            facts = [f"(checked {name})" for name in part]
            knowledge.remove_facts(facts)
            places = [points[name] for name in dict.fromkeys(part)]
            bound += shared.time([truth.stand for truth in truths], places)
            began = rospy.get_time()
            goals = facts if together else [f"(and {' '.join(facts)})"]
            for request in [client.send(goal) for goal in goals]:
                result = request.result if request.wait(LONGEST) else None
                if result is None or outcome_name(result.outcome) not in ("SUCCEEDED", "ALREADY_TRUE"):
                    raise RuntimeError(f"{part}: {result.reason if result else 'no end'}")
            time += rospy.get_time() - began
            done = f"{number + len(part)} of {tasks} tasks"
            print(f"{len(robots)} robots, list {seed}, {done}: {time:.1f} s", flush=True)
        ways: List[float] = [round(truth.way, 1) for truth in truths]
        rospy.signal_shutdown("done")
    return {"time_s": round(time, 1), "bound_s": round(bound, 1), "way_m": ways}


def _come(knowledge: MerlinROSPlanAssistant, robots: Tuple[str, ...]) -> bool:
    """Waits until all robots take actions; False when they do not in time."""
    changed = threading.Condition()

    def wake(_: KnowledgeChanges) -> None:
        with changed:
            changed.notify_all()

    rospy.Subscriber("rosplan_knowledge_base/changes", KnowledgeChanges, wake)
    wanted = " ".join(f"(available {robot})" for robot in robots)
    with changed:
        return changed.wait_for(lambda: knowledge.holds(f"(and {wanted})"), START)


def measure() -> Dict[str, Any]:
    """All lists, with one robot and with two."""
    seeds, tasks = int(os.environ.get("SEEDS", 3)), int(os.environ.get("TASKS", 6))
    factor, together = float(os.environ.get("RTF", 2)), os.environ.get("TOGETHER") == "1"
    spawn = multiprocessing.get_context("spawn")
    results: Dict[str, Any] = {}
    for seed in range(1, seeds + 1):
        for robots in (ROBOTS[:1], ROBOTS):
            with spawn.Pool(1) as pool:
                results[f"list {seed}, {len(robots)}"] = pool.apply(
                    one_list, (robots, seed, tasks, factor, together)
                )
    return {"robots_home": results}
