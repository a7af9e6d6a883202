# SPDX-License-Identifier: Apache-2.0
"""When a client gives its server up: in virtual time, by the client's own ticks."""

from pathlib import Path
from typing import Dict, List

import pytest
import rospy
from actionlib_msgs.msg import GoalID, GoalStatus

from merlin_ros.actions.client_goal import ClientGoal
from merlin_ros.actions.lease import LASTING
from merlin_ros.actions.server_silence import (
    CONNECTED_SILENCE,
    GONE_SILENCE,
    LATE_RESULT,
    LOOK,
    SILENCE,
    ServerSilence,
)

STALL = 10.0


class Client:
    """A client whose time a test sets."""

    def __init__(self) -> None:
        self.now = 100.0
        self.silence = ServerSilence("/listen", lambda: self.now)
        self.goals: List[ClientGoal] = []

    def send(self, name: str) -> ClientGoal:
        goal = ClientGoal(GoalID(id=name), lambda _: None, None, None, sent=self.silence.look())
        self.goals.append(goal)
        return goal

    def hear(self, **statuses: int) -> List[ClientGoal]:
        """A status list comes."""
        named: Dict[str, GoalStatus] = {
            name: GoalStatus(goal_id=GoalID(id=name), status=status) for name, status in statuses.items()
        }
        return self.silence.hear(named, self.goals)

    def stall(self) -> None:
        self.now += STALL
        self.silence.look()

    def watch(self, seconds: float) -> None:
        """Time passes in which the client looks, and hears nothing."""
        for _ in range(round(seconds / LOOK)):
            self.now += LOOK
            self.silence.look()

    def serve(self, seconds: float, **statuses: int) -> None:
        """Time passes in which it hears the same status again and again."""
        for _ in range(round(seconds / LOOK)):
            self.watch(LOOK)
            self.hear(**statuses)

    def why_lost(self, goal: ClientGoal, publishes: bool = True, connected: bool = True) -> str:
        return self.silence.why_lost(goal, publishes, connected)


def test_the_page_for_robots_says_how_long_a_server_may_be_silent() -> None:
    page = (Path(__file__).resolve().parents[4] / "docs" / "real-robot.md").read_text(encoding="utf-8")
    said = (
        f"counts as dead after {GONE_SILENCE:g} s of silence, one that lacks another connection after "
        f"{SILENCE:g} s, one that is connected after {CONNECTED_SILENCE:g} s;"
    )
    assert said in " ".join(page.split())


@pytest.fixture
def client() -> Client:
    return Client()


def test_a_server_that_has_hung_gets_time_to_read_what_was_sent_meanwhile(client: Client) -> None:
    client.serve(1.0)
    goal = client.send("a")
    client.watch(SILENCE + 1.0)
    client.hear()  # of the thread of its beat, which went on first
    assert client.why_lost(goal) == ""
    client.serve(SILENCE)
    assert client.why_lost(goal) == ""
    client.serve(1.0)
    assert "never acknowledged" in client.why_lost(goal)


@pytest.mark.parametrize(
    ("publishes", "connected", "limit", "why"),
    [
        (False, False, GONE_SILENCE, "is gone"),
        (True, False, SILENCE, "has been silent"),
        (True, True, CONNECTED_SILENCE, "has been silent"),
    ],
)
def test_a_server_that_is_silent_for_enough_looks_is_given_up(
    client: Client, publishes: bool, connected: bool, limit: float, why: str
) -> None:
    goal = client.send("one")
    client.hear(one=GoalStatus.ACTIVE)
    client.watch(limit)
    assert not client.why_lost(goal, publishes, connected)
    client.watch(LOOK)
    assert why in client.why_lost(goal, publishes, connected)


@pytest.mark.parametrize("publishes", [False, True])
def test_a_client_that_was_stalled_has_heard_no_silence(client: Client, publishes: bool) -> None:
    goal = client.send("one")
    client.hear(one=GoalStatus.ACTIVE)
    client.stall()
    assert not client.why_lost(goal, publishes, False)


def test_a_goal_that_is_not_acknowledged_is_given_up(client: Client) -> None:
    goal = client.send("one")
    client.serve(SILENCE)
    assert not client.why_lost(goal)
    client.serve(LOOK)
    assert "never acknowledged" in client.why_lost(goal)


def test_the_first_status_after_a_stall_need_not_name_a_goal(client: Client) -> None:
    goal = client.send("one")
    client.stall()
    client.hear()
    assert not client.why_lost(goal)


def test_a_server_that_works_off_what_was_sent_before_is_not_late(client: Client) -> None:
    first, second, third = (client.send(name) for name in ("first", "second", "third"))
    client.serve(0.8 * SILENCE)
    client.serve(0.8 * SILENCE, first=GoalStatus.ACTIVE)
    client.serve(0.8 * SILENCE, first=GoalStatus.ACTIVE, second=GoalStatus.ACTIVE)
    assert not any(client.why_lost(goal) for goal in (first, second, third))
    client.serve(SILENCE, first=GoalStatus.ACTIVE, second=GoalStatus.ACTIVE)
    assert "never acknowledged" in client.why_lost(third)


def test_a_goal_sent_later_does_not_excuse_an_earlier_one(client: Client) -> None:
    lost = client.send("lost")
    client.serve(0.8 * SILENCE)
    client.send("later")
    client.serve(0.8 * SILENCE, later=GoalStatus.ACTIVE)
    assert "never acknowledged" in client.why_lost(lost)


def test_a_result_that_does_not_come_is_given_up(client: Client) -> None:
    goal = client.send("one")
    client.serve(LATE_RESULT + LOOK, one=GoalStatus.SUCCEEDED)
    assert not client.why_lost(goal)
    client.serve(LOOK, one=GoalStatus.SUCCEEDED)
    assert "without a result" in client.why_lost(goal)


def test_a_result_waits_for_a_client_that_was_stalled(client: Client) -> None:
    goal = client.send("one")
    client.hear(one=GoalStatus.SUCCEEDED)
    client.stall()
    assert not client.why_lost(goal)


def test_a_client_that_works_off_results_does_not_miss_the_next(client: Client) -> None:
    first, second = client.send("first"), client.send("second")
    ended = {"first": GoalStatus.SUCCEEDED, "second": GoalStatus.SUCCEEDED}
    client.serve(0.8 * LATE_RESULT, **ended)
    client.silence.settle(first)
    client.serve(0.8 * LATE_RESULT, **ended)
    assert not client.why_lost(second)
    client.serve(LATE_RESULT, **ended)
    assert "without a result" in client.why_lost(second)


def test_the_result_of_a_goal_that_ended_later_does_not_excuse_an_earlier_one(client: Client) -> None:
    lost, later = client.send("lost"), client.send("later")
    client.serve(0.8 * LATE_RESULT, lost=GoalStatus.SUCCEEDED, later=GoalStatus.ACTIVE)
    client.serve(LOOK, lost=GoalStatus.SUCCEEDED, later=GoalStatus.SUCCEEDED)
    client.silence.settle(later)
    client.serve(0.4 * LATE_RESULT, lost=GoalStatus.SUCCEEDED)
    assert "without a result" in client.why_lost(lost)


def test_what_answers_after_a_time_without_a_server_is_another_process(client: Client) -> None:
    goal = client.send("one")
    client.hear()
    client.watch(GONE_SILENCE)
    client.silence.part(client.goals)
    client.serve(GONE_SILENCE)
    assert not client.why_lost(goal)
    client.serve(LOOK)
    assert "never acknowledged" in client.why_lost(goal)


def test_a_goal_that_the_server_no_longer_names_is_forgotten(client: Client) -> None:
    seen, ended, new = client.send("seen"), client.send("ended"), client.send("new")
    assert client.hear(seen=GoalStatus.ACTIVE, ended=GoalStatus.ABORTED) == []
    assert client.hear() == [seen]
    assert ended.ended_on_server is not None and not new.seen


def test_the_end_of_an_earlier_goal_of_the_same_id_is_not_that_of_the_next_one(client: Client) -> None:
    sent, earlier = (GoalID(rospy.Time(at), f"one{LASTING}") for at in (7, 6))
    goal = ClientGoal(sent, lambda _: None, None, None, sent=client.silence.look())
    client.goals.append(goal)
    ended = GoalStatus(goal_id=earlier, status=GoalStatus.SUCCEEDED)
    assert client.silence.hear({goal.id: ended}, client.goals) == [] and not goal.seen
    client.serve(2 * LATE_RESULT, **{goal.id: GoalStatus.ACTIVE})
    assert client.why_lost(goal) == ""
