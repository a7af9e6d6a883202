# SPDX-License-Identifier: Apache-2.0
"""Suspended goals of a process: which ones, and what is said about each change."""

from typing import List

from merlin_ros.actions.ownership import Ownership


def test_a_goal_is_suspended_from_the_silence_of_its_owner_to_its_return() -> None:
    goals = Ownership()
    assert goals.suspended("drive 1") is False and goals.suspended() is False
    goals.suspend("drive 1", "its client is silent")
    assert goals.suspended("drive 1") is True and goals.suspended() is True
    goals.resume("drive 1")
    assert goals.suspended("drive 1") is False and goals.suspended() is False


def test_one_suspended_goal_says_nothing_about_another() -> None:
    goals = Ownership()
    goals.suspend("drive 1")
    assert goals.suspended("drive 2") is False
    goals.suspend("drive 2")
    goals.resume("drive 1")
    assert goals.suspended("drive 2") is True and goals.suspended() is True


def test_a_listener_hears_each_change_once_and_after_it() -> None:
    goals = Ownership()
    heard: List[bool] = []
    goals.listen(lambda: heard.append(goals.suspended("drive 1")))
    goals.suspend("drive 1")
    goals.suspend("drive 1")
    goals.resume("drive 1")
    goals.resume("drive 1")
    assert heard == [True, False]


def test_a_listener_that_was_removed_hears_nothing() -> None:
    goals = Ownership()
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
