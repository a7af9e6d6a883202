# SPDX-License-Identifier: Apache-2.0
"""Cancels of all goals up to a stamp, and clocks that are set."""

import pytest

from merlin_guard.motion_permit import GuardState, MotionPermit, Send
from merlin_guard.motion_server import ACTIVE, GoalReport

BASE = "/move_base"
S = 1_000_000_000  # ns
DAY = 86_400 * S


class Guarded:
    """A guard and its two clocks, which a test moves."""

    def __init__(self) -> None:
        self.permit = MotionPermit([BASE])
        self.now = 100.0
        self.ros = 500 * S
        self.look()

    def look(self) -> None:
        self.permit.ros_time(self.ros, self.now)

    def pass_by(self, seconds: float) -> None:
        self.now += seconds
        self.ros += round(seconds * S)
        self.look()

    def set_clock(self, step: int) -> None:
        self.ros += step
        self.look()

    def cancel_until(self, stamp: int) -> None:
        self.permit.cancel(BASE, "", stamp, self.now)

    def drives(self, goal_id: str, stamp: int) -> bool:
        """Whether a goal moves the base a second after its begin."""
        self.permit.goal_sent(BASE, goal_id, stamp, self.now)
        for _ in range(20):
            self.pass_by(0.05)
            self.permit.status(BASE, [GoalReport(goal_id, ACTIVE, stamp)], self.now)
            passed = self.permit.command(True, self.now).send is Send.COMMAND
        return passed and self.permit.view.state is GuardState.PASSING


@pytest.fixture
def guarded() -> Guarded:
    return Guarded()


def test_a_goal_that_is_older_than_a_cancel_does_not_drive(guarded: Guarded) -> None:
    guarded.cancel_until(guarded.ros)
    guarded.pass_by(0.1)
    assert not guarded.drives("late", guarded.ros - S)
    assert guarded.drives("new", guarded.ros)


def test_a_cancel_that_is_stamped_ahead_counts_as_now(guarded: Guarded) -> None:
    assert guarded.drives("running", guarded.ros)
    guarded.cancel_until(guarded.ros + DAY)
    assert not guarded.drives("running", guarded.ros - S)
    assert guarded.drives("new", guarded.ros)


@pytest.mark.parametrize("step", [S // 10, 30 * S, 400 * S])
def test_a_goal_drives_after_the_clock_was_set_back(guarded: Guarded, step: int) -> None:
    guarded.cancel_until(guarded.ros)
    guarded.set_clock(-step)
    assert guarded.drives("new", guarded.ros)
    guarded.cancel_until(guarded.ros)
    guarded.pass_by(0.1)
    assert not guarded.drives("late", guarded.ros - S)


def test_a_goal_that_is_stamped_ahead_can_be_cancelled_by_a_stamp(guarded: Guarded) -> None:
    assert guarded.drives("ahead", guarded.ros + DAY)
    guarded.cancel_until(guarded.ros)
    assert not guarded.drives("ahead", guarded.ros + DAY)
