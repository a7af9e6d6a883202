# SPDX-License-Identifier: Apache-2.0
"""Calls that one thread makes later."""

import gc
import threading
import time
from typing import List

import pytest

from merlin_ros.alarms import LEFT_OUT, LONGEST_TICK, Alarm, Alarms, TickClock
from merlin_test import LONG

FAR = 3600.0  # s


@pytest.fixture
def alarms() -> Alarms:
    return Alarms("test")


def test_calls_come_in_the_order_of_their_times() -> None:
    order: List[str] = []
    last = threading.Event()
    now = 0.0  # a stall between the two calls must not make the first one due
    alarms = Alarms("of the test", TickClock(lambda: now))
    alarms.call_later(0.05, lambda: (order.append("late"), last.set()))
    alarms.call_later(0.01, lambda: order.append("early"))
    now = 1.0
    assert last.wait(LONG)
    assert order == ["early", "late"]


def test_a_call_that_is_due_before_the_one_that_is_waited_for_comes_in_time(alarms: Alarms) -> None:
    waits, rang = threading.Event(), threading.Event()
    alarms.call_later(0.0, waits.set)
    alarms.call_later(FAR, lambda: None)
    assert waits.wait(LONG)
    alarms.call_later(0.0, rang.set)
    assert rang.wait(LONG)


def test_a_call_is_not_early(alarms: Alarms) -> None:
    rang: List[float] = []
    over = threading.Event()
    begun = time.monotonic()
    alarms.call_later(0.03, lambda: (rang.append(time.monotonic()), over.set()))
    assert over.wait(LONG)
    assert rang[0] - begun >= 0.03


def test_a_call_that_was_taken_back_is_not_made() -> None:
    process = StalledProcess()
    made: List[str] = []
    process.alarms.call_later(0.02, lambda: made.append("taken back")).cancel()
    process.pass_time(0.1)
    assert made == []


def test_calls_that_were_taken_back_are_not_kept(alarms: Alarms) -> None:
    kept = alarms.call_later(FAR, lambda: None)
    for _ in range(10_000):
        alarms.call_later(FAR, lambda: None).cancel()
    gc.collect()
    assert sum(isinstance(each, Alarm) for each in gc.get_objects()) < 200
    assert kept.waits


def test_a_call_that_fails_does_not_keep_the_others(alarms: Alarms) -> None:
    over = threading.Event()
    alarms.call_later(0.0, lambda: 1 // 0)
    alarms.call_later(0.01, over.set)
    assert over.wait(LONG)


def test_one_thread_serves_all() -> None:
    alarms = Alarms("one thread")  # others may come and go meanwhile
    for _ in range(100):
        alarms.call_later(FAR, lambda: None)
    assert [thread.name for thread in threading.enumerate()].count("one thread") == 1


@pytest.mark.parametrize("seconds", [1e10, float("inf"), float("nan")])
def test_a_time_beyond_measure_keeps_no_other_call(seconds: float) -> None:
    process = StalledProcess()
    process.alarms.call_later(seconds, lambda: None)
    process.pass_time(0.0)  # the thread has the other one before it, too
    rang: List[str] = []
    process.alarms.call_later(0.04, lambda: rang.append("late"))
    process.alarms.call_later(0.02, lambda: rang.append("early"))
    process.pass_time(0.1)
    assert rang == ["early", "late"]


class StalledProcess:
    """Alarms by a clock that a test sets."""

    def __init__(self) -> None:
        self.now = 100.0
        self.alarms = Alarms("test", TickClock(lambda: self.now))

    def pass_time(self, seconds: float) -> None:
        """Time passes; returns when the thread has looked."""
        self.now += seconds
        looked = threading.Event()
        self.alarms.call_later(0.0, looked.set)
        assert looked.wait(LONG)


def test_a_stall_of_the_process_brings_no_call() -> None:
    process = StalledProcess()
    alarm = process.alarms.call_later(1.0, lambda: None)
    process.pass_time(10.0)
    assert alarm.waits
    for _ in range(round(1.0 / LONGEST_TICK)):
        process.pass_time(LONGEST_TICK)
    assert not alarm.waits


def test_the_time_in_which_nothing_waits_brings_no_call() -> None:
    process = StalledProcess()
    process.pass_time(10.0)
    process.now += 3600.0
    alarm = process.alarms.call_later(1.0, lambda: None)
    process.pass_time(0.5)
    assert alarm.waits


def test_a_beat_comes_again_and_again_until_it_is_cancelled() -> None:
    process = StalledProcess()
    beats: List[float] = []
    beat = process.alarms.every(0.15, lambda: beats.append(process.now))
    for _ in range(11):
        process.pass_time(0.07)
    assert len(beats) == 5
    beat.cancel()
    process.pass_time(0.2)
    assert len(beats) == 5 and not beat.waits


def test_beats_of_one_period_come_together_also_after_a_late_one() -> None:
    process = StalledProcess()
    first: List[float] = []
    second: List[float] = []
    beats = [process.alarms.every(0.15, lambda: first.append(process.now))]
    process.pass_time(0.06)
    beats.append(process.alarms.every(0.15, lambda: second.append(process.now)))
    for seconds in (0.1, 0.19, *[0.04] * 12):
        process.pass_time(seconds)
    assert second and first[-len(second) :] == second
    assert all(0.07 < after - before < 0.27 for before, after in zip(second, second[1:]))
    for beat in beats:
        beat.cancel()


def test_a_process_that_was_stopped_makes_up_for_no_beat() -> None:
    process = StalledProcess()
    beats: List[float] = []
    beat = process.alarms.every(0.15, lambda: beats.append(process.now))
    process.pass_time(60.0)
    process.pass_time(0.0)
    assert len(beats) == 1
    beat.cancel()


def test_a_beat_that_fails_is_logged_once_and_goes_on(caplog: pytest.LogCaptureFixture) -> None:
    process = StalledProcess()
    fails = [True, True, None, True, False, True]  # None: it leaves that time out

    def call() -> object:
        now = fails.pop(0)
        if now:
            raise OSError("the topic is closed")
        return LEFT_OUT if now is None else None

    beat = process.alarms.every(0.15, call)
    left = []
    while fails:
        process.pass_time(0.15)
        left.append(len(fails))
    beat.cancel()
    assert left == [5, 4, 3, 2, 1, 0]
    assert caplog.text.count("OSError: the topic is closed") == 2  # it has worked between the two
    assert "'test'" in caplog.text
