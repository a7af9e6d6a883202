# SPDX-License-Identifier: Apache-2.0
"""Node `mission`: runs one of the paper's missions and writes its results.

Exit code: 0 when every task ended as the list says, 1 when one did not, 2 when the mission could not begin or
continue, 130 when it was interrupted.
"""

import math
import time
from typing import Callable, Optional

import rospy
from merlin_msgs.msg import MissionStatus, SimStatus
from merlin_msgs.srv import SetRealTimeFactor
from nav_msgs.msg import OccupancyGrid

from merlin_executor.goal_check import GoalError
from merlin_executor.mission import MissionError, MissionNode, results_folder
from merlin_executor.mission.mission_node import run_mission
from merlin_executor.mission.mission_pause import MissionPause
from merlin_executor.mission.mission_reporter import MissionReporter
from merlin_executor.mission.readiness import NotReady
from merlin_experiment.mission.executor_robot import ExecutorRobot
from merlin_experiment.mission.ground_truth import GroundTruth, grid_of, receive_one
from merlin_experiment.mission.measured_mission import MeasuredMission, MissionStopped
from merlin_experiment.mission.mission_settings import MissionSettings
from merlin_experiment.mission.progress_view import ProgressView, closing_lines, ended_line, live_line
from merlin_experiment.mission.real_time_factor import ARRIVAL_AHEAD, CANCEL_AHEAD, RealTimeFactor
from merlin_experiment.records.result_files import write_run
from merlin_experiment.records.task_record import RunRecord, TaskRecord
from merlin_experiment.records.trajectory import Sample, Trajectory
from merlin_planning.knowledge_client import KnowledgeError
from merlin_ros.node import init_node
from merlin_ros.service_proxy import ServiceError, ServiceProxy

#: ROS time in which the robot comes to its last standstill, s.
AFTERWARDS = 0.5
#: Wall seconds to wait for that.
SETTLE = 2.0


class MeasuredMissionNode(MissionNode):
    """Connects a :class:`MeasuredMission` with ROS and the screen."""

    servers = ("move_base", "sound_play")

    @classmethod
    def from_parameters(cls) -> "MeasuredMissionNode":
        """Makes the mission from the parameters of the node.

        :raises ParameterError: when one has a wrong value, or the folder for the results cannot be made.
        """
        settings = MissionSettings.read()
        results_folder(settings.results)
        return cls(settings)

    def __init__(self, settings: MissionSettings) -> None:
        self._settings = settings
        self._tasks = settings.make_list()
        self._view = ProgressView()
        self.reporter = MissionReporter(f"home mission {settings.mission}", len(self._tasks))
        self._set_factor_service: Optional[ServiceProxy] = None
        self._trajectory = Trajectory()
        self._robot = ExecutorRobot(self._trajectory, self._action_starts, settings.on_lost)
        self.client = self._robot.client
        self._grid: Optional[OccupancyGrid] = None
        self._speech = 0.0  # length of the question, s; 0: not known
        self._arrives_in = 0  # number of the last task in which the robot came near its point
        self._requested, self._spoken = 1.0, 0  # what the simulator says of its factor, how often in a row
        self._factor = RealTimeFactor(
            settings.policy, settings.factor, self._set_factor, self._robot.call_after
        )
        self._mission = MeasuredMission(
            self._tasks,
            self._robot,
            settings.cancel_after,
            (CANCEL_AHEAD, self._factor.cancel_is_near),
            self._task_changed,
            self._wait_turn,
        )
        self._pause = MissionPause(self.reporter.paused)
        self._truth = GroundTruth(self._trajectory, self._watch)
        self._simulator = rospy.Subscriber("/merlin_sim/status", SimStatus, self._judge_factor)

    def wait_for_robot(self, timeout: float) -> None:
        """Waits also for the true pose and the map.

        :param timeout: of each, s of running time.
        :raises NotReady: when a part is missing.
        """
        self.reporter.report(MissionStatus.STARTING, "waiting for the robot")
        super().wait_for_robot(timeout)
        if not self._trajectory.wait_until(0.0, timeout):
            raise NotReady(f"nothing on {rospy.resolve_name('ground_truth')} after {timeout:.0f} s")
        self._grid = receive_one("/map", OccupancyGrid, timeout)
        if self._grid is None:
            raise NotReady(f"no map on /map after {timeout:.0f} s")

    def carry_out(self) -> bool:
        """Runs the mission and writes its results; True when every task ended as the list says.

        :raises MissionError: when the mission could not continue.
        """
        settings = self._settings
        rospy.on_shutdown(self._stop)
        run = RunRecord(settings.columns(), self._mission.records)
        self._view.line(self._headline())
        if settings.policy == "adaptive":
            self._speech = self._length_of_question()
        began = time.monotonic()
        try:
            if not self._factor.mission_starts():
                raise MissionStopped("the simulator does not take the real-time factor")
            with self._pause:
                self._mission.run()
        except (MissionStopped, GoalError, KnowledgeError, ServiceError) as error:
            run.ended = str(error)
        run.wall = time.monotonic() - began
        if self._mission.start is not None:
            self._write(run)
        self._report_end(run)
        if run.ended not in ("complete", "interrupted"):
            raise MissionError(run.ended)
        return run.right

    def _stop(self) -> None:
        self._mission.stop()
        self._pause.wake()
        self._robot.wake()

    def _wait_turn(self, stopped: Callable[[], bool]) -> None:
        self._pause.wait(stopped)
        self._robot.wait_free(stopped, lambda why: self._view.line(f"mission: {why}"))

    def _write(self, run: RunRecord) -> None:
        # What it imports is not wanted before: the first goal does not wait for it.
        from merlin_experiment.records.versions import versions

        start, grid = self._mission.start, None if run.ended == "interrupted" else self._grid
        assert start is not None
        if grid is not None:
            self._trajectory.wait_until(rospy.get_time() + AFTERWARDS, SETTLE)
        self._mission.measure_stops()
        run.versions = versions()
        if grid is not None:
            # matplotlib and SciPy take seconds to import: neither a start nor an interruption waits for them.
            from merlin_experiment.mission.mission_results import MissionResults

            results = MissionResults(self._settings, run)
            results.add_map(*grid_of(grid), self._trajectory.samples(start))
            lines = results.write()
        else:
            lines = closing_lines(run, write_run(self._settings.results, run).values())
        for line in lines:
            self._view.line(line)

    def _report_end(self, run: RunRecord) -> None:
        if run.right:
            self.reporter.report(MissionStatus.SUCCEEDED, "every task ended as listed")
        elif run.ended == "complete":
            wrong = sum(not record.right for record in run.tasks)
            self.reporter.report(MissionStatus.FAILED, f"{wrong} of {len(run.tasks)} tasks not as listed")
        elif run.ended == "interrupted":
            self.reporter.report(MissionStatus.CANCELLED, run.ended)
        else:
            self.reporter.report(MissionStatus.FAILED, run.ended)

    def _headline(self) -> str:
        settings = self._settings
        marked = sum(task.marked for task in self._tasks)
        return (
            f"Mission {settings.mission} ({settings.approach}, seed {settings.seed}): "
            f"{len(self._tasks)} tasks, {marked} of them cancelled after {settings.cancel_after:g} s; "
            f"simulated time, real-time factor {settings.factor:g}"
        )

    def _set_factor(self, factor: float) -> bool:
        if not rospy.get_param("/use_sim_time", False):
            return True
        if self._set_factor_service is None:
            self._set_factor_service = ServiceProxy(
                "/merlin_sim/set_real_time_factor", SetRealTimeFactor, timeout=5.0
            )
        try:
            answer = self._set_factor_service(factor)
            trouble = "" if answer.success else answer.message
        except ServiceError as error:
            trouble = str(error)
        if trouble:
            self._view.line(f"mission: no real-time factor {factor:g}: {trouble}")
        return not trouble

    def _task_changed(self, record: TaskRecord) -> None:
        count = len(self._tasks)
        if record.outcome:
            self._factor.task_starts()
            self._view.line(ended_line(record, count))
        elif record.cancel_sent is None:
            self.reporter.task(f"check {record.task.poi}")

    def _length_of_question(self) -> float:
        # It imports numpy, which the other policy does without.
        from merlin_experiment.mission.speech_length import SoundError, speech_length

        try:
            return self._settings.speech_length or speech_length()
        except SoundError:
            return 0.0  # the end of the question is then not slowed down

    def _action_starts(self, operator: str) -> None:
        self._factor.action_starts(self._speech if operator == "ask" else 0.0)

    def _judge_factor(self, status: SimStatus) -> None:
        self._spoken = self._spoken + 1 if status.requested_factor == self._requested else 1
        self._requested = status.requested_factor
        # The first message reports the change, the second a second with both factors in it.
        if self._spoken > 2 and not status.paused:
            self._factor.reached(status.requested_factor, status.achieved_factor)

    def _watch(self, sample: Sample) -> None:
        records, start = self._mission.records, self._mission.start
        if not records or records[-1].outcome or start is None:
            return
        record = records[-1]
        x, y = self._settings.points[record.task.poi]
        near = math.hypot(x - sample.x, y - sample.y) < ARRIVAL_AHEAD
        if near and self._arrives_in != record.task.number:
            self._arrives_in = record.task.number
            self._factor.arrival_is_near()
        sent = start + record.sent
        metres = self._trajectory.distance(sent, sample.time)
        doing = self._robot.doing
        self._view.live(live_line(record, len(self._tasks), doing, sample.time - sent, metres))


def main() -> int:
    """Runs the node; returns the exit code."""
    init_node("mission")
    return run_mission(MeasuredMissionNode)
