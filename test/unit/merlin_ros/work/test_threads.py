# SPDX-License-Identifier: Apache-2.0
"""Threads of a process: what they raise is logged with their name, and calls in a row keep their order."""

import sys
import threading
from queue import Queue
from typing import Any, List

import pytest

from merlin_ros.work import threads
from merlin_ros.work.threads import CallQueue, failure_logged, failure_text, log_failure, start_thread
from merlin_test import LONG


def no_thread(thread: threading.Thread) -> None:
    raise RuntimeError("can't start new thread")


class Unsayable(Exception):
    def __str__(self) -> str:
        return f"of {self.part}"  # type: ignore[attr-defined]


def names() -> List[str]:
    return [thread.name for thread in threading.enumerate()]


def test_a_piece_of_work_has_a_thread_of_its_name() -> None:
    named: Queue[Any] = Queue()
    thread = start_thread("run (drive hall)", lambda: named.put(threading.current_thread()))
    assert named.get(timeout=LONG) is thread
    assert thread.name == "run (drive hall)" and thread.daemon


def test_the_caller_learns_that_there_is_no_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threading.Thread, "start", no_thread)
    with pytest.raises(RuntimeError, match="can't start new thread"):
        start_thread("run", lambda: None)


def test_calls_come_one_after_the_other_whatever_one_raises(caplog: pytest.LogCaptureFixture) -> None:
    goes_on = threading.Event()
    made: Queue[Any] = Queue()
    calls = CallQueue("owners /drive")
    calls.put(goes_on.wait, LONG)
    for number in range(20):
        calls.put(lambda number=number: made.put(number) if number != 3 else 1 // 0)
    assert made.empty()
    goes_on.set()
    assert [made.get(timeout=LONG) for _ in range(19)] == [number for number in range(20) if number != 3]
    assert "owners /drive" in caplog.text and "ZeroDivisionError" in caplog.text


def test_an_exception_that_cannot_say_its_text_is_answered_and_logged_all_the_same(
    caplog: pytest.LogCaptureFixture,
) -> None:
    try:
        raise Unsayable
    except Unsayable:
        assert log_failure("the mission") == "Unsayable: (its text raised AttributeError)"
    assert "the mission: Traceback" in caplog.text and "raise Unsayable" in caplog.text
    assert failure_text(ValueError("no such place")) == "ValueError: no such place"


def test_what_fails_is_logged_and_what_comes_behind_is_done(caplog: pytest.LogCaptureFixture) -> None:
    with failure_logged("the end of a test"):
        raise StopIteration("no further one")
    with failure_logged(kind=BaseException):
        sys.exit("enough")
    assert "the end of a test: Traceback" in caplog.text and "StopIteration: no further one" in caplog.text
    assert "continues after an error: Traceback" in caplog.text and "SystemExit: enough" in caplog.text
    with pytest.raises(SystemExit), failure_logged():
        sys.exit("not to be kept")


def test_there_is_a_thread_only_while_there_are_calls() -> None:
    made: Queue[Any] = Queue()
    calls = CallQueue("calls of a test")
    assert "calls of a test" not in names()
    for _ in range(2):
        calls.put(lambda: made.put(threading.current_thread()))
        thread = made.get(timeout=LONG)
        thread.join(LONG)
        assert not thread.is_alive()


def test_a_call_for_which_there_is_no_thread_is_made_with_the_next_one(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    made: Queue[int] = Queue()
    calls = CallQueue("owners /drive")
    with monkeypatch.context() as short_of_threads:
        short_of_threads.setattr(threads.threading.Thread, "start", no_thread)
        calls.put(made.put, 1)
    assert "can't start new thread" in caplog.text
    calls.put(made.put, 2)
    assert [made.get(timeout=LONG) for _ in range(2)] == [1, 2]
