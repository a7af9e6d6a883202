# SPDX-License-Identifier: Apache-2.0
"""The guard and goals whose client died before its first lease, or was restarted."""

from merlin_guard.attention_clock import AttentionClock
from merlin_guard.lease_book import (
    KEEP_LIVES,
    LOSE_GONE_AFTER,
    NAMES,
    OWNERS,
    SUSPEND_GONE_AFTER,
    BaseOwnership,
    GuardLeases,
)
from merlin_guard.motion_permit import LEASED, GuardState, MotionPermit, Send
from merlin_guard.motion_server import EARLY_CANCELS, UNSEEN, GoalReport, MotionServer
from merlin_guard.settings import GuardSettings

ACTIVE = 1


def test_a_late_lease_of_a_former_life_costs_the_new_one_nothing():
    book = GuardLeases(GuardSettings())
    book.receive("/client", "a", ["old"], [], 0.0)
    book.receive("/client", "b", ["new"], [], 0.1)
    book.receive("/client", "a", ["old"], [], 0.2)
    assert book.claim("new", 0.2).ownership is BaseOwnership.HELD
    assert book.claim("old", 0.2).ownership is BaseOwnership.LOST


def test_an_owner_whose_connection_is_closed_moves_nothing_twice_as_soon():
    book = GuardLeases(GuardSettings())
    book.receive("/client", "a", ["goal"], [], 0.0)
    assert book.claim("goal", SUSPEND_GONE_AFTER + 0.1).ownership is BaseOwnership.HELD
    book.connected([])
    assert book.claim("goal", SUSPEND_GONE_AFTER).ownership is BaseOwnership.HELD
    assert book.claim("goal", SUSPEND_GONE_AFTER + 0.1).ownership is BaseOwnership.SUSPENDED
    assert book.claim("goal", LOSE_GONE_AFTER + 0.1).ownership is BaseOwnership.LOST
    book.receive("/client", "a", ["goal"], [], 1.0)
    assert book.claim("goal", 1.0).ownership is BaseOwnership.HELD


def passing(goal_id: str) -> bool:
    """Whether a goal that no lease names still moves the base after a second."""
    permit = MotionPermit(["/move_base"])
    for tick in range(11):
        now = 100.0 + tick / 10
        permit.status("/move_base", [GoalReport(goal_id, ACTIVE, 1, False)], now)
        sent = permit.command(True, now).send
    return sent is Send.COMMAND and permit.view.state is GuardState.PASSING


def test_a_goal_that_says_it_is_leased_does_not_move_without_a_lease():
    assert passing("/rviz-1")
    assert not passing(f"/client-1{LEASED}")


def test_what_clients_name_does_not_grow_for_ever():
    book = GuardLeases(GuardSettings())
    for number in range(2 * OWNERS):
        book.receive(f"/anonymous_{number}", "a", [], [], 0.0)
        book.receive("/flood", str(number), [f"{number}-{name}" for name in range(3 * NAMES)], [], 0.0)
        book.receive("/client", "a", ["goal"], [], 0.0)
    assert book.claim("goal", 0.0).ownership is BaseOwnership.HELD
    assert book.claim(f"{2 * OWNERS - 1}-{3 * NAMES - 1}", 0.0).ownership is BaseOwnership.HELD
    assert book.claim(f"{2 * OWNERS - 1}-0", 0.0).ownership is BaseOwnership.FOREIGN
    assert len(book._owners) == OWNERS
    assert len(book._owners["/flood"].former_lives) == KEEP_LIVES
    assert len(book._owners["/flood"].held) == NAMES


def test_cancels_that_come_before_their_goals_do_not_grow_for_ever():
    server = MotionServer("/move_base", GuardSettings(), AttentionClock())
    for number in range(EARLY_CANCELS + 2):
        server.cancel(str(number), 0.0)
        server.cancel("0", 0.0)  # once more: it is the youngest again
    for name in ("0", "2", "1"):
        server.goal_sent(name, 0)
    assert [goal.cancelled_at is not None for goal in server.goals.values()] == [True, False, False]


def test_goals_for_a_server_that_is_gone_do_not_grow_for_ever():
    clock = AttentionClock()
    server = MotionServer("/move_base", GuardSettings(), clock)
    server.report([GoalReport("drives", ACTIVE)])
    server.goals["drives"].refuse("it was cancelled")
    for number in range(3 * UNSEEN):
        server.goal_sent(str(number), 0)
        if number % UNSEEN == 5:
            clock.world += 100.0
    assert server.gone and len(server.goals) <= UNSEEN + 1
    server.report([GoalReport("drives", ACTIVE), GoalReport("0", ACTIVE)])  # it was only stopped
    assert not server.gone
    assert "0" in server.goals and server.goals["drives"].refused
