# SPDX-License-Identifier: Apache-2.0
"""Guests call when it is quiet, and not into an answer that another person is about to give."""

from merlin_guests.seen_robot import ANSWER_DUE, QUIET, QuietRoom


def test_it_is_quiet_some_time_after_the_last_sound() -> None:
    room = QuietRoom()
    room.sound(100.0)
    assert not room.quiet(100.0 + QUIET)
    assert room.quiet(100.1 + QUIET)


def test_it_is_never_quiet_while_the_robot_speaks() -> None:
    room = QuietRoom()
    room.robot(100.0, True)
    assert not room.quiet(1000.0)
    room.robot(1000.0, False)
    assert not room.quiet(1000.0 + QUIET)
    assert room.quiet(1000.1 + QUIET)


def test_nobody_calls_before_the_answer_that_is_due() -> None:
    room = QuietRoom()
    room.asked(100.0)
    assert not room.quiet(101.0 + QUIET), "a voice that is slow to begin is waited for"
    room.sound(110.0)
    assert room.quiet(110.1 + QUIET)


def test_an_answer_that_never_comes_does_not_silence_the_room() -> None:
    room = QuietRoom()
    room.asked(100.0)
    assert room.quiet(100.1 + ANSWER_DUE)


def test_a_voice_that_falls_into_the_robots_speech_does_not_end_it() -> None:
    room = QuietRoom()
    room.robot(100.0, True)
    room.sound(101.0)
    assert not room.quiet(1000.0), "the robot still speaks"
    room.robot(1000.0, False)
    assert room.quiet(1000.1 + QUIET)
