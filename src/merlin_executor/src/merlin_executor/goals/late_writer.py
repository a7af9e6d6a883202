"""Writes values one after the other, in a thread of its own where the caller must not wait. Without ROS."""

import threading
from typing import Callable, Generic, Optional, TypeVar

_Value = TypeVar("_Value")


class LateWriter(Generic[_Value]):
    """Writes the last value that was given; one that a newer value replaces before its turn is never written.

    :param name: of the thread.
    :param write: writes one value; called by one thread at a time.
    :param failed: called with what `write` raised in the thread; the writer continues with the next value.
    """

    def __init__(
        self, name: str, write: Callable[[_Value], None], failed: Callable[[Exception], None]
    ) -> None:
        self._name = name
        self._write = write
        self._failed = failed
        self._writing = threading.Lock()  # held while a value is written: the last word comes last
        self._changed = threading.Condition()  # guards the two fields below
        self._next: Optional[_Value] = None
        self._thread: Optional[threading.Thread] = None

    def write(self, value: _Value) -> None:
        """Writes a value in the caller's thread, in place of one that waits. Raises what `write` does."""
        with self._writing:
            self._take()
            self._write(value)

    def write_soon(self, value: _Value) -> None:
        """Writes a value in another thread."""
        with self._changed:
            self._next = value
            if self._thread is None:
                self._thread = threading.Thread(target=self._work, name=self._name, daemon=True)
                self._thread.start()
            self._changed.notify_all()

    def _take(self) -> Optional[_Value]:
        with self._changed:
            value, self._next = self._next, None
        return value

    def _work(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._next is not None)
            with self._writing:
                value = self._take()
                if value is None:  # a later word was written meanwhile
                    continue
                try:
                    self._write(value)
                except Exception as error:  # of the function that stores the value
                    self._failed(error)
