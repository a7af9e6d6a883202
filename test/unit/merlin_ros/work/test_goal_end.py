# SPDX-License-Identifier: Apache-2.0
"""The ends of a goal have actionlib's numbers."""

from actionlib_msgs.msg import GoalStatus

from merlin_ros.work.goal_end import GoalEnd


def test_numbers_are_those_of_actionlib() -> None:
    assert {end.name: int(end) for end in GoalEnd} == {
        name: getattr(GoalStatus, name)
        for name in ("PREEMPTED", "SUCCEEDED", "ABORTED", "REJECTED", "RECALLED", "LOST")
    }


def test_a_number_that_is_not_an_end_means_aborted() -> None:
    for number in (GoalStatus.PENDING, GoalStatus.ACTIVE, GoalStatus.PREEMPTING, 77, 255):
        assert GoalEnd(number) is GoalEnd.ABORTED


def test_only_what_was_refused_or_taken_back_before_it_ran_cannot_have_done_anything() -> None:
    assert {end.name for end in GoalEnd if not end.begun} == {"REJECTED", "RECALLED"}
