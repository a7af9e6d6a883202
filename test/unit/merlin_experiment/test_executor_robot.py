# SPDX-License-Identifier: Apache-2.0
"""The measured mission waits while the Executor works for another client, and knows for how long."""

import threading
from typing import Any, Callable, List

import pytest
import rospy
from merlin_msgs.msg import ExecutorStatus

from merlin_experiment.mission import executor_robot
from merlin_experiment.mission.executor_robot import ExecutorRobot
from merlin_experiment.records.trajectory import Trajectory
from merlin_test import LONG

FOREIGN = {"state": ExecutorStatus.RUNNING, "request": "/merlin_monitor-1-7.0", "goals": ["(checked hall)"]}
OWN = {"state": ExecutorStatus.RUNNING, "request": "/mission-1-3.0"}


class Bench:
    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self._receive: Callable[[Any], None] = lambda status: None
        monkeypatch.setattr(executor_robot, "MerlinExecutorClient", lambda **_: None)
        monkeypatch.setattr(rospy, "Subscriber", self._subscribe)
        monkeypatch.setattr(rospy, "get_name", lambda: "/mission")
        self.robot = ExecutorRobot(Trajectory(), lambda operator: None)

    def _subscribe(self, _: str, __: type, receive: Callable[[Any], None], **___: Any) -> None:
        self._receive = receive

    def say(self, at: float, **fields: Any) -> None:
        status = ExecutorStatus(**fields)
        status.header.stamp = rospy.Time(at)
        self._receive(status)


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Bench:
    return Bench(monkeypatch)


def test_another_clients_request_is_not_waited_for_to_end_a_task(bench: Bench) -> None:
    bench.say(1.0, **OWN)
    ended = threading.Event()
    waiting = threading.Thread(target=lambda: (bench.robot.wait_idle(), ended.set()))
    waiting.start()
    bench.say(2.0, **FOREIGN)
    assert ended.wait(executor_robot.IDLE_TIMEOUT)


@pytest.mark.parametrize("disturbance", [FOREIGN, {"waits": "the base is held by Ana since 14:03"}])
def test_the_next_task_waits_for_what_disturbs_it_and_says_why(bench: Bench, disturbance: Any) -> None:
    reported: List[str] = []
    waits, free = threading.Event(), threading.Event()

    def tell(why: str) -> None:
        reported.append(why)
        waits.set()

    bench.say(1.0, **disturbance)
    waiting = threading.Thread(target=lambda: (bench.robot.wait_free(lambda: False, tell), free.set()))
    waiting.start()
    assert waits.wait(LONG) and not free.is_set()
    assert "(checked hall) of another client runs" in reported[0] or "the base is held by Ana" in reported[0]
    bench.say(9.0)
    assert free.wait(LONG)


def test_the_wait_ends_with_the_mission(bench: Bench) -> None:
    bench.say(1.0, **FOREIGN)
    stopped, waits = threading.Event(), threading.Event()
    waiting = threading.Thread(target=bench.robot.wait_free, args=(stopped.is_set, lambda why: waits.set()))
    waiting.start()
    assert waits.wait(LONG)
    stopped.set()
    bench.robot.wake()
    waiting.join(LONG)
    assert not waiting.is_alive()


def test_the_time_in_which_others_were_served_is_known(bench: Bench) -> None:
    for at, fields in ((1.0, OWN), (4.0, FOREIGN), (7.0, OWN), (10.0, {"waits": "held"}), (12.0, {})):
        bench.say(at, **fields)
    assert bench.robot.disturbed(0.0, 20.0) == pytest.approx(5.0)
    assert bench.robot.disturbed(5.0, 11.0) == pytest.approx(3.0)
    bench.say(20.0, **FOREIGN)
    assert bench.robot.disturbed(15.0, 22.0) == pytest.approx(2.0)
