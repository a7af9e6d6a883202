# SPDX-License-Identifier: Apache-2.0
"""What the Executor asks of the velocity guards when it cancels, without ROS."""

import threading
from types import SimpleNamespace
from typing import Any, Callable, Dict, List, Sequence

import pytest
import rospy
from merlin_msgs.msg import GuardStatus, RobotHost

from merlin_executor.node import guard_client as module
from merlin_executor.node.guard_client import GuardClient
from merlin_ros.deadline import Deadline
from merlin_test import LONG


class Guards:
    """Guards of robots that say what the test lets them say."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, stand_wait: float = LONG) -> None:
        self.callbacks: Dict[str, Callable[[Any], None]] = {}
        self.braked: List[str] = []
        self.all_braked = threading.Event()
        self.expected = 0
        monkeypatch.setattr(rospy, "Subscriber", self._subscribe)
        monkeypatch.setattr(rospy, "Publisher", lambda topic, *_, **__: topic)
        monkeypatch.setattr(module, "publish", self._publish)
        monkeypatch.setattr(module, "ServiceProxy", lambda *_, **__: SimpleNamespace())
        monkeypatch.setattr(module, "BRAKE_WAIT", LONG)
        self.client = GuardClient("/kb", stand_wait)

    def _subscribe(self, topic: str, _: type, callback: Callable[[Any], None], **__: Any) -> None:
        self.callbacks[topic] = callback

    def _publish(self, topic: str, _: Any) -> None:
        self.braked.append(topic)
        if len(self.braked) == self.expected:
            self.all_braked.set()

    def meet(self, *robots: str) -> None:
        for robot in robots:
            self.callbacks["/kb/robots"](RobotHost(robot=robot, node=f"/{robot}/merlin_fsm_host"))
        self.expected = len(robots) + 1

    def stopped(self, topic: str, reason: str = "stopped by Ana") -> None:
        status = GuardStatus(state=GuardStatus.STOPPED, reason=reason, since=rospy.Time(42.5))
        self.callbacks[topic](status)

    def say(
        self,
        robot: str,
        moving: bool,
        state: int = GuardStatus.PASSING,
        goals: Sequence[str] = (),
        cancelled: Sequence[str] = (),
    ) -> None:
        status = GuardStatus(moving=moving, state=state, goals=list(goals), cancelled=list(cancelled))
        self.callbacks[f"/{robot}/merlin/guard" if robot else "merlin/guard"](status)


def test_a_brake_goes_on_when_all_robots_that_drive_are_held(monkeypatch: pytest.MonkeyPatch) -> None:
    guards = Guards(monkeypatch)
    guards.meet("ann", "bob", "carl")
    guards.say("ann", True)
    guards.say("bob", True)
    guards.say("carl", False)
    braking = threading.Thread(target=guards.client.brake, args=("cancelled",), daemon=True)
    braking.start()
    assert guards.all_braked.wait(LONG)
    guards.say("ann", False)
    assert braking.is_alive()  # bob still drives
    guards.say("bob", False)
    braking.join(LONG)
    assert not braking.is_alive()
    assert sorted(guards.braked) == [
        "/ann/merlin/brake",
        "/bob/merlin/brake",
        "/carl/merlin/brake",
        "merlin/brake",
    ]


def test_a_brake_does_not_wait_for_the_only_robot_that_drives(monkeypatch: pytest.MonkeyPatch) -> None:
    guards = Guards(monkeypatch)
    guards.meet("ann", "bob")
    guards.say("ann", True)
    guards.say("bob", False)
    guards.client.brake("cancelled")
    assert len(guards.braked) == 3


def test_a_guard_that_says_nothing_ends_the_wait_with_its_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    guards = Guards(monkeypatch)
    guards.meet("ann", "bob")
    guards.say("ann", True)
    guards.say("bob", True)
    monkeypatch.setattr(module, "BRAKE_WAIT", 0.01)
    guards.client.brake("cancelled")
    assert len(guards.braked) == 3


def test_a_cancel_waits_for_the_motion_goal_of_a_machine_that_died(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "GOAL_WAIT", LONG)
    guards = Guards(monkeypatch)
    guards.meet("ann", "bob")
    guards.say("ann", True, goals=["ann-1"])
    guards.client.brake("cancelled")
    guards.say("ann", False, GuardStatus.HOLDING, ["ann-1"])
    stood: List[bool] = []
    waiting = threading.Thread(target=lambda: stood.append(guards.client.wait_standing()), daemon=True)
    waiting.start()
    guards.say("bob", False, GuardStatus.HOLDING, ["of another plan"])
    assert waiting.is_alive() and not stood
    guards.say("ann", False, GuardStatus.IDLE)
    waiting.join(LONG)
    assert stood == [True]


@pytest.mark.parametrize(
    ("state", "goals"),
    [(GuardStatus.PASSING, ["ann-1"]), (GuardStatus.HOLDING, ["ann-2"]), (GuardStatus.IDLE, [])],
)
def test_a_goal_of_another_client_is_not_waited_for(
    monkeypatch: pytest.MonkeyPatch, state: int, goals: List[str]
) -> None:
    monkeypatch.setattr(module, "GOAL_WAIT", 10 * LONG)
    guards = Guards(monkeypatch)
    guards.meet("ann", "bob")
    guards.say("ann", True, goals=["ann-1"])
    guards.client.brake("cancelled")
    guards.say("ann", False, state, goals)
    assert guards.client.wait_standing()


def test_a_goal_that_does_not_end_delays_the_answer_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "GOAL_WAIT", 0.01)
    guards = Guards(monkeypatch)
    guards.meet("ann", "bob")
    guards.say("ann", True, goals=["ann-1"])
    guards.client.brake("cancelled")
    guards.say("ann", False, GuardStatus.HOLDING, ["ann-1"])
    assert guards.client.wait_standing()


def test_a_hold_is_reported_with_its_holder_until_the_release(monkeypatch: pytest.MonkeyPatch) -> None:
    guards = Guards(monkeypatch)
    reported: List[str] = []
    guards.client.follow(lambda: reported.append(guards.client.hold))
    guards.stopped("merlin/guard")
    guards.stopped("merlin/guard")
    guards.callbacks["merlin/guard"](GuardStatus())
    assert reported == ["", "the base is held by Ana since 42.5 s", ""]


def test_of_several_robots_each_that_is_held_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    guards = Guards(monkeypatch)
    guards.meet("ann", "bob")
    guards.stopped("/bob/merlin/guard", "stopped on the topic merlin/stop")
    assert guards.client.hold == "robot bob is held on the topic merlin/stop since 42.5 s"
    guards.stopped("/ann/merlin/guard")
    assert "robot ann is held by Ana since 42.5 s and robot bob is held" in guards.client.hold


def test_a_robot_that_is_gone_holds_nobody_up(monkeypatch: pytest.MonkeyPatch) -> None:
    guards = Guards(monkeypatch)
    monkeypatch.setattr(module.time, "monotonic", lambda: now)
    now = 100.0
    guards.meet("ann", "bob")
    guards.stopped("/bob/merlin/guard")
    released = threading.Event()
    waiting = threading.Thread(target=lambda: (guards.client.wait_released(lambda: False), released.set()))
    waiting.start()
    now += 60.0
    guards.meet("ann")
    assert released.wait(LONG) and guards.client.hold == ""


def test_the_last_word_of_a_guard_that_hangs_counts_while_its_robot_is_there(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    guards = Guards(monkeypatch, stand_wait=0.01)
    monkeypatch.setattr(module, "FRESH", 0.01)
    guards.meet("ann", "bob")
    guards.say("ann", True)
    clock = [module.time.monotonic()]
    monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: clock[0]))
    clock[0] += 4.0
    guards.meet("ann", "bob")
    assert not guards.client.wait_standing()
    clock[0] += 4.0  # its host is silent, too
    assert guards.client.wait_standing()


def test_the_wait_for_a_release_can_be_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    guards = Guards(monkeypatch)
    guards.stopped("merlin/guard")
    stopped = threading.Event()
    waiting = threading.Thread(target=guards.client.wait_released, args=(stopped.is_set,))
    waiting.start()
    stopped.set()
    guards.client.wake()
    waiting.join(LONG)
    assert not waiting.is_alive() and guards.client.hold


def test_a_base_may_move_for_what_was_not_cancelled(monkeypatch: pytest.MonkeyPatch) -> None:
    guards = Guards(monkeypatch)
    guards.meet("ann", "bob")
    guards.say("ann", True, goals=["a"], cancelled=["a"])
    guards.say("bob", True, goals=["b"])
    said: List[bool] = []
    waiting = threading.Thread(target=lambda: said.append(guards.client.wait_left()), daemon=True)
    waiting.start()
    guards.say("ann", True, goals=["c"])
    waiting.join(LONG)
    assert said == [True]


@pytest.mark.parametrize("stands", [False, True])
def test_a_goal_that_was_cancelled_must_not_move_its_base(
    monkeypatch: pytest.MonkeyPatch, stands: bool
) -> None:
    monkeypatch.setattr(module, "FRESH", 0.01)
    guards = Guards(monkeypatch, stand_wait=0.0)
    guards.say("", not stands, goals=["a"], cancelled=["a"])
    assert guards.client.wait_left() is stands


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("wait", [GuardClient.wait_standing, GuardClient.wait_left])
def test_the_last_word_of_a_guard_that_hangs_for_a_moment_does_not_count(
    monkeypatch: pytest.MonkeyPatch, moving: bool, wait: Callable[[GuardClient], bool]
) -> None:
    guards = Guards(monkeypatch, stand_wait=0.0)
    guards.meet("ann")
    guards.say("ann", True, cancelled=["a"])

    class GoesOn(Deadline):
        """While its next word is awaited the guard goes on."""

        def wait(self, condition: threading.Condition, predicate: Callable[[], bool]) -> bool:
            if self.seconds == module.FRESH:
                guards.say("ann", moving, cancelled=["a"])
            return super().wait(condition, predicate)

    monkeypatch.setattr(module, "Deadline", GoesOn)
    monkeypatch.setattr(module, "FRESH", LONG)
    assert wait(guards.client) is not moving


@pytest.mark.parametrize("robot", ["", "ann"])
def test_the_base_of_a_guard_that_hangs_for_longer_is_not_known_to_stand(
    monkeypatch: pytest.MonkeyPatch, robot: str
) -> None:
    guards = Guards(monkeypatch, stand_wait=0.0)
    guards.meet("ann")
    now = [100.0]
    monkeypatch.setattr(module.time, "monotonic", lambda: now[0])
    guards.say(robot, True)

    class Passes(Deadline):
        """What is awaited does not come."""

        def wait(self, condition: threading.Condition, predicate: Callable[[], bool]) -> bool:
            now[0] += self.seconds + 0.1
            return predicate()

    now[0] += 0.1
    monkeypatch.setattr(module, "Deadline", Passes)
    assert not guards.client.wait_standing()
