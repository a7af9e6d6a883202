# SPDX-License-Identifier: Apache-2.0
"""The mission over a robot that lives in simulated time without ROS."""

import threading
from typing import Callable, List, NamedTuple, Optional, Tuple

import pytest

from merlin_experiment.mission.measured_mission import MeasuredMission, MissionStopped
from merlin_experiment.mission.real_time_factor import RealTimeFactor
from merlin_experiment.records.task_record import TaskRecord
from merlin_experiment.records.trajectory import Sample, Trajectory
from merlin_home.mission_list import MissionTask, make_mission
from merlin_ros.service_proxy import ServiceError

POINTS = ["dorm_room", "bathroom", "kitchen", "main_door"]


class Ending(NamedTuple):
    name: str
    stage: str = ""
    reason: str = ""
    replans: int = 0


class FakeRobot:
    """Deliberates 0.1 s, drives 1 m/s for `drive` s, asks 5 s; stops 0.3 s after a cancel."""

    def __init__(self, drive: float = 15.0) -> None:
        self.trajectory = Trajectory()
        self.drive = drive
        self.time = 0.0
        self.forgotten: List[str] = []
        self.idle_waits = 0
        self.elsewhere = 0.0  # s of each task in which the Executor works for others
        self._timers: List[Tuple[float, Callable[[], None]]] = []
        self._actions: List[Tuple[str, float, float]] = []
        self._x = 0.0
        self._cancelled: Optional[float] = None
        self._tick(0.0)

    def now(self) -> float:
        return self.time

    def forget(self, poi: str) -> None:
        self.forgotten.append(poi)

    def send(self, poi: str) -> "FakeRobot":
        self._cancelled = None
        return self

    def call_after(self, seconds: float, action: Callable[[], None]) -> Callable[[], None]:
        entry = (self.time + seconds, action)
        self._timers.append(entry)
        return lambda: self._timers.remove(entry) if entry in self._timers else None

    def cancel(self) -> None:
        self._cancelled = self.time

    def wait(self) -> Ending:
        self._advance(0.1, 0.0)
        for operator, seconds, speed in (("navigate", self.drive, 1.0), ("ask", 5.0, 0.0)):
            begun = self.time
            finished = self._advance(seconds, speed)
            if not finished:
                self._advance(0.3, 0.0, stop=False)
            self._actions.append((operator, begun, self.time))
            if not finished:
                return Ending("CANCELLED", "dispatching", "cancelled by its sender")
        return Ending("SUCCEEDED")

    def wait_idle(self) -> None:
        self.idle_waits += 1

    def disturbed(self, since: float, until: float) -> float:
        return self.elsewhere

    def action_times(self, since: float) -> List[Tuple[str, float, float]]:
        return [entry for entry in self._actions if entry[1] >= since]

    def _advance(self, seconds: float, speed: float, stop: bool = True) -> bool:
        end = self.time + seconds
        while self.time < end - 1e-9:
            step = min(0.1, end - self.time)
            self.time += step
            self._x += speed * step
            self._tick(speed)
            for entry in [entry for entry in self._timers if entry[0] <= self.time + 1e-9]:
                self._timers.remove(entry)
                entry[1]()
            if stop and self._cancelled is not None:
                return False
        return True

    def _tick(self, speed: float) -> None:
        self.trajectory.add(Sample(self.time, self._x, 0.0, 0.0, speed, 0.0))


def test_unmarked_tasks_run_to_their_end_and_marked_ones_are_cancelled() -> None:
    robot = FakeRobot()
    mission = MeasuredMission(make_mission(POINTS, 6, 3), robot, cancel_after=10.0)
    records = mission.run()
    mission.measure_stops()
    assert [record.task.poi for record in records] == robot.forgotten
    assert robot.idle_waits == 6
    for record in records:
        assert record.right
        assert record.first_dispatch - record.sent == pytest.approx(0.1)
        if record.task.marked:
            assert record.cancelled
            assert record.cancel_sent - record.sent == pytest.approx(10.0)
            assert record.distance == pytest.approx(9.9, abs=0.11)
            assert record.stopping == pytest.approx(0.3)
            assert record.speaking == 0.0
            assert record.robot_stopped == pytest.approx(record.cancel_sent + 0.1, abs=0.05)
        else:
            assert record.succeeded
            assert record.time == pytest.approx(20.1)
            assert record.distance == pytest.approx(15.0)
            assert (record.navigating, record.speaking) == (pytest.approx(15.0), pytest.approx(5.0))
    assert records[0].sent == 0.0


def test_what_disturbs_a_task_is_not_its_time_and_marks_it() -> None:
    robot = FakeRobot()
    robot.elsewhere = 7.0
    mission = MeasuredMission([MissionTask(1, "kitchen", False)], robot, cancel_after=10.0)
    (record,) = mission.run()
    assert (record.disturbed, record.time) == (7.0, pytest.approx(20.1 - 7.0))


def test_a_marked_task_that_is_done_before_is_not_cancelled() -> None:
    robot = FakeRobot(drive=2.0)
    mission = MeasuredMission(
        [MissionTask(1, "kitchen", True), MissionTask(2, "bathroom", False)], robot, cancel_after=10.0
    )
    first, second = mission.run()
    assert first.succeeded and first.right and first.cancel_sent is None
    assert second.succeeded


def test_what_precedes_a_cancel_happens_before_it() -> None:
    robot, moments = FakeRobot(), []
    ahead = (1.0, lambda: moments.append(robot.now()))
    MeasuredMission([MissionTask(1, "kitchen", True)], robot, 10.0, before_cancel=ahead).run()
    assert moments == [pytest.approx(9.0)]


def test_a_stopped_mission_cancels_and_sends_no_more() -> None:
    robot = FakeRobot()
    mission = MeasuredMission(make_mission(POINTS, 6, 3), robot, cancel_after=100.0)
    robot.call_after(30.0, mission.stop)
    with pytest.raises(MissionStopped):
        mission.run()
    assert 0 < len(mission.records) < 6
    assert all(record.outcome for record in mission.records)


def test_a_task_that_cannot_be_sent_is_no_data() -> None:
    class Refusing(FakeRobot):
        def send(self, poi: str) -> FakeRobot:
            if self.time > 30.0:
                raise ServiceError("the knowledge base does not answer")
            return super().send(poi)

    mission = MeasuredMission(make_mission(POINTS, 6, 3), Refusing(), cancel_after=100.0)
    with pytest.raises(ServiceError):
        mission.run()
    assert 0 < len(mission.records) < 6
    assert all(record.outcome for record in mission.records)


def test_each_change_is_reported() -> None:
    reported = []

    def tell(record: TaskRecord) -> None:
        reported.append((record.task.number, record.outcome))

    MeasuredMission(
        [MissionTask(1, "kitchen", True), MissionTask(2, "bathroom", False)],
        FakeRobot(),
        10.0,
        on_change=tell,
    ).run()
    assert reported == [(1, ""), (1, ""), (1, "CANCELLED"), (2, ""), (2, "SUCCEEDED")]


class Factors(list):
    """A simulator that takes factors, unless it is deaf."""

    deaf = False

    def take(self, factor: float) -> bool:
        self.append(factor)
        return not self.deaf


class Timers:
    """Calls that wait for their time, in the order in which they were asked for."""

    def __init__(self) -> None:
        self.waiting: List[Callable[[], None]] = []

    def call_after(self, seconds: float, action: Callable[[], None]) -> Callable[[], None]:
        self.waiting.append(action)
        return lambda: None

    def elapse(self) -> None:
        waiting, self.waiting = self.waiting, []
        for action in waiting:
            action()


def test_the_adaptive_factor_is_one_while_the_robot_waits_for_software() -> None:
    factors, timers = Factors(), Timers()
    factor = RealTimeFactor("adaptive", 5.0, factors.take, timers.call_after)
    factor.mission_starts()
    factor.task_starts()
    factor.action_starts()
    assert factors == [1.0]
    timers.elapse()
    assert factors == [1.0, 5.0]
    factor.action_starts()  # the plan's second action
    timers.elapse()
    assert factors == [1.0, 5.0, 1.0, 5.0]
    factor.cancel_is_near()
    factor.action_starts()  # dispatched while it is being cancelled
    timers.elapse()
    assert factors == [1.0, 5.0, 1.0, 5.0, 1.0]
    factor.task_starts()
    factor.action_starts()
    factor.cancel_is_near()  # sooner than the robot has set off
    timers.elapse()
    assert factors == [1.0, 5.0, 1.0, 5.0, 1.0]


def test_the_adaptive_factor_is_one_when_the_robot_arrives_and_when_the_question_ends() -> None:
    factors, timers = Factors(), Timers()
    factor = RealTimeFactor("adaptive", 5.0, factors.take, timers.call_after)
    factor.task_starts()
    factor.action_starts()
    timers.elapse()
    factor.arrival_is_near()
    timers.elapse()
    assert factors == [1.0, 5.0, 1.0]
    factor.action_starts(5.0)
    assert len(timers.waiting) == 2, "a second after the dispatch, and before the end"
    timers.elapse()
    assert factors == [1.0, 5.0, 1.0, 5.0, 1.0]


def test_a_machine_that_does_not_keep_up_gets_a_lower_factor() -> None:
    factors, timers = Factors(), Timers()
    factor = RealTimeFactor("adaptive", 5.0, factors.take, timers.call_after)
    factor.action_starts()
    factor.reached(1.0, 0.4)  # a slow machine at factor 1 distorts nothing
    timers.elapse()
    factor.reached(5.0, 4.8)
    assert factors == [1.0, 5.0]
    factor.reached(5.0, 3.0)
    assert factors == [1.0, 5.0, 3.0]
    factor.reached(5.0, 1.0)  # of the time before
    assert factors == [1.0, 5.0, 3.0]
    factor.reached(3.0, 3.0)
    assert factors[-1] == pytest.approx(3.3)
    factor.action_starts()
    timers.elapse()
    assert factors[-2:] == [1.0, pytest.approx(3.3)]
    assert factor.lowest == 3.0


def test_a_factor_that_was_not_taken_is_set_again() -> None:
    factors, timers = Factors(), Timers()
    factor = RealTimeFactor("adaptive", 5.0, factors.take, timers.call_after)
    factors.deaf = True
    assert not factor.mission_starts()
    factor.task_starts()
    factors.deaf = False
    assert factor.mission_starts()
    factor.task_starts()
    assert factors == [1.0, 1.0, 1.0]


def test_a_constant_factor_is_set_once() -> None:
    factors, timers = Factors(), Timers()
    factor = RealTimeFactor("constant", 3.0, factors.take, timers.call_after)
    for call in (factor.mission_starts, factor.action_starts, factor.cancel_is_near, factor.task_starts):
        call()
    factor.arrival_is_near()
    factor.reached(3.0, 1.0)
    timers.elapse()
    assert factors == [3.0]


@pytest.mark.parametrize(("policy", "factor"), [("sometimes", 1.0), ("constant", -1.0)])
def test_bad_factors_are_refused(policy: str, factor: float) -> None:
    with pytest.raises(ValueError, match=policy if policy == "sometimes" else "factor"):
        RealTimeFactor(policy, factor, lambda value: True, Timers().call_after)


def test_stopping_from_another_thread_waits_for_nobody() -> None:
    robot = FakeRobot()
    mission = MeasuredMission([MissionTask(1, "kitchen", False)], robot, 10.0)
    thread = threading.Thread(target=mission.stop)
    thread.start()
    thread.join(60.0)
    assert not thread.is_alive()
    with pytest.raises(MissionStopped):
        mission.run()
