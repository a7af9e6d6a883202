# SPDX-License-Identifier: Apache-2.0
"""A cancel while a dispatcher of ROSPlan's does something that its client has not seen."""

import threading
from types import SimpleNamespace
from typing import Any, Callable, List

import pytest
import rospy
from diagnostic_msgs.msg import KeyValue
from rosplan_dispatch_msgs.msg import ActionDispatch, ActionFeedback
from rosplan_dispatch_msgs.srv import DispatchServiceResponse
from rosplan_knowledge_msgs.msg import DomainFormula

from merlin_planning import dispatch_client
from merlin_planning.dispatch_progress import CANCEL_ACTION, DispatchResult
from merlin_test import LONG

PAINT = ActionDispatch(action_id=3, name="paint", parameters=[KeyValue("part", "leg")])


class Blind:
    """A dispatch that runs, and whose client has seen nothing of it."""

    def __init__(self, dispatcher: Any, dispatching: Any) -> None:
        self.on_cancel: List[Callable[[], None]] = []
        self.passed_on: List[ActionDispatch] = []
        self._dispatcher = dispatcher
        self._called, self._ends = threading.Event(), threading.Event()
        dispatcher.published = []
        dispatcher.on_call = self._run
        dispatcher.on_cancel = lambda: self.on_cancel.pop(0)() if self.on_cancel else None
        client = dispatcher.client(cancel_deadline=LONG)
        dispatcher.heard["/kb/pddl_action_parameters"](DomainFormula(name="paint"))
        self._dispatch = dispatching(client, plan=[PAINT])
        assert self._called.wait(LONG)

    def _run(self) -> DispatchServiceResponse:
        self._called.set()
        assert self._ends.wait(LONG)
        return DispatchServiceResponse(success=True, goal_achieved=False)

    def send(self) -> None:
        """The client sees the action."""
        self._dispatcher.heard["/dispatcher/action_dispatch"](PAINT)

    def answer(self, status: int, reason: str = "") -> None:
        """An interface answers for it."""
        information = [KeyValue("reason", reason)] if reason else []
        answer = ActionFeedback(action_id=3, status=status, information=information)
        self._dispatcher.heard["/dispatcher/action_feedback"](answer)

    def publish(self, cancel: ActionDispatch) -> None:
        """The client cancels an action; its interface stops it."""
        self.passed_on.append(cancel)
        self.answer(ActionFeedback.ACTION_FAILED, "cancelled")
        self.end()

    def end(self) -> None:
        """The dispatcher answers."""
        self._ends.set()

    def cancelled(self) -> DispatchResult:
        """The client cancels; returns the end."""
        self._dispatch.interrupt()
        result: DispatchResult = self._dispatch.result()
        return result


@pytest.fixture
def blind(dispatcher: Any, dispatching: Any, monkeypatch: pytest.MonkeyPatch) -> Blind:
    monkeypatch.setattr(dispatch_client, "BEGIN_WAIT", 0.0)
    monkeypatch.setattr(rospy.Time, "now", lambda: rospy.Time(1))
    made: List[Blind] = []
    monkeypatch.setattr(
        rospy, "Publisher", lambda *_, **__: SimpleNamespace(publish=lambda each: made[0].publish(each))
    )
    made.append(Blind(dispatcher, dispatching))
    return made[0]


def test_a_dispatcher_that_shows_nothing_is_cancelled(dispatcher: Any, blind: Blind) -> None:
    blind.on_cancel = [blind.end]
    result = blind.cancelled()
    assert (result.cancelled, result.timed_out, result.unstopped) == (True, False, ())
    assert dispatcher.calls == ["dispatch_plan", "cancel_dispatch"] and not blind.passed_on


def test_an_action_that_was_missed_and_runs_is_cancelled(dispatcher: Any, blind: Blind) -> None:
    blind.answer(ActionFeedback.ACTION_ENABLED)
    result = blind.cancelled()
    assert (result.cancelled, result.timed_out, result.unstopped) == (True, False, ())
    assert [(each.name, each.action_id, each.parameters) for each in blind.passed_on] == [
        (CANCEL_ACTION, 3, PAINT.parameters)
    ]
    assert dispatcher.calls == ["dispatch_plan", "cancel_dispatch"]


def test_a_cancel_that_came_before_the_plan_is_sent_again(dispatcher: Any, blind: Blind) -> None:
    blind.on_cancel = [blind.send]
    result = blind.cancelled()
    assert (result.cancelled, result.timed_out, result.unstopped) == (True, False, ())
    assert len(blind.passed_on) == 1
    assert dispatcher.calls == ["dispatch_plan", "cancel_dispatch", "cancel_dispatch"]


def test_an_action_that_is_seen_behind_its_end_has_ended(blind: Blind) -> None:
    blind.answer(ActionFeedback.ACTION_ENABLED)
    blind.on_cancel = [lambda: (blind.answer(ActionFeedback.ACTION_FAILED, "cancelled"), blind.send())]
    result = blind.cancelled()
    assert (result.cancelled, result.timed_out, result.unstopped) == (True, False, ())
