# SPDX-License-Identifier: Apache-2.0
"""A mission that waits for a release, whatever it hears of ``merlin/status`` before the result."""

import math
import threading
from types import SimpleNamespace
from typing import Any, Iterator, List

import pytest
import rospy
from fake_robot import FakeRobot
from merlin_msgs.msg import ExecutorStatus, QueuedGoal

from merlin_executor.mission.mission_pause import MissionPause
from merlin_test import LONG

HELD = "the base is held by Ana since 14:03"
OURS = "/mission-1"
IDLE, RUNNING, CANCELLING = ExecutorStatus.IDLE, ExecutorStatus.RUNNING, ExecutorStatus.CANCELLING


def status(state: int, waits: str = "", request: str = OURS, together: str = "") -> ExecutorStatus:
    others = [QueuedGoal(request=together)] if together else []
    return ExecutorStatus(state=state, waits=waits, request=request if state else "", together=others)


class Mission:
    """A mission whose request an operator has cancelled asks in a thread whether it is sent again."""

    def __init__(self, robot: FakeRobot, pause: MissionPause) -> None:
        self._robot = robot
        self._pause = pause
        self.paused: List[bool] = []
        self._changed = threading.Condition()
        self._answers: List[bool] = []
        self._looks = 0

    def pauses(self, paused: bool) -> None:
        with self._changed:
            self.paused.append(paused)
            self._changed.notify_all()

    def hears(self, statuses: List[ExecutorStatus]) -> None:
        for each in statuses:
            for callback in self._robot.on_status:
                callback(each)

    def reads_result(self, at: float = math.nan) -> None:
        request: Any = SimpleNamespace(id=OURS, taken_back=True, ended_at=at)
        threading.Thread(target=self._ask, args=(request,), daemon=True).start()

    def wait_paused(self) -> None:
        with self._changed:
            assert self._changed.wait_for(lambda: bool(self.paused or self._answers), LONG)
            assert self.paused == [True]

    def looks(self) -> None:
        """Returns when what it has heard so far is taken in."""
        with self._changed:
            before = self._looks
        self._pause.wake()
        with self._changed:
            assert self._changed.wait_for(lambda: self._looks > before or bool(self._answers), LONG)
        self._pause.wake()  # behind what it says because of that look

    def goes_on(self) -> bool:
        with self._changed:
            assert self._changed.wait_for(lambda: bool(self._answers), LONG), f"it waits: {self.paused}"
        return self._answers == [True]

    def _ask(self, request: Any) -> None:
        answer = self._pause.again(request, self._looked)
        with self._changed:
            self._answers.append(answer)
            self._changed.notify_all()

    def _looked(self) -> bool:
        with self._changed:
            self._looks += 1
            self._changed.notify_all()
        return False


@pytest.fixture
def mission(robot: FakeRobot) -> Iterator[Mission]:
    with MissionPause(lambda paused: made.pauses(paused)) as pause:
        made = Mission(robot, pause)
        yield made


RELEASES = {
    "it has stopped": [status(CANCELLING, HELD), status(IDLE, HELD), status(IDLE)],
    "it still stops": [status(CANCELLING), status(CANCELLING, HELD), status(CANCELLING)],
    "the hold is heard late": [status(CANCELLING), status(IDLE), status(IDLE, HELD), status(IDLE)],
    "another one begins": [status(CANCELLING, HELD), status(IDLE, HELD), status(RUNNING, request="/other-1")],
    "two ran together": [
        status(CANCELLING, HELD, "/other-1", OURS),
        status(CANCELLING, HELD, "/other-1"),
        status(IDLE, HELD),
        status(IDLE),
    ],
}


@pytest.mark.parametrize("statuses", RELEASES.values(), ids=RELEASES)
@pytest.mark.parametrize("late", [0, 1, 2, 3])
def test_it_goes_on_after_the_release_wherever_the_result_is_read(
    mission: Mission, statuses: List[ExecutorStatus], late: int
) -> None:
    heard = statuses[: len(statuses) - late]
    mission.hears([status(RUNNING), *heard])
    mission.reads_result()
    if late:
        mission.wait_paused()
        mission.hears(statuses[len(heard) :])
    assert mission.goes_on() and mission.paused == [True, False][: 2 * bool(late)]


@pytest.mark.parametrize(
    "statuses",
    [
        [status(CANCELLING)],
        [status(RUNNING, HELD), status(RUNNING), status(CANCELLING), status(IDLE)],
        [status(CANCELLING, HELD), status(CANCELLING), status(RUNNING), status(CANCELLING), status(IDLE)],
        [status(CANCELLING, HELD), status(IDLE, HELD), status(IDLE), status(IDLE, HELD)],
        # It has made way for another one, and was cancelled while it waited.
        [status(CANCELLING), *(status(RUNNING, waits, "/other-1") for waits in ("", HELD, ""))],
    ],
)
def test_it_waits_for_a_release_that_is_still_to_come(
    mission: Mission, statuses: List[ExecutorStatus]
) -> None:
    mission.hears([status(RUNNING), *statuses])
    mission.reads_result()
    mission.wait_paused()
    mission.hears([status(IDLE, HELD), status(IDLE)])
    assert mission.goes_on() and mission.paused == [True, False]


#: The request waits behind another one; at 20 s an operator stops the robot, which cancels it.
OTHERS = [(10.0, ""), (20.0, HELD), (30.0, "")]


def stopped_while_it_waits() -> List[ExecutorStatus]:
    states = (RUNNING, CANCELLING, IDLE)
    statuses = [status(state, waits, "/other-1") for state, (_, waits) in zip(states, OTHERS)]
    for each, (at, _) in zip(statuses, OTHERS):
        each.header.stamp = rospy.Time(at)
    return statuses


def test_a_request_that_was_cancelled_while_it_waited_goes_on_though_the_release_is_read_first(
    mission: Mission,
) -> None:
    mission.hears(stopped_while_it_waits())
    mission.reads_result(at=20.0)
    assert mission.goes_on() and mission.paused == []


@pytest.mark.parametrize("read", range(4))
@pytest.mark.parametrize("set_back", [False, True])
def test_an_older_release_that_is_read_after_the_result_does_not_count(
    mission: Mission, read: int, set_back: bool
) -> None:
    older = stopped_while_it_waits()
    mission.hears(older[:read])
    mission.reads_result(at=40.0)
    mission.wait_paused()
    mission.hears(older[read:])
    mission.looks()
    assert mission.paused == [True]
    release = [status(IDLE, HELD), status(IDLE)]
    for each in release:
        each.header.stamp = rospy.Time(5.0 if set_back else 50.0)  # the Executor's clock
    mission.hears(release)
    assert mission.goes_on() and mission.paused == [True, False]


@pytest.mark.parametrize("set_back", [False, True])
def test_a_request_that_was_cancelled_after_the_release_waits_for_another_one(
    mission: Mission, set_back: bool
) -> None:
    mission.hears(stopped_while_it_waits())
    later = status(RUNNING, request="/other-2")
    later.header.stamp = rospy.Time(5.0 if set_back else 35.0)  # the Executor's clock
    mission.hears([later])
    mission.reads_result(at=6.0 if set_back else 40.0)
    mission.wait_paused()
    mission.hears([status(IDLE, HELD), status(IDLE)])
    assert mission.goes_on() and mission.paused == [True, False]
