# SPDX-License-Identifier: Apache-2.0
"""Answers questions about a history, in the one thread that owns its file."""

import contextlib
import queue
import sqlite3
from concurrent.futures import Future
from pathlib import Path
from typing import Any, Callable, List, Optional, Tuple, TypeVar

from merlin_monitor.history.event_log import EventLog, Neighbour, Row
from merlin_monitor.history.frames import Recording
from merlin_monitor.history.history_file import HistoryError, open_for_reading
from merlin_ros.work.threads import start_thread

A = TypeVar("A")
WAITING = 5000  # questions and events that wait for the disk
BATCH = 500  # of them that are taken at once
CLOSING = 5.0  # s for what waits


class HistoryReader:
    """The history of runs that have ended; :class:`HistoryStore` also writes one.

    All methods return at once, those that ask with a future.

    :param connection: becomes its own.
    :param monitor: whose runs and events these are, as several may share a file; empty: all.
    """

    def __init__(self, connection: sqlite3.Connection, monitor: str = "") -> None:
        self._monitor = monitor
        self._jobs: queue.Queue[Any] = queue.Queue(WAITING)
        self._use(connection)
        self._thread = start_thread("history", self._work)

    @classmethod
    def of(cls, path: Path) -> "HistoryReader":
        """The history in a file or folder.

        :raises HistoryError: it cannot be read.
        """
        return cls(open_for_reading(path))

    def page(
        self, before: Optional[int] = None, limit: int = 200, kinds: Tuple[str, ...] = ()
    ) -> "Future[List[Row]]":
        """The newest events before an id, oldest first."""
        return self._ask(lambda: self._log.page(before, limit, kinds))

    def export(self) -> "Future[List[Row]]":
        """All events, oldest first."""
        return self._ask(lambda: self._log.all())

    def neighbour(self, wanted: Neighbour) -> "Future[Optional[Row]]":
        """The next event, or the last one before."""
        return self._ask(lambda: self._log.neighbour(wanted))

    def marks(self, run: int) -> "Future[List[List[Any]]]":
        """The marked events of a run: id, s since 1970, mark."""
        return self._ask(lambda: self._log.marks(run))

    def runs(self) -> "Future[List[Row]]":
        """The runs with recorded pages, oldest first."""
        return self._ask(lambda: self._recording.runs(self._monitor))

    def segment(self, run: int, wall: float) -> "Future[Optional[str]]":
        """What was shown around a moment, as :meth:`Recording.segment` has it."""
        return self._ask(lambda: self._recording.segment(run, wall))

    def readable(self, run: int) -> "Future[Optional[str]]":
        """The newest segment of a run that can be read, as :meth:`Recording.readable` has it."""
        return self._ask(lambda: self._recording.readable(run))

    def picture(self, name: str, version: str) -> "Future[Optional[bytes]]":
        """A recorded picture in that version; None: there is none."""
        return self._ask(lambda: self._recording.picture(name, version))

    def close(self) -> None:
        """Finishes the waiting jobs and closes the file; a disk that hangs is waited for some seconds."""
        if self._thread.is_alive():
            with contextlib.suppress(queue.Full):
                self._jobs.put(None, timeout=CLOSING)
                self._thread.join(CLOSING)

    # --- in the thread of the history -----------------------------------------------------------------------

    def _use(self, connection: sqlite3.Connection) -> None:
        self._connection = connection
        self._log = EventLog(connection, self._monitor)
        self._recording = Recording(connection)

    def _write(self, jobs: List[Any]) -> None:
        """Hook: writes the jobs that are not questions."""

    def _finish(self) -> None:
        """Before the file is closed."""

    def _ask(self, question: Callable[[], A]) -> "Future[A]":
        answer: Future[A] = Future()
        if not self._thread.is_alive():
            answer.set_exception(HistoryError("the history is closed"))
            return answer
        try:
            self._jobs.put_nowait((question, answer))
        except queue.Full:
            answer.set_exception(HistoryError("the history is busy; ask again"))
        return answer

    def _work(self) -> None:
        while True:
            jobs = [self._jobs.get()]
            with contextlib.suppress(queue.Empty):
                while len(jobs) < BATCH:
                    jobs.append(self._jobs.get_nowait())
            self._write([job for job in jobs if job is not None and not isinstance(job[1], Future)])
            for job in jobs:
                if job is not None and isinstance(job[1], Future):
                    _answer(*job)
            if None in jobs:
                with contextlib.suppress(sqlite3.Error):  # there is no one left to report to
                    self._finish()
                self._connection.close()
                return


def _answer(question: Callable[[], A], answer: "Future[A]") -> None:
    if not answer.set_running_or_notify_cancel():
        return
    try:
        answer.set_result(question())
    except Exception as error:  # raised in the caller; the history continues
        answer.set_exception(HistoryError(f"the history could not be read: {error}"))
