# SPDX-License-Identifier: Apache-2.0
"""Stamps when a clock is set back: of goals, in their order of sending, and of goals of an earlier life."""

from typing import Any

import pytest
import rospy
from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray
from fakes.topics import Topics
from merlin_msgs.msg import ListenAction, ListenGoal

from merlin_ros.actions import action_client, lease_holder
from merlin_ros.actions.action_client import ActionClient
from merlin_ros.actions.lease_holder import LIFE
from merlin_ros.actions.sending_order import SendingOrder
from merlin_ros.alarms import Alarm

LIFE_BEFORE = "0123456789ab"


@pytest.fixture
def topics(clock: Any, monkeypatch: pytest.MonkeyPatch) -> Topics:
    monkeypatch.setattr(rospy, "get_name", lambda: "/node")
    monkeypatch.setattr(rospy, "logwarn_throttle", lambda *_: None)
    for module in (action_client, lease_holder):
        monkeypatch.setattr(module, "every", lambda period, call: Alarm(call, period))  # never
    return Topics(monkeypatch)


def hear(topics: Topics, client: ActionClient, *goals: GoalID) -> None:
    """The server names goals that it works on."""
    message = GoalStatusArray(status_list=[GoalStatus(goal_id=each, status=1) for each in goals])
    topics.send(f"{client.name}/status", message, {"callerid": "/server"})


def stamp_of(goal: Any) -> float:
    return float(goal.goal_id.stamp.to_sec())


def test_stamps_of_a_process_never_decrease(topics: Topics, clock: Any) -> None:
    clients = [ActionClient("back", ListenAction) for _ in range(2)]
    stamps = []
    for now in (100.0, 70.0, 71.0, 130.0):
        clock.set(now)
        stamps += [stamp_of(client.send(ListenGoal())) for client in clients]
    assert stamps == [100.0] * 6 + [130.0] * 2
    clock.set(70.0)
    assert stamp_of(ActionClient("another", ListenAction).send(ListenGoal())) == 70.0


def test_a_new_process_stamps_no_earlier_than_what_the_server_has_taken(topics: Topics, clock: Any) -> None:
    client = ActionClient("restarted", ListenAction)
    hear(
        topics,
        client,
        GoalID(id="of before", stamp=rospy.Time(500)),
        GoalID(id="older", stamp=rospy.Time(400)),
    )
    assert stamp_of(client.send(ListenGoal())) == 500.0
    clock.set(501.0)
    hear(topics, client)
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
def test_only_what_a_client_of_merlin_left_is_cancelled(topics: Topics, goal_id: str) -> None:
    client = ActionClient("shared", ListenAction)
    goal_id = goal_id.format(life=LIFE)
    hear(topics, client, GoalID(id=goal_id))
    cancels = topics.published("/shared/cancel")
    assert cancels.empty()
    hear(topics, client, GoalID(id=goal_id), GoalID(id=f"/node-{LIFE_BEFORE}-3-100.000000000-leased"))
    assert cancels.get_nowait().id == f"/node-{LIFE_BEFORE}-3-100.000000000-leased" and cancels.empty()


def test_before_the_first_look_a_stamp_is_where_it_says() -> None:
    order = SendingOrder()
    assert order.place(70) == order.sent(70) == 70
    assert order.look(100) == 0
    assert order.place(100) == 100


def test_what_is_stamped_ahead_of_the_clock_was_sent_now() -> None:
    order = SendingOrder()
    order.look(100)
    assert (order.place(90), order.sent(90)) == (90, 90)
    assert (order.place(130), order.sent(130)) == (130, 100)
    assert order.look(120) == 20
    assert (order.place(130), order.sent(130)) == (130, 120)


def test_after_a_step_back_of_the_clock_what_is_stamped_comes_later() -> None:
    order = SendingOrder()
    order.look(100)
    before = order.place(100)
    assert order.look(40) == 1
    assert order.place(40) == before + 1
    assert order.look(45) == 5
    assert order.place(45) == order.sent(45) == before + 6
    assert order.place(40) == before + 1
