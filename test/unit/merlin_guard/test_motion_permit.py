# SPDX-License-Identifier: Apache-2.0
"""The guard's decisions, event by event."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from merlin_msgs.msg import GuardStatus
from motion_world import BASE, DOCK, DRIVING, World, driving

from merlin_guard.motion_permit import GuardState, MotionPermit, Send
from merlin_guard.motion_server import ACTIVE, PENDING, PREEMPTING, GoalReport
from merlin_guard.settings import GuardSettings

SUCCEEDED, PREEMPTED = 3, 2


def test_nothing_passes_without_a_goal():
    world = World()
    assert not world.drive()
    assert world.sent[-1] is Send.ZERO
    world.status()
    assert not world.drive()
    assert (world.state, world.reason) == (GuardState.IDLE, "no motion goal is active")


@pytest.mark.parametrize("status", [PENDING, SUCCEEDED, PREEMPTED])
def test_nothing_passes_for_a_goal_that_is_not_active(status):
    world = World()
    world.status(("a", status))
    assert not world.drive()


def test_a_zero_velocity_always_passes():
    world = World()
    assert world.permit.command(False, world.now).send is Send.COMMAND
    world.permit.stop("by hand", world.now)
    assert world.permit.command(False, world.now).send is Send.COMMAND


def test_a_foreign_goal_passes_and_its_end_stops_the_base():
    world = World()
    world.status(("rviz", ACTIVE))
    assert world.drive() and world.state is GuardState.PASSING
    assert world.status(("rviz", SUCCEEDED)).send is Send.ZERO
    assert world.state is GuardState.IDLE and not world.permit.view.moving


def test_of_the_goals_it_says_which_ones_were_cancelled():
    world = World()
    world.status(("a", ACTIVE), ("b", ACTIVE))
    world.cancel("a")
    assert (world.permit.view.goals, world.permit.view.cancelled) == (("a", "b"), ("a",))
    world.status(("a", SUCCEEDED), ("b", ACTIVE))
    assert (world.permit.view.goals, world.permit.view.cancelled) == (("b",), ())


def test_a_foreign_goal_is_refused_where_a_lease_is_required():
    world = World(require_lease=True)
    world.status(("rviz", ACTIVE))
    assert not world.drive() and "no lease" in world.reason
    world.after(2.5, [("rviz", ACTIVE)])
    assert world.cancels == []
    world.after(1.0, [("rviz", ACTIVE)])
    assert "rviz" in world.cancels


def test_a_goal_older_than_the_guard_needs_an_owner():
    world = World()
    world.status(("a", ACTIVE, 5.0, True))
    assert not world.drive() and "before the guard" in world.reason
    world.lease(["a"])
    assert world.drive()
    orphan = World()
    orphan.after(3.5, [("a", ACTIVE, 5.0, True)])
    assert orphan.cancels[0] == "a"


def test_a_silent_owner_suspends_then_loses_its_goal():
    world = driving()
    world.after(0.5, DRIVING)
    assert world.state is GuardState.PASSING
    world.after(0.2, DRIVING)
    assert world.state is GuardState.HOLDING and "/host has been silent for 0.6 s" in world.reason
    assert Send.ZERO in world.sent and world.cancels == []
    world.after(2.5, DRIVING)
    assert "silent for 3 s" in world.reason and world.cancels
    world.lease(["a"])  # too late: it was cancelled
    assert not world.drive()


def test_an_owner_that_is_gone_loses_its_goal_sooner():
    world = driving()
    world.permit.tick(world.now, {BASE: [], DOCK: []})
    world.after(0.8, DRIVING)
    assert world.state is GuardState.HOLDING and not world.cancels
    world.after(0.2, DRIVING)
    assert world.cancels == ["a"] and "/host is gone" in world.reason


def test_a_connection_that_closes_between_two_leases_harms_nothing():
    world = driving()
    world.permit.tick(world.now, {BASE: [], DOCK: []})
    world.after(2.0, DRIVING, held=["a"])
    world.permit.tick(world.now, {BASE: ["/host"], DOCK: []})
    assert world.drive() and not world.cancels


def test_an_owner_that_returns_resumes():
    world = driving().after(1.0, DRIVING)
    assert not world.drive()
    world.lease(["a"])
    assert world.drive() and world.cancels == []


def test_a_halt_outlasts_a_status_list_of_a_second_server_of_that_name():
    world = driving()
    world.do(world.permit.halt("the operator halted it", world.now))
    world.status(("other", ACTIVE))
    world.status(*DRIVING)
    assert not world.drive() and "the operator halted it" in world.reason
    assert world.status(("a", PREEMPTED)) and world.status(("b", ACTIVE)) and world.drive()


def test_a_cancel_and_a_halt_count_while_two_servers_share_a_name():
    world = World()
    world.status(*DRIVING)
    world.cancel("a")
    for _ in range(20):  # the list of one does not have the goal of the other
        world.after(0.05, [], commands=False)
        world.after(0.05, [("a", PREEMPTING)])
    assert not world.drive() and "cancelled and still runs" in world.reason and "a" in world.cancels
    world.status(("b", ACTIVE))
    world.status()
    world.permit.halt("halted", world.now)
    world.status(("b", ACTIVE))
    assert not world.drive() and "halted" in world.reason


def test_a_suspended_lease_holds_and_resumes():
    world = driving()
    assert world.lease([], ["a"]).send is Send.ZERO
    assert not world.drive() and "its own owner is silent" in world.reason
    world.lease(["a"])
    assert world.drive()


def test_a_new_life_of_the_owner_loses_its_goals_at_once():
    world = driving()
    decision = world.lease([], life="2")
    assert decision.send is Send.ZERO
    assert [cancel.goal_id for cancel in decision.cancels] == ["a"] and "has restarted" in world.reason


def test_a_new_life_may_take_its_goals_over():
    world = driving()
    world.lease(["a"], life="2")
    assert world.drive() and not world.cancels


def test_a_goal_that_its_owner_released_holds_at_once_and_is_cancelled():
    world = driving()
    assert world.lease([]).send is Send.ZERO
    assert world.cancels == []  # as a rule it has just ended, and its status is on the way
    world.after(0.3, DRIVING, held=[])
    assert world.cancels == ["a"] and "has let go" in world.reason


def test_a_released_goal_that_ends_is_not_cancelled():
    world = driving()
    world.lease([])
    world.status(("a", SUCCEEDED))
    world.after(1.0, [("a", SUCCEEDED)], held=[])
    assert world.cancels == [] and world.state is GuardState.IDLE


def test_another_owner_changes_nothing():
    world = driving()
    world.lease(["b"], owner="/other")
    world.lease([], owner="/other")
    assert world.drive() and not world.cancels


@pytest.mark.parametrize("seen", ["cancel", "status", "all"])
def test_a_cancelled_goal_may_move_until_the_deadline(seen):
    world = driving()
    if seen == "status":
        goals = [("a", PREEMPTING)]
    else:
        goals = DRIVING
        world.cancel("a" if seen == "cancel" else "")
    world.after(0.45, goals, held=["a"])
    assert world.state is GuardState.PASSING and not world.cancels
    world.after(0.15, goals, held=["a"])
    assert world.state is GuardState.HOLDING and "still runs 0.5 s later" in world.reason
    assert Send.ZERO in world.sent
    world.after(2.0, goals, held=["a"])
    assert world.cancels.count("a") in (4, 5)  # now, and every 0.5 s
    world.status()
    assert world.state is GuardState.IDLE
    world.status(("b", ACTIVE))
    assert world.drive()


def test_a_cancel_by_stamp_concerns_the_older_goals():
    world = World()
    world.status(("old", ACTIVE, 5.0), ("new", PENDING, 9.0))
    world.cancel(stamp=7.0)
    world.after(0.6, [("old", ACTIVE, 5.0), ("new", PENDING, 9.0)])
    assert world.state is GuardState.HOLDING
    world.status(("new", ACTIVE, 9.0))
    assert world.drive()


def test_a_cancel_that_overtakes_its_goal_counts():
    world = World()
    world.cancel("a")
    world.status(("a", ACTIVE))
    world.after(0.6, [("a", ACTIVE)])
    assert world.state is GuardState.HOLDING


def test_a_cancel_does_not_wait_for_its_goal_for_ever():
    world = driving()
    world.cancel("later")
    world.after(61.0, DRIVING, ["a"])
    world.lease(["later"])
    world.status(("later", ACTIVE))
    world.after(1.0, [("later", ACTIVE)], ["later"])
    assert world.drive()


def test_no_command_stops_the_base():
    world = driving()
    world.after(0.25, DRIVING, held=["a"], commands=False)
    assert world.permit.view.moving
    world.after(0.1, DRIVING, held=["a"], commands=False)
    assert not world.permit.view.moving and world.sent.count(Send.ZERO) == 1
    assert world.state is GuardState.PASSING and "no command comes" in world.reason
    assert world.drive()


@pytest.mark.parametrize("rate, passes", [(0.0, True), (0.25, True), (0.9, False)])
def test_a_paused_or_slow_simulation_makes_no_command_late(rate, passes):
    world = driving()
    world.permit.world_rate(rate, world.now)
    world.after(0.5, None, held=["a"], commands=False)
    assert world.permit.view.moving is passes


def test_a_paused_simulation_makes_no_server_silent():
    world = driving()
    world.permit.world_rate(0.0, world.now)
    world.after(20.0, None, held=["a"])
    assert world.state is GuardState.PASSING
    world.permit.world_rate(1.0, world.now)
    world.after(1.2, None, held=["a"])
    assert world.state is GuardState.HOLDING


@pytest.mark.parametrize("rate", [0.0, 0.1])
def test_nobody_pauses_or_slows_the_world_while_ros_time_goes_on(rate):
    world = driving(command_timeout=1.0)
    for _ in range(60):
        world.permit.world_rate(rate, world.now)
        world.now += 0.05
        world.permit.ros_time(round(1e9 * world.now), world.now)
        world.do(world.permit.tick(world.now))
        world.lease(["a"])
    assert not world.permit.view.moving


def test_ros_time_that_stands_still_or_is_set_back_passes_no_time():
    world = driving(command_timeout=1.0)
    world.permit.world_rate(0.0, world.now)
    for number in range(60):
        world.now += 0.05
        world.permit.ros_time(100 if number < 30 else 50, world.now)
        world.do(world.permit.tick(world.now))
        world.lease(["a"])
    assert world.permit.view.moving, "it is paused"


@pytest.mark.parametrize("rate", [0.0, 0.1])
def test_a_simulator_that_is_gone_neither_pauses_nor_slows_the_world(rate):
    world = driving()
    world.permit.world_rate(rate, world.now)
    world.after(1.0, None, held=["a"], commands=False)
    assert world.permit.view.moving, "it is paused, or slow"
    world.simulated = False
    world.after(0.5, None, held=["a"], commands=False)
    assert not world.permit.view.moving and world.sent[-1:] != [Send.COMMAND]
    world.after(1.0, None, held=["a"])
    assert world.state is GuardState.HOLDING and "status has been silent" in world.reason
    world.after(15.0, None, held=["a"])
    assert world.state is GuardState.IDLE
    world.status(("b", ACTIVE))
    assert world.drive()


def test_a_silent_server_holds_until_it_speaks_again():
    world = driving()
    world.after(1.2, None, held=["a"])
    assert (
        world.state is GuardState.HOLDING and "status has been silent" in world.reason and not world.cancels
    )
    world.status(*DRIVING)
    assert world.drive()


def test_a_dead_server_is_forgotten_but_not_what_it_did():
    world = driving()
    world.cancel("a")
    world.after(15.5, None, held=["a"])
    assert world.state is GuardState.IDLE and world.permit.view.goals == ()
    world.status(*DRIVING)  # it was not dead
    assert not world.drive() and "was cancelled" in world.reason
    world.status()
    world.status(("b", ACTIVE))
    assert world.drive()


def test_a_refused_goal_of_one_server_holds_what_another_commands():
    world = driving()
    world.status(("d", ACTIVE), server=DOCK)
    assert world.drive()
    world.permit.halt("halted", world.now)
    world.status(("e", ACTIVE), server=DOCK)  # d has ended; a has not
    assert not world.drive()
    world.status()
    assert world.drive()


def test_halt_blocks_the_goals_there_are_and_no_later_one():
    world = driving()
    world.permit.goal_sent(BASE, "b", 1, world.now)  # on its way
    decision = world.permit.halt("halted by /executor", world.now)
    assert decision.send is Send.ZERO and [cancel.goal_id for cancel in decision.cancels] == ["a", "b"]
    assert not world.drive() and "halted by /executor" in world.reason
    world.status(("b", ACTIVE))
    assert not world.drive()
    world.status(("c", ACTIVE))
    assert world.drive()


def test_a_brake_holds_the_leased_goals_until_they_end():
    world = driving()
    decision = world.permit.brake("/executor cancels its action", world.now)
    assert decision.send is Send.ZERO and not decision.cancels  # the owner is about to cancel it
    assert not world.drive() and "/executor cancels its action" in world.reason
    world.status(("a", SUCCEEDED), ("b", ACTIVE))
    assert world.drive()
    assert world.cancels == []


def test_a_braked_goal_that_is_not_cancelled_goes_on():
    world = driving()
    world.permit.brake("/executor cancels its action", world.now)
    world.after(1.9, DRIVING, held=["a"])
    assert not world.drive()
    world.after(0.15, DRIVING, held=["a"])
    assert world.drive() and world.cancels == []


def test_a_braked_goal_that_is_cancelled_does_not_move_any_more():
    world = driving()
    world.permit.brake("/executor cancels its action", world.now)
    world.cancel("a")
    assert not world.drive()
    world.after(4.0, DRIVING, held=["a"])
    assert not world.drive()


def test_a_brake_does_not_concern_foreign_goals():
    world = World()
    world.status(("rviz", ACTIVE))
    world.permit.brake("/executor cancels its action", world.now)
    assert world.drive()
    world.permit.goal_sent(BASE, "host-1-leased", 1, world.now)  # its lease is on its way
    world.permit.brake("/executor cancels its action", world.now)
    world.status(("rviz", SUCCEEDED), ("host-1-leased", ACTIVE))
    world.lease(["host-1-leased"])
    assert not world.drive()


def test_a_stop_wins_until_it_is_released():
    world = driving()
    decision = world.permit.stop("by hand", world.now)
    assert decision.send is Send.ZERO and decision.cancels
    world.after(1.0, DRIVING, held=["a"])
    assert not world.drive() and (world.state, world.reason) == (GuardState.STOPPED, "by hand")
    world.status(("b", ACTIVE))  # sent while stopped: it is not to set off at the release
    assert "b" in world.cancels
    world.permit.release(world.now)
    assert not world.drive()
    world.status(("c", ACTIVE))
    assert world.drive()


def test_a_guard_that_begins_stopped_is_stopped():
    permit = MotionPermit([BASE], stopped="by hand")
    permit.status(BASE, [GoalReport("a", ACTIVE)], 1.0)
    assert permit.command(True, 1.0).send is Send.ZERO and permit.view.state is GuardState.STOPPED


def test_a_guard_that_was_away_blames_no_owner_and_waits_to_hear_again():
    world = driving()
    world.now += 10.0
    assert world.do(world.permit.tick(world.now)).send is Send.ZERO
    assert world.state is GuardState.HOLDING and "the guard was held up" in world.reason and not world.cancels
    world.status(*DRIVING)
    assert not world.drive() and "heard its owner" in world.reason
    world.lease(["a"])
    assert world.drive()


def test_settings_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match="cancel_deadline is 0"):
        GuardSettings(cancel_deadline=0.0).check()
    with pytest.raises(ValueError, match="suspend_after .5 s. is longer than lose_after .3 s."):
        GuardSettings(suspend_after=5.0).check()


@given(st.lists(st.floats(0.0, 0.09), max_size=60))
def test_every_refused_goal_is_cancelled_at_least_every_second_until_it_ends(steps):
    world = driving()
    world.permit.halt("halted", world.now)
    since = world.now
    for step in steps:
        world.now += step
        decision = world.permit.tick(world.now)
        if decision.cancels:
            assert world.now - since >= 0.5 - 1e-6
            since = world.now
        assert world.now - since < 0.6


def test_which_servers_are_heard_and_which_drive():
    world = World()
    assert world.permit.view.heard == world.permit.drivers == ()
    world.status(*DRIVING, server=DOCK)
    world.status()
    assert world.permit.view.heard == (BASE, DOCK) and world.permit.drivers == (DOCK,)
    world.after(1.5, [])
    assert world.permit.view.heard == (BASE,) and world.permit.drivers == (), "what is held does not drive"


def test_what_it_does_is_named_by_the_number_of_the_message():
    assert all(getattr(GuardStatus, state.name) == state for state in GuardState)
