# SPDX-License-Identifier: Apache-2.0
"""Requests of several threads, and one that cannot wait for a lost Executor."""

import threading
from types import SimpleNamespace
from typing import Any, Callable, List

import pytest
import rospy
from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray
from fakes.topics import Topics
from merlin_msgs.msg import ExecuteAction, ExecuteGoal, ExecuteResult

from merlin_executor import executor_client
from merlin_executor.executor_client import MerlinExecutorClient
from merlin_executor.executor_request import ExecutorRequest
from merlin_executor.resending import RESEND
from merlin_ros.actions.action_client import ActionClient

LONG = 60.0


class Request:
    """A request that has not ended; something happens when that is asked for the first time."""

    def __init__(self) -> None:
        self.cancelled = False
        self.asked: Callable[[], None] = lambda: None

    @property
    def done(self) -> bool:
        asked, self.asked = self.asked, lambda: None
        asked()
        return False

    def cancel(self) -> None:
        self.cancelled = True


def test_all_are_cancelled(monkeypatch: pytest.MonkeyPatch) -> None:
    sent: List[Request] = []

    def request(*_: Any) -> Request:
        sent.append(Request())
        return sent[-1]

    monkeypatch.setattr(executor_client, "ActionClient", lambda *_: SimpleNamespace())
    monkeypatch.setattr(executor_client, "ExecutorRequest", request)
    client = MerlinExecutorClient(knowledge_base=None)
    client.send("(checked hall)")
    other = threading.Thread(target=client.send, args=["(checked door)"], daemon=True)
    sent[0].asked = other.start  # another thread begins while this one takes the next request down
    client.send("(checked kitchen)")
    other.join(LONG)
    client.cancel_all()
    assert [request.cancelled for request in sent] == [True] * 3


def test_a_request_that_cannot_wait_for_a_lost_executor_ends(
    monkeypatch: pytest.MonkeyPatch, clock: Any
) -> None:
    def no_thread(thread: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(rospy, "get_name", lambda: "/mission")
    topics = Topics(monkeypatch)
    client = ActionClient("merlin/execute", ExecuteAction)
    request = ExecutorRequest(client, ExecuteGoal(), on_lost=RESEND)
    status = GoalStatus(goal_id=GoalID(id=request.id), status=GoalStatus.ACTIVE)
    topics.send("/merlin/execute/status", GoalStatusArray(status_list=[status]))
    with monkeypatch.context() as short_of_threads:
        short_of_threads.setattr(threading.Thread, "start", no_thread)
        topics.send("/merlin/execute/status", GoalStatusArray())  # of another Executor: it knows no goal
    assert request.done and request.result is not None
    assert request.result.outcome == ExecuteResult.INTERNAL
    assert "can't start new thread" in request.result.reason
    client.shutdown()
