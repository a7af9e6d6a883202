# SPDX-License-Identifier: Apache-2.0
"""A process that has hung reads everything before it begins something."""

import threading
import time

import pytest

from merlin_ros.actions import hang_watch
from merlin_ros.actions.hang_watch import HUNG, SETTLE, HangWatch
from merlin_test import LONG


class Clock:
    now = 100.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def watch(clock):
    watch = HangWatch(clock)
    watch.beat()
    return watch


def hung(clock):
    """A watch after a hang, on a clock of the test's."""
    watch = HangWatch(clock)
    watch.beat()
    clock.now += 2 * HUNG
    return watch


def test_where_nothing_beats_nothing_waits(clock):
    watch = HangWatch(clock)
    clock.now += 5.0
    assert watch.unsettled() == 0.0
    watch.beat()
    assert watch.unsettled() == 0.0


def test_a_process_beats_once_however_many_begin(clock, monkeypatch):
    beats = []
    monkeypatch.setattr(hang_watch, "every", lambda period, call: beats.append((period, call)))
    watch = HangWatch(clock)
    watch.begin()
    watch.begin()
    ((period, beat),) = beats
    assert period < HUNG and watch.unsettled() == 0.0
    clock.now += 2 * HUNG
    beat()
    assert watch.unsettled() == pytest.approx(SETTLE)


def test_a_process_that_beats_is_settled(watch, clock):
    for _ in range(5):
        clock.now += HUNG
        watch.beat()
        assert watch.unsettled() == 0.0


@pytest.mark.parametrize("beats_first", [False, True])
def test_after_a_hang_it_settles_whichever_thread_goes_on_first(watch, clock, beats_first):
    clock.now += 5.0
    if not beats_first:
        assert watch.unsettled() > 0.0
    watch.beat()
    assert watch.unsettled() == pytest.approx(SETTLE)
    clock.now += SETTLE
    watch.beat()
    assert watch.unsettled() == 0.0


def test_a_peer_is_not_silent_while_what_it_has_sent_may_be_unread(watch, clock):
    watch.beat()
    assert watch.silent(2.0, 1.5) and not watch.silent(1.0, 1.5)
    clock.now += 5.0
    assert not watch.silent(5.0, 1.5)
    watch.beat()
    assert not watch.silent(5.0, 1.5)
    clock.now += SETTLE
    watch.beat()
    assert watch.silent(5.3, 1.5)


def test_a_wait_ends_when_the_process_has_settled(clock):
    watch = hung(clock)
    passed = threading.Event()
    waits = threading.Thread(target=lambda: (watch.wait_settled(lambda: False), passed.set()), daemon=True)
    waits.start()
    watch.beat()
    assert watch.unsettled() > 0.0 and not passed.is_set()
    clock.now += SETTLE
    watch.beat()
    assert passed.wait(LONG)


def test_a_wait_ends_when_it_is_not_wanted_any_more(clock):
    watch = hung(clock)
    watch.wait_settled(lambda: True)
    assert watch.unsettled() > 0.0


def test_a_wait_ends_when_the_beat_never_comes():
    missed = [0.0]  # s
    watch = HangWatch(lambda: time.monotonic() + missed[0])
    watch.beat()
    missed[0] = 2 * HUNG
    waits = threading.Thread(target=watch.wait_settled, args=(lambda: False,), daemon=True)
    waits.start()
    waits.join(LONG)
    assert not waits.is_alive() and watch.unsettled() > 0.0
