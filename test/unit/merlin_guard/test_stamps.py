"""Cancels of all goals up to a stamp, and a clock that jumps back."""

from merlin_guard.motion_permit import GuardState, MotionPermit, Send
from merlin_guard.motion_server import ACTIVE, GoalReport

BASE = "/move_base"


def drives(permit: MotionPermit, goal: GoalReport, begin: float) -> bool:
    """Whether a goal moves the base a second after its begin."""
    permit.goal_sent(BASE, goal.id, goal.stamp, begin)
    for step in range(20):
        permit.status(BASE, [goal], begin + 0.05 * step)
        passed = permit.command(True, begin + 0.05 * step).send is Send.COMMAND
    return passed and permit.view.state is GuardState.PASSING


def test_a_goal_that_is_older_than_a_cancel_does_not_drive() -> None:
    permit = MotionPermit([BASE])
    permit.cancel(BASE, "", 500.0, 100.0)
    assert not drives(permit, GoalReport("late", ACTIVE, 499.0), 100.1)


def test_a_goal_drives_after_the_clock_has_begun_anew() -> None:
    permit = MotionPermit([BASE])
    permit.cancel(BASE, "", 500.0, 100.0)
    permit.clock_began_anew(100.05)
    assert drives(permit, GoalReport("new", ACTIVE, 3.0), 100.1)
