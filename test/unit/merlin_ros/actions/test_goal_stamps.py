"""What a client stamps its goals with when its clock is set back, and which goals an earlier life left."""

from types import SimpleNamespace
from typing import Any, List

import pytest
import rospy
from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray
from merlin_msgs.msg import ListenAction, ListenGoal

from merlin_ros.actions import action_client
from merlin_ros.actions.action_client import ActionClient
from merlin_ros.actions.lease_holder import LIFE
from merlin_ros.alarms import Alarm

LIFE_BEFORE = "0123456789ab"


@pytest.fixture
def sent(clock: Any, monkeypatch: pytest.MonkeyPatch) -> List[Any]:
    """What is published."""
    messages: List[Any] = []
    topics = lambda *_, **__: SimpleNamespace(impl=SimpleNamespace(connections=[]))  # noqa: E731
    monkeypatch.setattr(action_client.rospy, "Publisher", topics)
    monkeypatch.setattr(action_client.rospy, "Subscriber", topics)
    monkeypatch.setattr(action_client.rospy, "get_name", lambda: "/node")
    monkeypatch.setattr(action_client.rospy, "logwarn_throttle", lambda *_: None)
    no_lease = SimpleNamespace(hold=lambda *_: None, release=lambda *_: None)
    monkeypatch.setattr(action_client, "LeaseHolder", lambda _: no_lease)
    monkeypatch.setattr(action_client, "every", lambda period, call: Alarm(call, period))  # never
    monkeypatch.setattr(action_client, "publish", lambda publisher, message: messages.append(message))
    return messages


def hear(client: ActionClient, *goals: GoalID) -> None:
    """The server names goals that it works on."""
    message = GoalStatusArray(status_list=[GoalStatus(goal_id=each, status=1) for each in goals])
    message._connection_header = {"callerid": "/server"}
    client._receive_status(message)


def stamp_of(goal: Any) -> float:
    return float(goal.goal_id.stamp.to_sec())


def test_stamps_of_a_process_never_decrease(sent: List[Any], clock: Any) -> None:
    clients = [ActionClient("back", ListenAction) for _ in range(2)]
    stamps = []
    for now in (100.0, 70.0, 71.0, 130.0):
        clock.set(now)
        stamps += [stamp_of(client.send(ListenGoal())) for client in clients]
    assert stamps == [100.0] * 6 + [130.0] * 2
    clock.set(70.0)
    assert stamp_of(ActionClient("another", ListenAction).send(ListenGoal())) == 70.0


def test_a_new_process_stamps_no_earlier_than_what_the_server_has_taken(sent: List[Any], clock: Any) -> None:
    client = ActionClient("restarted", ListenAction)
    hear(client, GoalID(id="of before", stamp=rospy.Time(500)), GoalID(id="older", stamp=rospy.Time(400)))
    assert stamp_of(client.send(ListenGoal())) == 500.0
    clock.set(501.0)
    hear(client)
    assert stamp_of(client.send(ListenGoal())) == 501.0


@pytest.mark.parametrize(
    "goal_id",
    [
        "/node-3-100.000000000",  # of actionlib
        "/node-smach-3-100.000000000",
        "/node-{life}-3-100.000000000-leased",  # of another client of this process
        f"/node/part-{LIFE_BEFORE}-3-100.000000000-leased",
        f"/other-{LIFE_BEFORE}-3-100.000000000-leased",
        "/node-unnamed-1",
        "/node-dispatch-3-100.000000000-leased",
    ],
)
def test_only_what_a_client_of_merlin_left_is_cancelled(sent: List[Any], goal_id: str) -> None:
    client = ActionClient("shared", ListenAction)
    goal_id = goal_id.format(life=LIFE)
    hear(client, GoalID(id=goal_id))
    assert sent == []
    hear(client, GoalID(id=goal_id), GoalID(id=f"/node-{LIFE_BEFORE}-3-100.000000000-leased"))
    assert [cancel.id for cancel in sent] == [f"/node-{LIFE_BEFORE}-3-100.000000000-leased"]
