# SPDX-License-Identifier: Apache-2.0
"""A process that nobody can reach any more notices it, and ends when it can be started again."""

import contextlib
import itertools
import socket
import threading
import time
from typing import Any, Callable, Iterator, List

import pytest

from merlin_ros.alarms import LONGEST_TICK, call_later
from merlin_ros.ports import self_check
from merlin_ros.ports.self_check import Port, SelfCheck
from merlin_test import LONG


class Watched:
    """What a self-check says of one port."""

    def __init__(self, *ports: int, clock: Callable[[], float] = time.monotonic) -> None:
        self.reasons: List[str] = []
        self.ended = threading.Event()
        asked = [Port("TEST", number, b"?") for number in ports]
        self.check = SelfCheck(lambda: asked, self._end, clock)

    def _end(self, reason: str) -> None:
        self.reasons.append(reason)
        self.ended.set()


@pytest.fixture(autouse=True)
def own_threads(monkeypatch: Any) -> None:
    monkeypatch.setattr(threading.Thread, "start", threading.Thread.start)
    monkeypatch.setattr(threading, "excepthook", lambda _: None)
    monkeypatch.setattr(self_check, "PERIOD", 0.05)


@pytest.fixture
def listening() -> Iterator[socket.socket]:
    with socket.create_server(("127.0.0.1", 0)) as made:
        made.settimeout(LONG)
        yield made


@pytest.fixture
def watched(listening: socket.socket) -> Iterator[Watched]:
    made = Watched(listening.getsockname()[1])
    made.check.start()
    yield made
    made.check.stop()


def answer(listening: socket.socket) -> None:
    connection, _ = listening.accept()
    with connection:
        assert connection.recv(1) == b"?"
        connection.sendall(b"!")


def go_on_answering(listening: socket.socket) -> None:
    def work() -> None:
        with contextlib.suppress(OSError):  # the test is over
            while True:
                answer(listening)

    threading.Thread(target=work, daemon=True).start()


def test_a_port_that_does_not_answer_ends_the_process(
    monkeypatch: Any, listening: socket.socket, watched: Watched
) -> None:
    answer(listening)
    monkeypatch.setattr(self_check, "ANSWER", 0.2)
    assert watched.ended.wait(LONG)
    number = listening.getsockname()[1]
    assert watched.reasons == [f"its port {number} (TEST) gives no answer: it is silent"]


def test_an_answer_that_is_late_as_the_looks_for_it_are_ends_nothing(
    monkeypatch: Any, listening: socket.socket
) -> None:
    looks, enough = itertools.count(), threading.Event()

    def starved() -> float:
        """A clock that goes on by twice the time that a look at it should have waited."""
        number = next(looks)
        if number > 2 * self_check.ANSWER / LONGEST_TICK:
            enough.set()
        return LONGEST_TICK * number

    monkeypatch.setattr(self_check, "PATIENCE", 1)
    watched = Watched(listening.getsockname()[1], clock=starved)
    watched.check.start()
    connection, _ = listening.accept()
    with connection:
        assert enough.wait(LONG)
        connection.sendall(b"!")
    answer(listening)  # it has looked again
    watched.check.stop()
    assert not watched.reasons


def test_a_closed_port_ends_the_process(monkeypatch: Any, listening: socket.socket, watched: Watched) -> None:
    monkeypatch.setattr(self_check, "ANSWER", 0.2)
    listening.close()
    assert watched.ended.wait(LONG)
    assert "refused" in watched.reasons[0]


def test_a_port_that_answers_again_in_time_ends_nothing(listening: socket.socket, watched: Watched) -> None:
    for _ in range(3):
        for _ in range(self_check.PATIENCE - 1):
            connection, _ = listening.accept()
            connection.close()
        answer(listening)
    assert not watched.reasons


def test_a_timer_that_stands_ends_the_process(monkeypatch: Any) -> None:
    monkeypatch.setattr(self_check, "ANSWER", 0.2)
    watched, over = Watched(), threading.Event()
    call_later(0.0, lambda: over.wait(LONG))
    watched.check.start()
    assert watched.ended.wait(LONG)
    over.set()
    watched.check.stop()
    assert watched.reasons == ["its timer stands: a call of it does not return"]


def test_a_thread_that_did_not_start_ends_the_process_once_its_ports_answer(
    monkeypatch: Any, listening: socket.socket, watched: Watched
) -> None:
    def refuse(*_: Any) -> None:
        raise RuntimeError("can't start new thread")

    thread = threading.Thread(target=print, name="a worker")
    with monkeypatch.context() as patch:
        patch.setattr(threading, "_start_new_thread", refuse, raising=False)
        patch.setattr(threading, "_start_joinable_thread", refuse, raising=False)  # Python 3.13
        with pytest.raises(RuntimeError):
            thread.start()
    assert not watched.reasons
    go_on_answering(listening)
    assert watched.ended.wait(LONG)
    assert watched.reasons == ["the thread 'a worker' could not be started: can't start new thread"]


def test_a_thread_that_ends_for_want_of_a_descriptor_ends_the_process(
    listening: socket.socket, watched: Watched
) -> None:
    def work() -> None:
        raise OSError(24, "Too many open files")

    thread = threading.Thread(target=work, name="a worker")
    thread.start()
    thread.join()
    go_on_answering(listening)
    assert watched.ended.wait(LONG)
    assert watched.reasons == ["the thread 'a worker' has died: [Errno 24] Too many open files"]


def test_other_faults_of_threads_are_left_alone(listening: socket.socket, watched: Watched) -> None:
    def work() -> None:
        raise OSError(2, "No such file")

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    with pytest.raises(RuntimeError):
        thread.start()
    answer(listening)
    answer(listening)
    answer(listening)
    assert not watched.reasons
