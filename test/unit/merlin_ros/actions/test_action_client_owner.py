"""A goal that is sent while the goal on whose behalf it is sent is given up, and one that cannot be sent."""

from types import SimpleNamespace
from typing import Any, List

import pytest
from actionlib_msgs.msg import GoalStatus
from merlin_msgs.msg import ListenAction, ListenGoal

from merlin_ros.actions import action_client
from merlin_ros.actions.action_client import DEAD_OWNERS, ActionClient
from merlin_ros.alarms import Alarm


class Lease:
    """Names the goals of a client; calls `on_hold` with each new one."""

    def __init__(self, topic: str) -> None:
        self.held: List[str] = []
        self.on_hold: Any = lambda: None

    def hold(self, goal: str, owner: str) -> None:
        self.held.append(goal)
        self.on_hold()

    def release(self, goal: str) -> None:
        self.held.remove(goal)


@pytest.fixture
def client(clock: Any, monkeypatch: pytest.MonkeyPatch) -> ActionClient:
    topics = lambda *_, **__: SimpleNamespace()  # noqa: E731
    monkeypatch.setattr(action_client.rospy, "Publisher", topics)
    monkeypatch.setattr(action_client.rospy, "Subscriber", topics)
    monkeypatch.setattr(action_client, "LeaseHolder", Lease)
    monkeypatch.setattr(action_client, "every", lambda period, call: Alarm(call, period))  # never
    return ActionClient("listen", ListenAction)


def test_it_is_not_sent(client: ActionClient, monkeypatch: pytest.MonkeyPatch) -> None:
    sent: List[Any] = []
    monkeypatch.setattr(action_client, "publish", lambda publisher, message: sent.append(message))
    lease: Any = client._lease
    lease.on_hold = lambda: client.give_up_owned("goal of the machine")
    ended: List[Any] = []
    goal = client.send(ListenGoal(), ended.append, owner="goal of the machine")
    assert goal.done and goal.status == GoalStatus.LOST
    assert (ended, sent, lease.held) == ([goal], [], [])


def test_goals_that_were_given_up_do_not_grow_for_ever(client: ActionClient) -> None:
    for number in range(3 * DEAD_OWNERS):
        client.give_up_owned(f"goal {number}")
    assert len(client._dead_owners) <= DEAD_OWNERS
    goal = client.send(ListenGoal(), owner=f"goal {number}")
    assert goal.done and goal.status == GoalStatus.LOST


def test_a_goal_that_cannot_be_sent_leaves_nothing(
    client: ActionClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unwritable(publisher: Any, message: Any) -> None:
        raise OverflowError("float too large to pack")

    monkeypatch.setattr(action_client, "publish", unwritable)
    lease: Any = client._lease
    ended: List[Any] = []
    with pytest.raises(OverflowError):
        client.send(ListenGoal(), ended.append)
    assert (ended, client._goals, lease.held) == ([], {}, [])
