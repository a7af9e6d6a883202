"""Guests call when it is quiet, and not into an answer that somebody else is about to give."""

from merlin_restaurant.players.silence import ANSWER_DUE, QUIET, Silence


def test_it_is_quiet_some_time_after_the_last_sound() -> None:
    silence = Silence()
    silence.sound(100.0)
    assert not silence.quiet(100.0 + QUIET)
    assert silence.quiet(100.1 + QUIET)


def test_it_is_never_quiet_while_the_robot_speaks() -> None:
    silence = Silence()
    silence.robot(100.0, True)
    assert not silence.quiet(1000.0)
    silence.robot(1000.0, False)
    assert not silence.quiet(1000.0 + QUIET)
    assert silence.quiet(1000.1 + QUIET)


def test_nobody_calls_before_the_answer_that_is_due() -> None:
    silence = Silence()
    silence.asked(100.0)
    assert not silence.quiet(101.0 + QUIET), "a voice that is slow to begin is waited for"
    silence.sound(110.0)
    assert silence.quiet(110.1 + QUIET)


def test_an_answer_that_never_comes_does_not_silence_the_room() -> None:
    silence = Silence()
    silence.asked(100.0)
    assert silence.quiet(100.1 + ANSWER_DUE)


def test_a_voice_that_falls_into_the_robots_speech_does_not_end_it() -> None:
    silence = Silence()
    silence.robot(100.0, True)
    silence.sound(101.0)
    assert not silence.quiet(1000.0), "the robot still speaks"
    silence.robot(1000.0, False)
    assert silence.quiet(1000.1 + QUIET)
