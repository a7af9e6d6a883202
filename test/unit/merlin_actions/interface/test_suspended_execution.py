# SPDX-License-Identifier: Apache-2.0
"""Executions that have to stop or rest: whatever one of them does, and whatever comes first."""

import threading
from typing import Any, Iterator, List

import pytest
from fakes.dispatched import Dispatcher

from merlin_actions import action_interface
from merlin_actions.core.ending import Ending
from merlin_actions.core.execution import Execution
from merlin_planning.dispatch_progress import CANCEL_ACTION
from merlin_ros.actions import hang_watch
from merlin_ros.actions.hang_watch import HUNG, HangWatch
from merlin_ros.actions.ownership import Ownership, ownership
from merlin_test import LONG


class Probe(action_interface.ActionInterface):
    """Runs until it is cancelled; the first execution fails at that."""

    concurrent = True

    def __init__(self) -> None:
        super().__init__("navigate")
        self.running: threading.Semaphore = threading.Semaphore(0)
        self.suspended: List[bool] = []
        self.cancelled: threading.Semaphore = threading.Semaphore(0)
        self.ends = threading.Event()  # whether one that is cancelled comes to an end
        self.ends.set()

    def run(self, execution: Execution) -> Ending:
        stopped = threading.Event()

        def stop() -> None:
            stopped.set()
            self.cancelled.release()
            if execution.key[1] == 1:
                raise OSError("the arm does not answer")

        self.suspended.append(ownership.suspended(execution.token))
        execution.interruptible(stop)
        self.running.release()
        assert stopped.wait(LONG) and self.ends.wait(LONG)
        return Ending(False, execution.cancel_reason)


@pytest.fixture
def dispatcher(monkeypatch: pytest.MonkeyPatch, clock: Any) -> Dispatcher:
    return Dispatcher(monkeypatch)


@pytest.fixture
def interface(dispatcher: Dispatcher) -> Iterator[Probe]:
    made = Probe()
    made.start()
    dispatcher.wait_announced()
    yield made
    made.shutdown()


def run(interface: Probe, dispatcher: Dispatcher, action: int) -> None:
    dispatcher.dispatch(action)
    assert interface.running.acquire(timeout=LONG)


def test_a_cancel_that_fails_keeps_no_other_one(interface: Probe, dispatcher: Dispatcher) -> None:
    for action in (1, 2, 3):
        run(interface, dispatcher, action)
    interface.master_lost()
    assert sorted(dispatcher.end().action_id for _ in range(3)) == [1, 2, 3]


def test_an_action_that_is_cancelled_is_not_answered_before_it_has_stopped(
    interface: Probe, dispatcher: Dispatcher
) -> None:
    run(interface, dispatcher, 2)
    interface.ends.clear()
    dispatcher.dispatch(2, name=CANCEL_ACTION)
    assert interface.cancelled.acquire(timeout=LONG)
    assert len(interface.executions()) == 1
    interface.ends.set()
    assert dispatcher.end().action_id == 2


def test_what_an_interface_sends_after_a_hang_is_suspended_until_a_cancel_may_be_read(
    dispatcher: Dispatcher, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [100.0]
    watch = HangWatch(lambda: now[0])
    monkeypatch.setattr(action_interface, "hangs", watch)
    interface = Probe()
    interface.start()
    now[0] += 2 * HUNG
    assert Ownership(watch).suspended("7/2")
    interface.shutdown()


def test_an_action_whose_lease_came_before_it_and_is_suspended_does_not_move(
    interface: Probe, dispatcher: Dispatcher, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hang_watch, "HUNG", LONG)  # this process may hang
    dispatcher.lease(["7/2"], suspended=["7/2"])  # the owner of the dispatcher hangs
    run(interface, dispatcher, 2)
    assert interface.suspended == [True]
    (execution,) = interface.executions()
    back = threading.Event()
    notice = lambda: None if ownership.suspended(execution.token) else back.set()  # noqa: E731
    ownership.listen(notice)
    dispatcher.lease(["7/2"], suspended=[])
    assert back.wait(LONG)
    ownership.ignore(notice)


def test_an_action_for_which_there_is_no_thread_is_answered_and_keeps_no_next_one(
    interface: Probe, dispatcher: Dispatcher, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_thread(thread: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    interface.concurrent = False
    with monkeypatch.context() as short_of_threads:
        short_of_threads.setattr(threading.Thread, "start", no_thread)
        dispatcher.dispatch(4)
    assert dispatcher.end().action_id == 4 and interface.executions() == []
    run(interface, dispatcher, 2)
