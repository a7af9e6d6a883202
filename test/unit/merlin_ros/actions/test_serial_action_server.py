"""A server of one goal at a time whose code fails when it is told to cancel."""

import threading
from types import SimpleNamespace
from typing import Any, Iterator, List

import pytest
import rospy
from actionlib_msgs.msg import GoalID, GoalStatus
from merlin_msgs.msg import ListenAction, ListenActionGoal

from merlin_ros.actions.action_server import ServerGoal
from merlin_ros.actions.serial_action_server import SerialActionServer

LONG = 60.0


class Server:
    """Executes goals until they are cancelled."""

    def __init__(self) -> None:
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
        self.serial.server._receive_goal(ListenActionGoal(goal_id=goal_id))

    def _execute(self, goal: ServerGoal) -> None:
        self.executed.append(goal)
        self.begun.release()
        assert goal.cancel_event.wait(LONG) and self.goes_on.wait(LONG)
        goal.cancelled(text="stopped")
        self.ended.release()

    def _cancel(self, goal: ServerGoal) -> None:
        self.cancels.append(goal.id)
        raise OSError("the microphone does not answer")


@pytest.fixture
def server(clock: Any, monkeypatch: pytest.MonkeyPatch) -> Iterator[Server]:
    monkeypatch.setattr(rospy, "logerr", lambda *_: None)
    topic = SimpleNamespace(impl=None, publish=lambda message: None, unregister=lambda: None)
    for kind in ("Publisher", "Subscriber"):
        monkeypatch.setattr(rospy, kind, lambda *_, **__: topic)
    made = Server()
    yield made
    made.serial.shutdown()
    assert "action /listen" not in [thread.name for thread in threading.enumerate()]


def test_a_cancel_that_fails_costs_the_newer_goal_nothing(server: Server) -> None:
    server.send("first")
    assert server.begun.acquire(timeout=LONG)
    server.send("second")
    assert server.ended.acquire(timeout=LONG)
    assert server.begun.acquire(timeout=LONG)
    first, second = server.executed
    assert first.status == GoalStatus.PREEMPTED
    assert not second.done
    server.serial.server._receive_cancel(GoalID(id="second"))
    assert server.ended.acquire(timeout=LONG)
    assert second.status == GoalStatus.PREEMPTED and second._status.text == "stopped"


def test_a_cancel_that_failed_is_tried_with_the_next_one(server: Server) -> None:
    server.goes_on.clear()  # it does not stop by itself
    server.send("first")
    assert server.begun.acquire(timeout=LONG)
    server.send("second")
    (first,) = server.executed
    for _ in range(2):
        server.serial.server._receive_cancel(GoalID(id="first"))
    assert server.cancels == ["first"] * 3 and not first.done
    assert first._status.text == "it is not stopped: OSError: the microphone does not answer"
    server.goes_on.set()
    assert server.begun.acquire(timeout=LONG)
    assert server.executed[1].status == GoalStatus.ACTIVE


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
