"""Node `mission`: runs one of the paper's missions and writes what came of it.

Exit code: 0 when every task ended as the list says, 1 when one did not, 2 when the mission could not begin or
go on, 130 when it was interrupted.
"""

import math
import sys
import time
from typing import Optional

import rospy
from merlin_msgs.msg import MissionStatus, SimStatus
from merlin_msgs.srv import SetRealTimeFactor
from nav_msgs.msg import OccupancyGrid

from merlin_executor.goal_check import GoalError
from merlin_executor.mission_pause import MissionPause
from merlin_executor.mission_reporter import MissionReporter
from merlin_executor.readiness import missing_servers
from merlin_experiment.mission.executor_robot import ExecutorRobot
from merlin_experiment.mission.ground_truth import GroundTruth, grid_of, receive_one
from merlin_experiment.mission.measured_mission import MeasuredMission, MissionStopped
from merlin_experiment.mission.mission_settings import MissionSettings, SettingsError
from merlin_experiment.mission.progress_view import ProgressView, closing_lines, ended_line, live_line
from merlin_experiment.mission.real_time_factor import ARRIVAL_AHEAD, CANCEL_AHEAD, RealTimeFactor
from merlin_experiment.mission.speech_length import SpeechLengthError, speech_length
from merlin_experiment.records.result_files import write_run
from merlin_experiment.records.task_record import RunRecord, TaskRecord
from merlin_experiment.records.trajectory import Sample, Trajectory
from merlin_experiment.records.versions import versions
from merlin_ros.node import init_node
from merlin_ros.service_proxy import ServiceError, ServiceProxy
from merlin_sm.knowledge_client import KnowledgeError

EXIT_NOT_AS_LISTED = 1
EXIT_STOPPED = 2
EXIT_INTERRUPTED = 130
SERVERS = ("move_base", "sound_play")
"""Action servers that the actions of the home use."""
AFTERWARDS = 0.5
"""ROS time in which the robot comes to its last standstill, s."""
SETTLE = 2.0
"""Wall seconds to wait for that."""


class MeasuredMissionNode:
    """Connects a :class:`MeasuredMission` with ROS and the screen."""

    def __init__(self, settings: MissionSettings) -> None:
        self._settings = settings
        self._tasks = settings.make_list()
        self._view = ProgressView()
        self._reporter = MissionReporter(f"home mission {settings.mission}", len(self._tasks))
        self._set_factor_service: Optional[ServiceProxy] = None
        self._trajectory = Trajectory()
        self._robot = ExecutorRobot(self._trajectory, self._action_starts, settings.on_lost)
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
            lambda stopped: self._pause.wait(stopped),
        )
        self._pause = MissionPause(self._reporter.paused)
        self._truth = GroundTruth(self._trajectory, self._watch)
        self._simulator = rospy.Subscriber("/merlin_sim/status", SimStatus, self._judge_factor)

    def run(self) -> int:
        """Runs the mission; returns the exit code."""
        settings = self._settings
        rospy.on_shutdown(self._stop)
        self._reporter.report(MissionStatus.STARTING, "waiting for the robot")
        began = time.monotonic()
        run = RunRecord(settings.columns(), self._mission.records, versions=versions())
        code = 0
        try:
            grid = self._wait_for_robot()
            self._view.line(self._headline())
            if settings.policy == "adaptive":
                self._speech = self._length_of_question()
            began = time.monotonic()
            if not self._factor.mission_starts():
                raise MissionStopped("the simulator does not take the real-time factor")
            with self._pause:
                self._mission.run()
        except (MissionStopped, GoalError, KnowledgeError, ServiceError) as error:
            run.ended = str(error)
            code = EXIT_INTERRUPTED if run.ended == "interrupted" else EXIT_STOPPED
            self._view.line(f"mission: {run.ended}")
            if self._mission.start is None:
                self._report_end(run)
                return code
        run.wall = time.monotonic() - began
        self._finish(run, None if code == EXIT_INTERRUPTED else grid)
        return code or (0 if run.right else EXIT_NOT_AS_LISTED)

    def _stop(self) -> None:
        self._mission.stop()
        self._pause.wake()

    def _wait_for_robot(self) -> OccupancyGrid:
        timeout = self._settings.startup
        self._robot.wait_until_ready(timeout)
        if not self._trajectory.wait_until(0.0, timeout):
            raise MissionStopped(f"nothing on {rospy.resolve_name('ground_truth')} after {timeout:.0f} s")
        for server in missing_servers(SERVERS, timeout):
            raise MissionStopped(
                f"no action server {rospy.resolve_name(server)} after {timeout:.0f} s; is it launched?"
            )
        grid = receive_one("/map", OccupancyGrid, timeout)
        if grid is None:
            raise MissionStopped(f"no map on /map after {timeout:.0f} s")
        return grid

    def _finish(self, run: RunRecord, grid: Optional[OccupancyGrid]) -> None:
        start = self._mission.start
        assert start is not None
        if grid is not None:
            self._trajectory.wait_until(rospy.get_time() + AFTERWARDS, SETTLE)
        self._mission.measure_stops()
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
        self._report_end(run)

    def _report_end(self, run: RunRecord) -> None:
        if run.right:
            self._reporter.report(MissionStatus.SUCCEEDED, "every task ended as listed")
        elif run.ended == "complete":
            wrong = sum(not record.right for record in run.tasks)
            self._reporter.report(MissionStatus.FAILED, f"{wrong} of {len(run.tasks)} tasks not as listed")
        elif run.ended == "interrupted":
            self._reporter.report(MissionStatus.CANCELLED, run.ended)
        else:
            self._reporter.report(MissionStatus.FAILED, run.ended)

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
            self._reporter.task(f"check {record.task.poi}")

    def _length_of_question(self) -> float:
        try:
            return self._settings.speech_length or speech_length()
        except SpeechLengthError:
            return 0.0  # the end of the question is then not slowed down

    def _action_starts(self, operator: str) -> None:
        self._factor.action_starts(self._speech if operator == "ask" else 0.0)

    def _judge_factor(self, status: SimStatus) -> None:
        self._spoken = self._spoken + 1 if status.requested_factor == self._requested else 1
        self._requested = status.requested_factor
        # The first message tells of the change, the second of a second with both factors in it.
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
    """Entry point of the node; returns the exit code."""
    init_node("mission")
    try:
        settings = MissionSettings.read(
            lambda name, default: rospy.get_param(f"~{name}", default),
            rospy.get_param("world/points_of_interest", {}),
        )
        settings.results.mkdir(parents=True, exist_ok=True)
    except SettingsError as error:
        print(f"mission: {error}", file=sys.stderr)
        return EXIT_STOPPED
    except OSError as error:
        print(f"mission: no folder for the results: {error}; give another one, results:=…", file=sys.stderr)
        return EXIT_STOPPED
    return MeasuredMissionNode(settings).run()
