# SPDX-License-Identifier: Apache-2.0
"""Which action interfaces are alive."""

import pytest

from merlin_rosplan.dispatch.interface_watch import (
    JUST_ANNOUNCED,
    LIMITS,
    OPERATORS,
    InterfaceWatch,
)


class Clock:
    now = 100.0

    def __call__(self):
        return self.now


def look(watch, clock, seconds):
    """A dispatch looks every second, for some seconds; returns what it sees last."""
    for _ in range(round(seconds)):
        clock.now += 1.0
        silent = watch.seconds_silent("paint")
    return silent


@pytest.fixture
def clock():
    return Clock()


def test_who_was_never_heard_of_is_unknown(clock):
    watch = InterfaceWatch(clock)
    assert watch.seconds_silent("paint") is None and not watch.just_announced("paint")


def test_silence_counts_from_the_last_announcement_whatever_the_case(clock):
    watch = InterfaceWatch(clock)
    watch.announce("Paint")
    assert look(watch, clock, 3.0) == watch.seconds_silent("PAINT") == pytest.approx(3.0)
    watch.announce("paint")
    assert watch.seconds_silent("paint") == 0.0


def test_an_interface_that_announces_itself_slowly_is_given_more_time(clock):
    # ROSPlan's interfaces count their second in ROS time, which may run at a fifth of ours
    watch = InterfaceWatch(clock)
    for _ in range(3):
        watch.announce("paint")
        silent = look(watch, clock, 5.0)
    assert silent == pytest.approx(1.0)


def test_no_interface_was_silent_while_this_process_was_stalled(clock):
    watch = InterfaceWatch(clock)
    for _ in range(3):
        watch.announce("paint")
        clock.now += 1.0
    clock.now += 600.0
    assert watch.seconds_silent("paint") < 2.0
    for _ in range(2):
        watch.announce("paint")
        clock.now += 1.0
    assert look(watch, clock, 3.0) == 4.0


def test_one_that_died_while_nobody_looked_has_been_silent_all_the_time(clock):
    watch = InterfaceWatch(clock)
    watch.announce("paint")
    clock.now += 60.0
    assert look(watch, clock, 2.0) == 62.0  # the time that it has to take an action


def test_an_interface_is_just_announced_for_a_while_and_again_after_a_restart(clock):
    watch = InterfaceWatch(clock)
    for _ in range(20):
        watch.announce("paint")
        clock.now += 1.0
    assert not watch.just_announced("paint")
    clock.now += 60.0
    watch.announce("paint")
    assert watch.just_announced("paint")
    clock.now += JUST_ANNOUNCED
    assert not watch.just_announced("paint")


def test_an_interface_that_has_been_silent_for_long_makes_room_for_another(clock):
    watch = InterfaceWatch(clock)
    for number in range(OPERATORS):
        watch.announce(f"old{number}")
    watch.announce("early")
    assert watch.seconds_silent("early") is None
    clock.now += LIMITS.keep + 1.0
    watch.announce("late")
    assert watch.seconds_silent("late") == 0.0
    assert watch.seconds_silent("old0") is None and watch.seconds_silent("old1") is not None


def test_names_that_are_announced_without_end_do_not_grow_without_end(clock):
    watch = InterfaceWatch(clock)
    watch.announce("drive")
    for number in range(10 * OPERATORS):
        watch.announce(f"ghost{number}")
    clock.now += 1.0
    watch.announce("drive")
    ghosts = [watch.seconds_silent(f"ghost{number}") for number in range(10 * OPERATORS)]
    assert sum(silent is not None for silent in ghosts) == OPERATORS - 1
    assert watch.seconds_silent("drive") == 0.0 and watch.seconds_silent("say") is None
    clock.now += LIMITS.keep + 1.0
    watch.announce("say")
    assert watch.seconds_silent("say") == 0.0 and watch.just_announced("say")
