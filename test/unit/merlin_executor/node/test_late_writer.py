"""Values that are written in another thread: the last word counts, and a fault ends nothing."""

import threading
from typing import List

import pytest

from merlin_executor.node.own_goals import LateWriter

LONG = 60.0


class Store:
    """Keeps what is written; waits until it is let go on, and refuses some values."""

    def __init__(self) -> None:
        self.written: List[str] = []
        self.failures: List[Exception] = []
        self.changed = threading.Condition()
        self.asked = threading.Event()
        self.goes_on = threading.Event()
        self.goes_on.set()

    def write(self, value: str) -> None:
        self.asked.set()
        assert self.goes_on.wait(LONG)
        if value.startswith("refused"):
            raise OSError(value)
        with self.changed:
            self.written.append(value)
            self.changed.notify_all()

    def failed(self, error: Exception) -> None:
        with self.changed:
            self.failures.append(error)
            self.changed.notify_all()

    def wait_for(self, count: int) -> None:
        with self.changed:
            assert self.changed.wait_for(lambda: len(self.written) + len(self.failures) >= count, LONG)


@pytest.fixture
def store() -> Store:
    return Store()


@pytest.fixture
def writer(store: Store) -> LateWriter:
    return LateWriter("notes", store.write, store.failed)


def test_the_caller_does_not_wait(store: Store, writer: LateWriter) -> None:
    store.goes_on.clear()
    writer.write_soon("one")
    assert store.asked.wait(LONG) and store.written == []
    store.goes_on.set()
    store.wait_for(1)
    assert store.written == ["one"]


def test_a_value_that_is_replaced_before_its_turn_is_never_written(store: Store, writer: LateWriter) -> None:
    store.goes_on.clear()
    writer.write_soon("one")
    assert store.asked.wait(LONG)
    for value in ("two", "three", "four"):
        writer.write_soon(value)
    store.goes_on.set()
    store.wait_for(2)
    assert store.written == ["one", "four"]


def test_a_word_in_the_callers_thread_takes_the_place_of_one_that_waits(
    store: Store, writer: LateWriter
) -> None:
    store.goes_on.clear()
    writer.write_soon("one")
    assert store.asked.wait(LONG)
    writer.write_soon("two")
    store.goes_on.set()
    writer.write("three")
    assert store.written[-1] == "three"
    assert store.written in (["one", "three"], ["one", "two", "three"])


def test_the_caller_sees_why_its_value_was_not_written(writer: LateWriter) -> None:
    with pytest.raises(OSError, match="refused it"):
        writer.write("refused it")


def test_after_a_fault_the_next_value_is_written(store: Store, writer: LateWriter) -> None:
    writer.write_soon("refused it")
    store.wait_for(1)
    assert [str(error) for error in store.failures] == ["refused it"]
    writer.write_soon("two")
    store.wait_for(2)
    assert store.written == ["two"]
