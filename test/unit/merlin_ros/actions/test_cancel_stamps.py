"""Cancels that come before their goals, or of all up to a stamp while the clock jumps back; floods."""

from types import SimpleNamespace
from typing import Any, List

import pytest
import rospy
from actionlib_msgs.msg import GoalID
from merlin_msgs.msg import ListenAction, ListenActionGoal

from merlin_ros.actions.action_server import EARLY_CANCELS, ENDED, ActionServer, ServerGoal


@pytest.fixture
def goals(clock: Any) -> List[ServerGoal]:
    """Those that the server below was given."""
    return []


@pytest.fixture
def server(goals: List[ServerGoal]) -> ActionServer:
    made = ActionServer("listen", ListenAction, goals.append, lambda goal: None)
    silent = SimpleNamespace(publish=lambda message: None)
    made._status_publisher = made._result_publisher = silent  # type: ignore[assignment]
    return made


def send(server: ActionServer, name: str, stamp: float) -> None:
    server._receive_goal(ListenActionGoal(goal_id=GoalID(id=name, stamp=rospy.Time(stamp))))


def test_goals_up_to_the_stamp_are_cancelled(server: ActionServer, goals: List[ServerGoal]) -> None:
    server._receive_cancel(GoalID(stamp=rospy.Time(100)))
    send(server, "late", 99)
    send(server, "new", 101)
    assert [goal.id for goal in goals] == ["new"]


def test_goals_are_taken_after_the_clock_has_jumped_back(
    server: ActionServer, goals: List[ServerGoal], clock: Any
) -> None:
    server._receive_cancel(GoalID(stamp=rospy.Time(100)))
    clock.set(3.0)
    send(server, "new", 3)
    clock.set(120.0)
    send(server, "later", 50)
    assert [goal.id for goal in goals] == ["new", "later"]


def test_cancels_that_come_before_their_goals_do_not_grow_for_ever(
    server: ActionServer, goals: List[ServerGoal]
) -> None:
    for number in range(EARLY_CANCELS + 2):
        server._receive_cancel(GoalID(id=str(number)))
        server._receive_cancel(GoalID(id="0"))  # once more: it is the youngest again
    assert len(server._early_cancels) == EARLY_CANCELS
    for name in ("0", "2", "3"):
        send(server, name, 1)
    assert [goal.id for goal in goals] == ["2"]


def test_the_status_list_of_a_flood_of_goals_names_the_last_ones(
    server: ActionServer, goals: List[ServerGoal]
) -> None:
    for number in range(ENDED + 20):
        send(server, str(number), 1)
        if number != 3:
            goals[-1].reject()
    assert len(server._goals) == ENDED + 1
    assert "3" in server._goals and "19" not in server._goals and "20" in server._goals
