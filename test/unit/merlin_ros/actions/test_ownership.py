# SPDX-License-Identifier: Apache-2.0
"""Suspended goals of a process: which ones, and what is said about each change."""

import threading
from typing import List, Optional

import pytest
import rospy
from actionlib_msgs.msg import GoalID
from fakes.topics import Topics
from merlin_msgs.msg import Lease, ListenAction, ListenActionGoal

from merlin_ros.actions import hang_watch, lease_watch
from merlin_ros.actions.action_server import ActionServer, ServerGoal
from merlin_ros.actions.hang_watch import HUNG, SETTLE, HangWatch
from merlin_ros.actions.lease import LeaseState
from merlin_ros.actions.ownership import Ownership, ownership
from merlin_ros.alarms import Alarm
from merlin_test import LONG


def test_a_goal_is_suspended_from_the_silence_of_its_owner_to_its_return() -> None:
    goals = Ownership(HangWatch())  # which has not begun: this process may hang
    assert goals.suspended("drive 1") is False and goals.suspended() is False
    goals.suspend("drive 1")
    assert goals.suspended("drive 1") is True and goals.suspended() is True
    goals.resume("drive 1")
    assert goals.suspended("drive 1") is False and goals.suspended() is False


def test_one_suspended_goal_says_nothing_about_another() -> None:
    goals = Ownership(HangWatch())
    goals.suspend("drive 1")
    assert goals.suspended("drive 2") is False
    goals.suspend("drive 2")
    goals.resume("drive 1")
    assert goals.suspended("drive 2") is True and goals.suspended() is True


def test_all_goals_are_suspended_until_what_came_during_a_hang_is_read() -> None:
    now = [100.0]
    watch = HangWatch(lambda: now[0])
    goals = Ownership(watch)
    watch.beat()
    assert not goals.suspended("drive 1")
    now[0] += 2 * HUNG
    assert goals.suspended("drive 1") and goals.suspended()
    watch.beat()
    assert goals.suspended("drive 1")
    now[0] += SETTLE
    assert not goals.suspended("drive 1") and not goals.suspended()


def test_a_listener_hears_each_change_once_and_after_it() -> None:
    goals = Ownership(HangWatch())
    heard: List[bool] = []
    goals.listen(lambda: heard.append(goals.suspended("drive 1")))
    goals.suspend("drive 1")
    goals.suspend("drive 1")
    goals.resume("drive 1")
    goals.resume("drive 1")
    assert heard == [True, False]


def test_a_listener_that_was_removed_hears_nothing() -> None:
    goals = Ownership(HangWatch())
    first: List[bool] = []
    second: List[bool] = []

    def listener() -> None:
        first.append(goals.suspended())

    goals.listen(listener)
    goals.listen(lambda: second.append(goals.suspended()))
    goals.ignore(listener)
    goals.ignore(listener)
    goals.suspend("drive 1")
    assert (first, second) == ([], [True])


def test_an_owner_that_comes_back_while_its_goal_is_taken_is_not_taken_for_silent(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    topics, taker, back = Topics(monkeypatch), threading.current_thread(), threading.Event()
    monkeypatch.setattr(rospy.Time, "now", lambda: rospy.Time(1))
    monkeypatch.setattr(lease_watch, "every", lambda period, call: Alarm(call, period))  # no time passes
    monkeypatch.setattr(hang_watch, "HUNG", LONG)  # this process may

    def lease(*suspended: str) -> None:
        topics.send("/listen/lease", Lease(owner="/other", life="1", held=["goal"], suspended=suspended))

    def on_owner(_: ServerGoal, state: LeaseState, __: str) -> Optional[bool]:
        if threading.current_thread() is not taker:  # that of the watch, which is first with all that it says
            if state is LeaseState.HELD:
                back.set()
            return False
        if state is LeaseState.SUSPENDED:
            lease()
            assert back.wait(LONG)
        return None

    server = ActionServer("listen", ListenAction, lambda goal: None, lambda goal: None, on_owner)
    server.start()
    lease("goal")
    topics.send("/listen/goal", ListenActionGoal(goal_id=GoalID(id="goal", stamp=rospy.Time(1))))
    suspended = ownership.suspended("goal")
    server.shutdown()
    assert back.is_set() and not suspended
