# SPDX-License-Identifier: Apache-2.0
"""Another plan in place of the rest of one that a client has dispatched."""

import queue
import time
from types import SimpleNamespace
from typing import Any

import pytest
import rospy
from actionlib_msgs.msg import GoalID, GoalStatus
from diagnostic_msgs.msg import KeyValue
from merlin_msgs.msg import DispatchStatus
from rosplan_dispatch_msgs.msg import ActionDispatch, ActionFeedback

from merlin_planning import dispatch_client
from merlin_ros.actions.client_goal import ClientGoal
from merlin_ros.service_proxy import ServiceUnavailable
from merlin_test import LONG

NOTHING = "carries out no plan of this node"
PLAN = [
    ActionDispatch(action_id=2, plan_id=7, name="ask"),
    ActionDispatch(action_id=3, plan_id=7, name="ask"),
]


class Driven:
    """A client whose plan has come as far as that two actions run."""

    def __init__(self, dispatcher: Any, dispatching: Any) -> None:
        self.world = dispatcher
        self.ends: queue.Queue[Any] = queue.Queue()
        dispatcher.on_dispatch = self.ends.put
        self.client = dispatcher.client()
        dispatcher.status(DispatchStatus.RUNNING)
        dispatcher.status(DispatchStatus.IDLE)
        self.run = dispatching(self.client, owner="request 1")
        self.ended = self.ends.get(timeout=LONG)
        for number, name in enumerate(("drive", "sing")):
            dispatcher.heard["/dispatcher/action_dispatch"](
                ActionDispatch(action_id=number, plan_id=7, name=name)
            )

    def exchange(self, *args: Any) -> str:
        """As soon as the client knows the goal that it has sent."""
        end = time.monotonic() + LONG
        while True:
            refused = self.client.exchange(*args)
            if NOTHING not in refused or time.monotonic() > end:
                return refused
            time.sleep(0.01)

    @property
    def drive(self) -> Any:
        return self.client.running[0]

    def feedback(self, number: int, status: int, **said: str) -> None:
        information = [KeyValue(*each) for each in said.items()]
        self.world.heard["/dispatcher/action_feedback"](
            ActionFeedback(action_id=number, plan_id=7, status=status, information=information)
        )

    def answer(self) -> None:
        """The dispatcher says that the goals hold."""
        goal = ClientGoal(GoalID(), lambda goal: None, None, None)
        goal.finish(GoalStatus.SUCCEEDED, "", SimpleNamespace(goal_achieved=True))
        self.ended(goal)

    def end(self) -> Any:
        self.answer()
        return self.run.result()


@pytest.fixture
def driven(dispatcher: Any, dispatching: Any, monkeypatch: pytest.MonkeyPatch) -> Driven:
    monkeypatch.setattr(rospy.Time, "now", rospy.Time)
    return Driven(dispatcher, dispatching)


def test_the_dispatch_goes_on_with_the_new_plan(dispatcher: Any, driven: Driven) -> None:
    asked = {}

    def exchange(**fields: Any) -> Any:
        asked.update(fields)
        driven.feedback(1, 10)  # what is dropped may stop before the answer is here
        return SimpleNamespace(refused="")

    dispatcher.on_exchange = exchange
    assert driven.client.can_exchange
    assert driven.exchange(PLAN, [driven.drive]) == ""
    assert asked == {"goal": "goal 1", "keep": [0], "known": [0, 1]}
    assert dispatcher.calls == ["goal", "exchange_plan"]
    assert [action.name for action in driven.client.running] == ["drive"]
    driven.feedback(0, 2)
    result = driven.end()
    assert result.goal_achieved and driven.client.steps_done == 1


def test_the_dispatcher_gets_what_was_known_when_the_plan_was_asked_for(
    dispatcher: Any, driven: Driven
) -> None:
    asked: list[Any] = []
    dispatcher.on_exchange = lambda **fields: asked.append(fields["known"]) or SimpleNamespace(refused="")
    assert driven.exchange(PLAN, [driven.drive], {0}) == ""
    driven.feedback(1, 10)  # dropped by that plan
    assert driven.client.ended == {1}
    assert driven.exchange(PLAN, [driven.drive], {0, *driven.client.ended}) == ""
    assert driven.exchange(PLAN, [driven.drive]) == ""
    assert asked == [[0], [0, 1], [0, 1]]
    driven.end()


def test_what_runs_is_in_the_order_in_which_it_is_to_end(dispatcher: Any, driven: Driven) -> None:
    for number, name, duration in ((2, "wave", 90.0), (3, "nod", 3.0)):
        dispatcher.heard["/dispatcher/action_dispatch"](
            ActionDispatch(action_id=number, plan_id=7, name=name, duration=duration)
        )
    assert [action.name for action in driven.client.running] == ["drive", "sing", "nod", "wave"]


def test_a_dispatch_has_begun_when_the_dispatcher_says_so(dispatcher: Any, driven: Driven) -> None:
    assert not driven.client.begun, "its status is of before"
    dispatcher.status(DispatchStatus.RUNNING)
    assert driven.client.begun
    driven.end()
    assert not driven.client.begun


def test_what_is_dropped_and_does_not_stop_is_known_at_once(driven: Driven) -> None:
    assert driven.exchange(PLAN, [driven.drive]) == ""
    driven.feedback(1, 10, stopped="no")
    assert driven.client.unstopped == ("(sing)",)
    driven.end()


@pytest.mark.parametrize("stopped", ["no", ""])
def test_a_cancel_waits_for_what_is_dropped_although_the_goals_hold(
    dispatcher: Any, driven: Driven, monkeypatch: pytest.MonkeyPatch, stopped: str
) -> None:
    monkeypatch.setattr(dispatch_client, "ANSWER_GRACE", LONG)
    assert driven.exchange(PLAN, [driven.drive]) == ""
    driven.feedback(0, 2)
    driven.client.cancel()
    driven.answer()
    dispatcher.status(DispatchStatus.IDLE)
    driven.feedback(1, 10, stopped=stopped)
    result = driven.run.result()
    assert (result.goal_achieved, result.unstopped) == ((False, ("(sing)",)) if stopped else (True, ()))


def test_the_dispatch_that_runs_is_handed_over(dispatcher: Any, driven: Driven) -> None:
    assert driven.exchange(PLAN, [driven.drive]) == ""
    driven.client.hand_over("request 3")
    driven.end()
    driven.client.hand_over("request 4")
    assert dispatcher.calls == ["goal", "exchange_plan", "goal 1 for request 3"]


@pytest.mark.parametrize("refuses", [True, False])
def test_a_refusal_says_why_and_the_plan_goes_on(dispatcher: Any, driven: Driven, refuses: bool) -> None:
    def exchange(**fields: Any) -> Any:
        if refuses:
            return SimpleNamespace(refused="it ends")
        raise ServiceUnavailable("it does not answer")

    dispatcher.on_exchange = exchange
    refused = driven.exchange(PLAN, [driven.drive])
    assert refused.endswith("it ends" if refuses else "does not exchange its plan: it does not answer")
    assert dispatcher.calls == ["goal", "exchange_plan"]
    assert driven.end().goal_achieved


def test_nothing_is_exchanged_without_a_dispatch_or_behind_its_cancel(
    dispatcher: Any, driven: Driven
) -> None:
    driven.client.cancel()
    for client in (driven.client, dispatcher.client()):
        assert NOTHING in client.exchange(PLAN, [])
    assert "exchange_plan" not in dispatcher.calls
    driven.end()


def test_a_dispatcher_of_rosplan_cannot(dispatcher: Any) -> None:
    assert not dispatcher.client().can_exchange
