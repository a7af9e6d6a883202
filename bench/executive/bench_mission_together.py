# SPDX-License-Identifier: Apache-2.0
"""The paper's Mission 1 in the simulator, with its tasks sent at once, against one after the other.

The lists are those of `merlin_experiment`: 6 tasks at four points, half of which are cancelled after 10 s.
One after the other each point is forgotten before its task, as there; at once, one visit serves all tasks of
a point. Metres are those of the ground truth. LISTS: how many; RTF: simulated s per s.
"""

import os
from pathlib import Path
from typing import Any, Dict, List

import rospy
from measuring.figures import figure
from measuring.ros_process import RosMaster
from merlin_msgs.msg import ExecuteResult

from executive.bench_together import Robot
from merlin_executor.executor_client import ExecutorRequest
from merlin_experiment.mission.ground_truth import GroundTruth
from merlin_experiment.records.trajectory import Trajectory
from merlin_home.mission_list import MissionTask, make_mission
from merlin_ros.ros_alarm import call_after
from merlin_sm.rosplan_assistant import MerlinROSPlanAssistant

TASKS, CANCEL_AFTER = 6, 10.0  # tasks of a list; s after sending
WALL = 600.0  # s of wall time for a request
GOOD = (ExecuteResult.SUCCEEDED, ExecuteResult.ALREADY_TRUE)


class Missions:
    """Carries out lists of tasks.

    :ivar figures: of each way, list by list.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._knowledge = MerlinROSPlanAssistant()
        self._track = Trajectory()
        self._truth = GroundTruth(self._track, lambda sample: None)
        if not self._knowledge.knowledge.wait(WALL) or not self._track.wait_until(0.0, WALL):
            raise RuntimeError(f"no knowledge base or no ground truth after {WALL:g} s")
        self.figures: Dict[str, List[float]] = {}

    def carry_out(self, seed: int) -> None:
        """One list in both ways, each from the first point.

        :raises RuntimeError: a task that is not marked does not succeed.
        """
        robot, points = self._robot, sorted(rospy.get_param("world/points_of_interest"))
        tasks = make_mission(points, TASKS, seed)
        for way in ("one after the other", "at once"):
            alone = way != "at once"
            self._wait([robot.send(points[0], alone=True)])
            self._forget()
            begin = rospy.get_time()
            sent: List[ExecutorRequest] = []
            for task in tasks:
                sent.append(self._send(task, alone))
                if alone:
                    self._wait(sent)
                    self._forget()
            self._wait(sent)
            end = rospy.get_time()
            for task, request in zip(tasks, sent):
                result = request.result
                if result is None or not (task.marked or result.outcome in GOOD):
                    raise RuntimeError(f"{way}: {task} did not succeed: {result}")
            self._forget()
            values = {"s": end - begin, "metres": self._track.distance(begin, end)}
            for name, value in values.items():
                self.figures.setdefault(f"{name} {way}", []).append(value)
            print(seed, way, {name: round(value, 1) for name, value in values.items()}, flush=True)

    def _send(self, task: MissionTask, alone: bool) -> ExecutorRequest:
        request = self._robot.send(task.poi, alone=alone)
        if task.marked:
            call_after(CANCEL_AFTER, request.cancel, "cancel")
        return request

    def _wait(self, sent: List[ExecutorRequest]) -> None:
        robot = self._robot
        robot.wait("the end", lambda: robot.ended(*sent) and robot.idle(), limit=WALL)

    def _forget(self) -> None:
        self._knowledge.remove_facts(self._knowledge.facts("checked"))


def measure() -> Dict[str, Any]:
    """The figures of :class:`Missions`."""
    with RosMaster() as master:
        master.set_params({"/use_sim_time": True})
        launch = Path(__file__).with_name("apartment.launch")
        master.launch(launch, rtf=float(os.environ.get("RTF", 3.0)))
        rospy.init_node("bench_mission_together", disable_signals=True)
        missions = Missions(Robot())
        for seed in range(1, 1 + int(os.environ.get("LISTS", 5))):
            missions.carry_out(seed)
        rospy.signal_shutdown("done")
    return {"mission_together": {name: figure(values) for name, values in missions.figures.items()}}
