# SPDX-License-Identifier: Apache-2.0
"""A watcher's own time, in virtual time."""

import pytest

from merlin_ros.alarms import LONGEST_TICK, TICK, TickClock, wait_ticks


class Clock:
    """A clock that a test sets, and whose time passes where one waits for it."""

    def __init__(self) -> None:
        self.now = 100.0
        self.stalls = 0.0  # s by which the next wait overruns

    def __call__(self) -> float:
        return self.now

    def wait(self, seconds: float) -> bool:
        """Waits for what never comes."""
        self.now += seconds + self.stalls
        self.stalls = 0.0
        return False


@pytest.fixture
def clock() -> Clock:
    return Clock()


def test_a_look_in_time_counts_in_full(clock: Clock) -> None:
    ticks = TickClock(clock)
    clock.now += TICK
    assert ticks.look() == pytest.approx(TICK)
    assert (ticks.now, ticks.missed) == (pytest.approx(TICK), 0.0)


def test_a_stall_counts_one_tick(clock: Clock) -> None:
    ticks = TickClock(clock)
    clock.now += 10.0
    assert ticks.look() == LONGEST_TICK
    assert ticks.missed == pytest.approx(10.0 - LONGEST_TICK)
    clock.now += TICK
    ticks.look()
    assert (ticks.now, ticks.missed) == (pytest.approx(LONGEST_TICK + TICK), 0.0)


def test_a_wait_takes_its_time(clock: Clock) -> None:
    assert not wait_ticks(clock.wait, 2.0, clock)
    assert clock.now == pytest.approx(102.0)


def test_a_stall_in_a_wait_comes_on_top(clock: Clock) -> None:
    clock.stalls = 10.0
    assert not wait_ticks(clock.wait, 2.0, clock)
    assert clock.now == pytest.approx(112.0, abs=LONGEST_TICK)


def test_what_comes_after_a_stall_is_in_time(clock: Clock) -> None:
    clock.stalls = 10.0
    assert wait_ticks(lambda tick: clock.wait(tick) or clock.now > 111.0, 2.0, clock)


@pytest.mark.parametrize("seconds", [0.0, -1.0])
def test_without_time_there_is_one_attempt(clock: Clock, seconds: float) -> None:
    assert not wait_ticks(clock.wait, seconds, clock)
    assert wait_ticks(lambda tick: True, seconds, clock)
    assert clock.now == 100.0
