# SPDX-License-Identifier: Apache-2.0
"""A dispatch whose dispatcher hangs: the wait for its end ends, also when no action answers any more."""

import threading
from typing import Any, Callable, Dict, List

import pytest
from actionlib_msgs.msg import GoalID, GoalStatus
from merlin_msgs.msg import DispatchStatus
from rosplan_dispatch_msgs.msg import NonBlockingDispatchResult

from merlin_planning import dispatch_client
from merlin_ros.actions.client_goal import ClientGoal
from merlin_ros.actions.lease import LeaseState
from merlin_test import LONG


class Sent:
    """A dispatch of a dispatcher that takes no cancel, once the goal is sent."""

    def __init__(self, dispatcher: Any, dispatching: Any) -> None:
        self._sent, self._ended = threading.Event(), lambda goal: None
        client = dispatcher.client(cancel_deadline=0.02)
        dispatcher.status(DispatchStatus.IDLE)
        dispatcher.on_dispatch = self._keep
        self._dispatch = dispatching(client)
        assert self._sent.wait(LONG)
        dispatcher.status(DispatchStatus.RUNNING)

    def _keep(self, ended: Callable[[ClientGoal], None]) -> None:
        self._ended = ended
        self._sent.set()

    def succeed(self) -> Any:
        """The dispatcher answers; returns the result."""
        goal = ClientGoal(GoalID(), lambda goal: None, None, None)
        goal.finish(GoalStatus.SUCCEEDED, "", NonBlockingDispatchResult(goal_achieved=True))
        self._ended(goal)
        return self.result()

    def result(self) -> Any:
        """Waits for it."""
        return self._dispatch.result()


@pytest.fixture
def sent(dispatcher: Any, dispatching: Any, monkeypatch: pytest.MonkeyPatch) -> Sent:
    monkeypatch.setattr(dispatch_client, "SLACK", 0.02)
    return Sent(dispatcher, dispatching)


def test_a_dispatcher_that_is_silent_is_cancelled_and_given_up(dispatcher: Any, sent: Sent) -> None:
    dispatcher.lost()
    assert sent.result().timed_out
    assert dispatcher.calls == ["goal", "cancel of the goal", "given up"]


@pytest.mark.parametrize(
    "change", [{"released": True}, {"state": LeaseState.SUSPENDED}, {}], ids=["released", "late", "life"]
)
def test_one_that_lives_is_not(dispatcher: Any, sent: Sent, change: Dict[str, Any]) -> None:
    held: List[str] = [] if change else ["1/plan"]  # restarted, it carries out this plan
    dispatcher.held = held
    dispatcher.lost(**change)
    assert not dispatcher.cancelled.wait(0.1)
    assert sent.succeed().goal_achieved
    assert dispatcher.calls == ["goal"]
