# SPDX-License-Identifier: Apache-2.0
"""The history of the present run: its events and what the page showed, in a file that outlives the node."""

import concurrent.futures
import queue
import sqlite3
import threading
from collections import deque
from pathlib import Path
from typing import Any, Callable, Deque, Dict, List, Optional, Tuple

from merlin_monitor.history.event_log import Row, row_of
from merlin_monitor.history.frames import Frame
from merlin_monitor.history.history_file import HistoryError, WallClock, begin_run, last_run, open_for_writing
from merlin_monitor.history.history_reader import HistoryReader
from merlin_monitor.state.history_events import Event, sentence
from merlin_monitor.state.recorder import last_state
from merlin_monitor.state.state_tree import StateTree
from merlin_monitor.text.phrase import say

__all__ = ["HistoryError", "HistoryStore"]

PRUNE_EVERY = 1000  # events between two looks at the limit
MEGABYTE = 1_000_000
SECTION = "history"
NEWEST = 200  # events in the state; older ones are asked for page by page
END_OF_TIME = 1e12  # s since 1970
_COPIED = (
    ("events", "wall, at, kind, text, detail, mark"),
    ("segments", "number, began, ended, bytes"),
    ("frames", "segment, number, data"),
)


class HistoryStore(HistoryReader):
    """Keeps events and frames.

    :param path: of the file.
    :param limit: most events that are kept; the oldest go first.
    :param on_events: called with the events as they were stored, in the store's thread.
    :param make_folder: whether the file's folder is made. Otherwise all is kept in memory until it
        exists, so that a run which never began leaves nothing behind.
    :param megabytes: most that is kept of what was shown; the oldest goes first.
    :param clock: s since 1970, the time of all that is kept; None: now.
    :param session: with that of an earlier life, its run is gone on with; empty: a run begins.
    :raises HistoryError: the file cannot be used.
    """

    def __init__(
        self,
        path: Path,
        limit: int,
        on_events: Callable[[List[Row]], None] = lambda events: None,
        make_folder: bool = True,
        megabytes: float = 500.0,
        clock: Optional[Callable[[], float]] = None,
        session: str = "",
    ) -> None:
        self.path = path
        self.now = WallClock(clock)
        """s since 1970, the time of all that is kept."""
        self.trouble = ""
        """Why something could not be written; empty: everything could."""
        self._began = self.now()
        self._session = session
        self._limit = max(100, limit)
        self._bytes = megabytes * MEGABYTE
        self._on_events = on_events
        self._lost = 0
        self._gap = False  # a frame was lost: those that build on it are of no use
        self._written = PRUNE_EVERY  # many short runs are looked at too
        try:
            if make_folder:
                path.parent.mkdir(parents=True, exist_ok=True)
            self._in_memory = not make_folder and not path.parent.is_dir()
            connection = open_for_writing(":memory:" if self._in_memory else str(path))
            self.last = last_run(connection, self._began, session)
            """The run that is gone on with; None: a new one."""
            self.run = self.last.run if self.last else begin_run(connection, self._began, session)
        except (OSError, sqlite3.Error, HistoryError) as error:
            raise HistoryError(
                f"the history file {path} cannot be used: {error}; name another one, history:=…"
            ) from error
        super().__init__(connection)

    def last_state(self, limit: float) -> Dict[str, Any]:
        """What the earlier life showed last; empty: there is none, or it cannot be read.

        :param limit: s for the answer.
        """
        if self.last is None:
            return {}
        try:
            return last_state(self.segment(self.run, END_OF_TIME).result(limit))
        except (HistoryError, ValueError, concurrent.futures.TimeoutError):
            return {}

    def add(self, event: Event) -> None:
        """Takes an event; returns at once."""
        try:
            self._jobs.put_nowait((self.now(), event))
        except queue.Full:
            self._lost += 1

    def add_frame(self, frame: Frame) -> bool:
        """Takes what was shown; False: it is lost, and the next frame has to begin a segment."""
        if frame.number == 0:
            self._gap = False
        elif self._gap:
            return False
        return self._put((frame.wall, frame))

    def add_picture(self, name: str, version: str, data: bytes) -> None:
        """Takes a picture; the next frame may name it."""
        self._put(((name, version, self.now()), data))

    def _put(self, job: Tuple[Any, Any]) -> bool:
        try:
            self._jobs.put_nowait(job)
        except queue.Full:
            return False
        return True

    # --- in the thread of the history -----------------------------------------------------------------------

    def _write(self, jobs: List[Any]) -> None:
        lost, self._lost = self._lost, 0
        if lost:
            said = say("{count} events came too fast to be kept", count=str(lost))
            jobs = [*jobs, (self.now(), sentence("monitor", said, 0.0))]
        if not jobs:
            return
        try:
            self._on_events(self._store(jobs))
        except Exception as error:  # a full disk, or a strange event, must not end the monitor
            self._gap = True
            self.trouble = str(error)
            said = say("the history could not be written: {why}", why=str(error))
            self._on_events([{"id": 0, **row_of(0, self.now(), sentence("monitor", said, 0.0))}])

    def _store(self, jobs: List[Any]) -> List[Row]:
        self._leave_memory()
        stored: List[Row] = []
        with self._connection:
            for key, job in jobs:
                if isinstance(job, Frame):
                    self._recording.add(self.run, job, self._bytes)
                elif isinstance(job, bytes):
                    name, version, wall = key
                    self._recording.put_picture(name, version, wall, job)
                else:
                    stored.append(self._log.add(self.run, key, job))
            self._written += len(stored)
            if self._written >= PRUNE_EVERY:
                self._written = 0
                self._log.prune(self._limit)
        return stored

    def _finish(self) -> None:
        self._leave_memory()

    def _leave_memory(self) -> None:
        if not self._in_memory or not self.path.parent.is_dir():
            return
        file = open_for_writing(str(self.path))
        run = begin_run(file, self._began, self._session)
        with file:
            # In a new file, which it nearly always is, events get the numbers that they have.
            for table, columns in _COPIED:
                order = "id" if table == "events" else "1, 2"
                rows = self._connection.execute(f"SELECT {columns} FROM {table} ORDER BY {order}")
                marks = ",".join("?" * len(columns.split(",")))
                file.executemany(f"INSERT INTO {table} (run, {columns}) VALUES ({run},{marks})", rows)
            pictures = self._connection.execute("SELECT * FROM pictures")
            file.executemany("INSERT OR REPLACE INTO pictures VALUES (?,?,?,?)", pictures)
        self._connection.close()
        self._use(file)
        self.run, self._in_memory = run, False


class HistorySection:
    """Keeps the section ``history`` of the state."""

    def __init__(self, tree: StateTree) -> None:
        self._tree = tree
        self._lock = threading.Lock()  # guards _shown: the first page comes from another thread
        self._shown: Deque[str] = deque()
        tree.set(SECTION, "events", {})

    def add(self, events: List[Dict[str, Any]]) -> None:
        """Shows stored events."""
        with self._lock:
            for event in events[-NEWEST:]:
                key = str(event["id"])
                self._tree.set(SECTION, "events", key, event)
                self._shown.append(key)
            while len(self._shown) > NEWEST:
                self._tree.remove(SECTION, "events", self._shown.popleft())
