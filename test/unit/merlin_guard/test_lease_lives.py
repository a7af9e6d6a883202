"""The guard and goals whose client died before its first lease, or was restarted."""

from merlin_guard.lease_book import BaseOwnership, GuardLeases
from merlin_guard.motion_permit import LEASED, MotionPermit, Send, State
from merlin_guard.motion_server import GoalReport
from merlin_guard.settings import GuardSettings

ACTIVE = 1


def test_a_late_lease_of_a_former_life_costs_the_new_one_nothing():
    book = GuardLeases(GuardSettings())
    book.receive("/client", "a", ["old"], [], 0.0)
    book.receive("/client", "b", ["new"], [], 0.1)
    book.receive("/client", "a", ["old"], [], 0.2)
    assert book.claim("new", 0.2).ownership is BaseOwnership.HELD
    assert book.claim("old", 0.2).ownership is BaseOwnership.LOST


def passing(goal_id: str) -> bool:
    """Whether a goal that no lease names still moves the base after a second."""
    permit = MotionPermit(["/move_base"])
    for tick in range(11):
        now = 100.0 + tick / 10
        permit.status("/move_base", [GoalReport(goal_id, ACTIVE, 1.0, False)], now)
        sent = permit.command(True, now).send
    return sent is Send.COMMAND and permit.view.state is State.PASSING


def test_a_goal_that_says_it_is_leased_does_not_move_without_a_lease():
    assert passing("/rviz-1")
    assert not passing(f"/client-1{LEASED}")
