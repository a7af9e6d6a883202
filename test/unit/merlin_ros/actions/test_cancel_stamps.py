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
    send(server, "late", 99)  # "new" is of a node to which the tick of the clock came first
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


def test_a_cancel_that_is_stamped_ahead_counts_as_now(
    server: ActionServer, goals: List[ServerGoal], clock: Any
) -> None:
    send(server, "running", 100)
    server._receive_cancel(GoalID(stamp=rospy.Time(86_500)))
    assert goals[0].cancel_requested
    for now in (100.02, 200.0):
        clock.set(now)
        send(server, f"of {now}", int(now) + 1)
    assert [goal.id for goal in goals] == ["running", "of 100.02", "of 200.0"]


def test_a_clock_that_is_set_back_after_a_cancel_refuses_no_goal(
    server: ActionServer, goals: List[ServerGoal], clock: Any
) -> None:
    server._receive_cancel(GoalID(stamp=rospy.Time(100)))
    clock.set(110.0)
    server._receive_cancel(GoalID(id="another"))  # it looks at the clock
    clock.set(90.0)
    send(server, "new", 90)
    server._receive_cancel(GoalID(stamp=rospy.Time(90)))
    clock.set(91.0)
    send(server, "late", 89)
    assert [goal.id for goal in goals] == ["new"] and goals[0].cancel_requested


def test_a_goal_that_is_stamped_ahead_can_be_cancelled_by_a_stamp(
    server: ActionServer, goals: List[ServerGoal], clock: Any
) -> None:
    send(server, "ahead", 86_500)
    clock.set(101.0)
    server._receive_cancel(GoalID(stamp=rospy.Time(101)))
    assert goals[0].cancel_requested


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


def test_what_raises_in_a_cancel_has_not_stopped_the_goal(goals: List[ServerGoal], clock: Any) -> None:
    tried: List[str] = []

    def cancel(goal: ServerGoal) -> None:
        tried.append(goal.id)
        if len(tried) < 3:
            raise RuntimeError("can't start new thread")

    made = ActionServer("listen", ListenAction, goals.append, cancel)
    made._status_publisher = made._result_publisher = SimpleNamespace(  # type: ignore[assignment]
        publish=lambda message: None
    )
    statuses: List[Any] = []
    made._status_publisher.publish = lambda message: statuses.extend(message.status_list)  # type: ignore
    send(made, "drive", 100)
    for _ in range(4):
        made._receive_cancel(GoalID(id="drive"))
        assert goals[0].cancel_requested and not goals[0].done
        said = statuses[-1].text
        assert said == "it is not stopped: RuntimeError: can't start new thread"
    assert len(tried) == 3, "what has stopped it is not called again"
