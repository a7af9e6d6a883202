# SPDX-License-Identifier: Apache-2.0
"""A goal that is sent while the goal on whose behalf it is sent is given up, and one that cannot be sent.

And one that is sent twice, as one that survives is looked for: each sending has the answer.
"""

from typing import Any, Iterator, List

import pytest
import rospy
from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray
from fakes.topics import Topics
from merlin_msgs.msg import ListenAction, ListenActionFeedback, ListenActionResult, ListenGoal

from merlin_ros.actions import action_client
from merlin_ros.actions.action_client import DEAD_OWNERS, ActionClient
from merlin_ros.actions.client_goal import ClientGoal
from merlin_ros.alarms import Alarm


@pytest.fixture
def topics(clock: Any, monkeypatch: pytest.MonkeyPatch) -> Topics:
    monkeypatch.setattr(action_client, "every", lambda period, call: Alarm(call, period))  # never
    monkeypatch.setattr(rospy, "get_name", lambda: "/client")
    return Topics(monkeypatch)


@pytest.fixture
def client(topics: Topics) -> Iterator[ActionClient]:
    made = ActionClient("owned", ListenAction)
    yield made
    made.shutdown()


def leased(topics: Topics) -> List[str]:
    """The goals that the last lease names."""
    leases = topics.published("/owned/lease")
    held = leases.get_nowait().held
    while not leases.empty():
        held = leases.get_nowait().held
    return list(held)


def test_it_is_not_sent(client: ActionClient, topics: Topics) -> None:
    def before(topic: str, message: Any) -> None:
        if topic == "/owned/lease":
            client.give_up_owned("goal of the machine")

    topics.before = before
    ended: List[Any] = []
    goal = client.send(ListenGoal(), ended.append, owner="goal of the machine")
    assert goal.done and goal.status == GoalStatus.LOST and ended == [goal]
    assert topics.published("/owned/goal").empty() and leased(topics) == []


def test_of_owners_that_were_given_up_the_last_ones_are_remembered(client: ActionClient) -> None:
    for number in range(3 * DEAD_OWNERS):
        client.give_up_owned(f"goal {number}")
    assert client.send(ListenGoal(), owner=f"goal {number}").status == GoalStatus.LOST
    assert not client.send(ListenGoal(), owner="goal 0").done, "they do not grow for ever"


def test_only_another_owner_is_said(client: ActionClient, topics: Topics) -> None:
    goal = client.send(ListenGoal(), owner="one")
    assert leased(topics) == [goal.id]
    client.hand_over(goal, "one")
    assert topics.published("/owned/lease").empty()
    client.hand_over(goal, "other")
    assert leased(topics) == [goal.id]


def test_a_goal_that_cannot_be_sent_leaves_nothing(topics: Topics) -> None:
    def unwritable(topic: str, message: Any) -> None:
        if topic == "/owned/goal":
            raise OverflowError("float too large to pack")

    client = ActionClient("owned", ListenAction)
    topics.before = unwritable
    ended: List[Any] = []
    with pytest.raises(OverflowError):
        client.send(ListenGoal(), ended.append)
    assert leased(topics) == []
    client.shutdown()
    assert ended == [] and topics.published("/owned/cancel").empty()


@pytest.fixture
def ended() -> List[ClientGoal]:
    return []


@pytest.fixture
def reported() -> List[ClientGoal]:
    return []


@pytest.fixture
def twice(client: ActionClient, ended: List[ClientGoal], reported: List[ClientGoal]) -> List[ClientGoal]:
    first = client.send(ListenGoal(), ended.append, lambda goal, _: reported.append(goal), lasting=True)
    second = client.send(
        ListenGoal(), ended.append, lambda goal, _: reported.append(goal), lasting=True, again=first.id
    )
    assert first.id == second.id
    return [first, second]


def status(goal: ClientGoal, state: int, text: str = "") -> GoalStatus:
    return GoalStatus(goal_id=GoalID(id=goal.id), status=state, text=text)


def test_both_get_the_result(topics: Topics, twice: List[ClientGoal], ended: List[ClientGoal]) -> None:
    message = ListenActionResult(status=status(twice[1], GoalStatus.SUCCEEDED, "done"))
    message.header.stamp = rospy.Time(12.5)
    topics.send("/owned/result", message)
    assert [(goal.done, goal.status, goal.text, goal.ended_at) for goal in twice] == [
        (True, GoalStatus.SUCCEEDED, "done", 12.5)
    ] * 2
    assert sorted(map(twice.index, ended)) == [0, 1]


@pytest.mark.parametrize(
    "state", [GoalStatus.PENDING, GoalStatus.ACTIVE, GoalStatus.PREEMPTING, GoalStatus.RECALLING, 77]
)
def test_a_result_whose_status_is_not_an_end_has_the_goal_stopped(
    client: ActionClient, topics: Topics, state: int
) -> None:
    goal = client.send(ListenGoal())
    topics.send("/owned/result", ListenActionResult(status=status(goal, state, "lid open")))
    assert goal.done and goal.status == GoalStatus.LOST
    assert f"status {state}, which is not an end: lid open" in goal.text
    assert topics.published("/owned/cancel").get_nowait().id == goal.id and leased(topics) == []


def test_both_get_the_feedback(topics: Topics, twice: List[ClientGoal], reported: List[ClientGoal]) -> None:
    topics.send("/owned/feedback", ListenActionFeedback(status=status(twice[1], GoalStatus.ACTIVE)))
    assert sorted(map(twice.index, reported)) == [0, 1]


def test_both_know_that_it_runs(topics: Topics, twice: List[ClientGoal]) -> None:
    message = GoalStatusArray(status_list=[status(twice[1], GoalStatus.ACTIVE)])
    topics.send("/owned/status", message)
    assert [goal.status for goal in twice] == [GoalStatus.ACTIVE] * 2


def test_both_end_with_the_client(topics: Topics) -> None:
    client = ActionClient("owned", ListenAction)
    first = client.send(ListenGoal(), lasting=True)
    second = client.send(ListenGoal(), lasting=True, again=first.id)
    client.shutdown()
    assert [goal.status for goal in (first, second)] == [GoalStatus.LOST] * 2


def test_all_that_a_server_forgot_end_though_the_first_ends_the_client(topics: Topics) -> None:
    client = ActionClient("owned", ListenAction)
    goals = [client.send(ListenGoal(), lambda goal: client.shutdown()) for _ in range(3)]
    topics.send("/owned/status", GoalStatusArray(status_list=[status(goal, 1) for goal in goals]))
    topics.send("/owned/status", GoalStatusArray())
    assert [goal.status for goal in goals] == [GoalStatus.LOST] * 3


def test_what_cannot_be_sent_again_ends_nothing(
    topics: Topics, client: ActionClient, ended: List[ClientGoal]
) -> None:
    first = client.send(ListenGoal(), ended.append, lasting=True)

    def unwritable(topic: str, message: Any) -> None:
        raise OverflowError("float too large to pack")

    topics.before = unwritable
    with pytest.raises(OverflowError):
        client.send(ListenGoal(), lasting=True, again=first.id)
    topics.before = lambda topic, message: None
    topics.send("/owned/result", ListenActionResult(status=status(first, GoalStatus.SUCCEEDED)))
    assert ended == [first]
