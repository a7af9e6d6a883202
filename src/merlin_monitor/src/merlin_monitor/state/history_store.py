"""The history: events in a SQLite file that outlives the node. One thread owns the file."""

import contextlib
import json
import queue
import sqlite3
import threading
import time
from concurrent.futures import Future
from pathlib import Path
from typing import Any, Callable, Dict, Iterator, List, Optional, Tuple, TypeVar, Union

from merlin_monitor.state.events import Event
from merlin_monitor.text.plain_value import plain, plain_text

A = TypeVar("A")
Rows = List[Dict[str, Any]]

LONGEST_TEXT = 1000  # characters of an event
WAITING = 5000  # events that wait for the disk; more are counted and left out
BATCH = 500  # events written in one transaction
PRUNE_EVERY = 1000  # events between two looks at the limit
_SCHEMA = """
CREATE TABLE IF NOT EXISTS events (
  id INTEGER PRIMARY KEY AUTOINCREMENT, run INTEGER NOT NULL, wall REAL NOT NULL, at REAL NOT NULL,
  kind TEXT NOT NULL, text TEXT NOT NULL, detail TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS runs (id INTEGER PRIMARY KEY AUTOINCREMENT, began REAL NOT NULL);
"""


class HistoryError(RuntimeError):
    """The file cannot be used; the text says why."""


class HistoryStore:
    """Keeps events.

    :param path: of the file.
    :param limit: most events that are kept; the oldest go first.
    :param on_events: called with the events as they were stored, in the store's thread.
    :param make_folder: whether the file's folder is made. Otherwise events are kept in memory until it
        exists, so that a run which never began leaves nothing behind.
    :raises HistoryError: the file cannot be used.
    """

    def __init__(
        self,
        path: Path,
        limit: int,
        on_events: Callable[[List[Dict[str, Any]]], None] = lambda events: None,
        make_folder: bool = True,
    ) -> None:
        self.path = path
        self._limit = max(100, limit)
        self._on_events = on_events
        self._jobs: queue.Queue[Any] = queue.Queue(WAITING)
        self._lost = 0
        self._written = PRUNE_EVERY  # many short runs are looked at too
        try:
            if make_folder:
                path.parent.mkdir(parents=True, exist_ok=True)
            self._in_memory = not make_folder and not path.parent.is_dir()
            self._connection = _open(":memory:" if self._in_memory else str(path))
            self.run = _begin(self._connection)
        except (OSError, sqlite3.Error) as error:
            raise HistoryError(
                f"the history file {path} cannot be used: {error}; name another one, history:=…"
            ) from error
        self._thread = threading.Thread(target=self._work, name="history", daemon=True)
        self._thread.start()

    def add(self, event: Event) -> None:
        """Takes an event; returns at once."""
        try:
            self._jobs.put_nowait((time.time(), event))
        except queue.Full:
            self._lost += 1

    def page(
        self, before: Optional[int] = None, limit: int = 200, kinds: Tuple[str, ...] = ()
    ) -> "Future[Rows]":
        """The newest events before an id, oldest first, as a future list of dicts."""
        return self._ask(lambda: self._page(before, limit, kinds))

    def export(self) -> "Future[Rows]":
        """All events, as a future list of dicts."""
        return self._ask(lambda: list(self._select("ORDER BY id", ())))

    def close(self) -> None:
        """Writes what waits and closes the file."""
        if self._thread.is_alive():
            self._jobs.put(None)
            self._thread.join(5.0)

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
            try:
                self._write([job for job in jobs if job is not None and isinstance(job[1], Event)])
            except Exception as error:  # a full disk, or a strange event, must not end the monitor
                self._on_events([_lost_event(f"the history could not be written: {error}")])
            for job in jobs:
                if job is not None and isinstance(job[1], Future):
                    _answer(*job)
            if None in jobs:
                with contextlib.suppress(sqlite3.Error):  # there is no one left to report to
                    self._leave_memory()
                self._connection.close()
                return

    def _write(self, events: List[Tuple[float, Event]]) -> None:
        lost, self._lost = self._lost, 0
        if lost:
            events = [
                *events,
                (time.time(), Event("monitor", f"{lost} events came too fast to be kept", 0.0)),
            ]
        if not events:
            return
        self._leave_memory()
        stored: List[Dict[str, Any]] = []
        with self._connection:
            for wall, event in events:
                text = plain_text(event.text, LONGEST_TEXT).encode("utf-8", "replace").decode()
                detail = plain(event.detail)
                at = plain(float(event.at)) or 0.0
                cursor = self._connection.execute(
                    "INSERT INTO events (run, wall, at, kind, text, detail) VALUES (?,?,?,?,?,?)",
                    (self.run, wall, at, event.kind, text, json.dumps(detail)),
                )
                stored.append(
                    {
                        "id": cursor.lastrowid,
                        "run": self.run,
                        "wall": wall,
                        "at": at,
                        "kind": event.kind,
                        "text": text,
                        "detail": detail,
                    }
                )
            self._written += len(events)
            if self._written >= PRUNE_EVERY:
                self._written = 0
                self._connection.execute(
                    "DELETE FROM events WHERE id <= (SELECT MAX(id) FROM events) - ?", (self._limit,)
                )
        self._on_events(stored)

    def _leave_memory(self) -> None:
        if not self._in_memory or not self.path.parent.is_dir():
            return
        file = _open(str(self.path))
        with file:
            # In a new file, which it nearly always is, they get the numbers that they have.
            run = _begin(file)
            rows = self._connection.execute("SELECT wall, at, kind, text, detail FROM events ORDER BY id")
            file.executemany(
                "INSERT INTO events (run, wall, at, kind, text, detail) VALUES (?,?,?,?,?,?)",
                ((run, *row) for row in rows),
            )
        self._connection.close()
        self._connection, self.run, self._in_memory = file, run, False

    def _page(self, before: Optional[int], limit: int, kinds: Tuple[str, ...]) -> List[Dict[str, Any]]:
        conditions: List[str] = []
        values: List[Union[int, str]] = []
        if before is not None:
            conditions.append("id < ?")
            values.append(before)
        if kinds:
            conditions.append(f"kind IN ({','.join('?' * len(kinds))})")
            values += list(kinds)
        where = f"WHERE {' AND '.join(conditions)} " if conditions else ""
        limit = max(1, min(1000, limit))
        return list(self._select(f"{where}ORDER BY id DESC LIMIT ?", (*values, limit)))[::-1]

    def _select(self, rest: str, values: Tuple[Any, ...]) -> Iterator[Dict[str, Any]]:
        cursor = self._connection.execute(
            f"SELECT id, run, wall, at, kind, text, detail FROM events {rest}", values
        )
        for identity, run, wall, at, kind, text, detail in cursor:
            yield {
                "id": identity,
                "run": run,
                "wall": wall,
                "at": at,
                "kind": kind,
                "text": text,
                "detail": json.loads(detail),
            }


def _open(name: str) -> sqlite3.Connection:
    connection = sqlite3.connect(name, check_same_thread=False)
    connection.execute("PRAGMA journal_mode=WAL")
    connection.execute("PRAGMA synchronous=NORMAL")
    return connection


def _begin(connection: sqlite3.Connection) -> int:
    connection.executescript(_SCHEMA)
    cursor = connection.execute("INSERT INTO runs (began) VALUES (?)", (time.time(),))
    connection.commit()
    return cursor.lastrowid or 0


def _answer(question: Callable[[], A], answer: "Future[A]") -> None:
    try:
        answer.set_result(question())
    except Exception as error:  # raised in the caller; the history goes on
        answer.set_exception(HistoryError(f"the history could not be read: {error}"))


def _lost_event(text: str) -> Dict[str, Any]:
    now = time.time()
    return {"id": 0, "run": 0, "wall": now, "at": 0.0, "kind": "monitor", "text": text, "detail": {}}
