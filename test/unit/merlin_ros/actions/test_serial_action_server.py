# SPDX-License-Identifier: Apache-2.0
"""A server of one goal at a time whose code fails when it is told to cancel."""

import threading
from typing import Any, Iterator, List

import pytest
import rospy
from actionlib_msgs.msg import GoalID, GoalStatus
from fakes.topics import Topics
from merlin_msgs.msg import ListenAction, ListenActionGoal

from merlin_ros.actions.action_server import ServerGoal
from merlin_ros.actions.lease_watch import LeaseWatch
from merlin_ros.actions.serial_action_server import SerialActionServer
from merlin_test import LONG


class Unsayable(Exception):
    def __str__(self) -> str:
        raise AttributeError("users' code, too")


class Server:
    """Executes goals until they are cancelled."""

    def __init__(self, topics: Topics) -> None:
        self._topics = topics
        self.executed: List[ServerGoal] = []
        self.cancels: List[str] = []
        self.goes_on = threading.Event()
        self.goes_on.set()
        self.begun: threading.Semaphore = threading.Semaphore(0)
        self.ended: threading.Semaphore = threading.Semaphore(0)
        self.serial = SerialActionServer("listen", ListenAction, self._execute, self._cancel)
        self.serial.start()

    def send(self, name: str) -> None:
        goal_id = GoalID(id=name, stamp=rospy.Time(1))
        self._topics.send("/listen/goal", ListenActionGoal(goal_id=goal_id))

    def cancel(self, name: str) -> None:
        self._topics.send("/listen/cancel", GoalID(id=name))

    def text(self, name: str) -> str:
        """What the last status list says of a goal."""
        statuses = self._topics.published("/listen/status")
        said = ""
        while not statuses.empty():
            said = next((s.text for s in statuses.get().status_list if s.goal_id.id == name), said)
        return said

    def _execute(self, goal: ServerGoal) -> None:
        self.executed.append(goal)
        self.begun.release()
        if goal.id == "unsayable":
            raise Unsayable
        assert goal.cancel_event.wait(LONG) and self.goes_on.wait(LONG)
        goal.cancelled(text="stopped")
        self.ended.release()

    def _cancel(self, goal: ServerGoal) -> None:
        self.cancels.append(goal.id)
        raise OSError("the microphone does not answer")


@pytest.fixture
def server(clock: Any, monkeypatch: pytest.MonkeyPatch) -> Iterator[Server]:
    monkeypatch.setattr(rospy, "logerr", lambda *_: None)
    made = Server(Topics(monkeypatch))
    yield made
    made.serial.shutdown()
    for thread in threading.enumerate():
        if thread.name == "action /listen":
            thread.join(LONG)
            assert not thread.is_alive()


def test_a_cancel_that_fails_costs_the_newer_goal_nothing(server: Server) -> None:
    server.send("first")
    assert server.begun.acquire(timeout=LONG)
    server.send("second")
    assert server.ended.acquire(timeout=LONG)
    assert server.begun.acquire(timeout=LONG)
    first, second = server.executed
    assert first.status == GoalStatus.PREEMPTED
    assert not second.done
    server.cancel("second")
    assert server.ended.acquire(timeout=LONG)
    assert second.status == GoalStatus.PREEMPTED and server.text("second") == "stopped"


def test_a_cancel_that_failed_is_tried_with_the_next_one(server: Server) -> None:
    server.goes_on.clear()  # it does not stop by itself
    server.send("first")
    assert server.begun.acquire(timeout=LONG)
    server.send("second")
    (first,) = server.executed
    for _ in range(2):
        server.cancel("first")
    assert server.cancels == ["first"] * 3 and not first.done
    assert server.text("first") == "it is not stopped: OSError: the microphone does not answer"
    server.goes_on.set()
    assert server.begun.acquire(timeout=LONG)
    assert server.executed[1].status == GoalStatus.ACTIVE


def test_a_failure_that_cannot_say_what_it_is_is_answered_and_costs_the_next_goal_nothing(
    server: Server,
) -> None:
    server.send("unsayable")
    assert server.begun.acquire(timeout=LONG)
    server.send("next")
    assert server.begun.acquire(timeout=LONG), "the server executes nothing any more"
    assert server.executed[0].status == GoalStatus.ABORTED
    assert server.text("unsayable") == "Unsayable: (its text raised AttributeError)"
    server.cancel("next")
    assert server.ended.acquire(timeout=LONG)


def test_a_goal_that_was_answered_before_its_turn_is_not_executed(server: Server) -> None:
    server.send("first")
    assert server.begun.acquire(timeout=LONG)
    server.goes_on.clear()  # the first stops, and has not ended
    server.send("second")
    server.serial.server.goals()[-1].abort(text="not wanted")
    server.goes_on.set()
    assert server.ended.acquire(timeout=LONG)
    server.send("third")
    assert server.begun.acquire(timeout=LONG)
    assert [goal.id for goal in server.executed] == ["first", "third"]


def test_a_goal_whose_cancel_is_read_while_it_arrives_is_not_executed(
    server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    arrive = LeaseWatch.arrive

    def cancel_meanwhile(watch: LeaseWatch, goal: str) -> None:
        arrive(watch, goal)
        if goal == "first":
            server.cancel(goal)

    monkeypatch.setattr(LeaseWatch, "arrive", cancel_meanwhile)
    server.send("first")
    assert server.text("first") == "cancelled before it began"
    server.send("second")
    assert server.begun.acquire(timeout=LONG)
    assert [goal.id for goal in server.executed] == ["second"]
