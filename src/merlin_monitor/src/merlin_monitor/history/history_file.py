# SPDX-License-Identifier: Apache-2.0
"""The SQLite file of the history: its tables, and how it is opened and checked."""

import sqlite3
import threading
import time
from pathlib import Path
from typing import Callable, NamedTuple, Optional

FILE = "history.sqlite"
SIDE_FILES = ("", "-wal", "-shm")  # endings of the file, and of those that SQLite keeps beside it
#: Of the file. 0: events only, as files were before they held what was shown; 1: frames without checksums.
VERSION = 2
BUSY = 10.0  # s that another process may hold the file, before it counts as an error
DIGITS = 6  # of a time behind the point, also in the address of a moment
LEAST = 10.0**-DIGITS  # s between two times
LONGEST_GAP = 600.0  # s in a run, in which no monitor lived
_SCHEMA = """
CREATE TABLE IF NOT EXISTS events (
  id INTEGER PRIMARY KEY AUTOINCREMENT, run INTEGER NOT NULL, wall REAL NOT NULL, at REAL NOT NULL,
  kind TEXT NOT NULL, text TEXT NOT NULL, detail TEXT NOT NULL, mark TEXT NOT NULL DEFAULT '');
CREATE TABLE IF NOT EXISTS runs (
  id INTEGER PRIMARY KEY AUTOINCREMENT, began REAL NOT NULL, session TEXT NOT NULL DEFAULT '');
CREATE TABLE IF NOT EXISTS segments (
  run INTEGER NOT NULL, number INTEGER NOT NULL, began REAL NOT NULL, ended REAL NOT NULL,
  bytes INTEGER NOT NULL, PRIMARY KEY (run, number)) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS frames (
  run INTEGER NOT NULL, segment INTEGER NOT NULL, number INTEGER NOT NULL, data BLOB NOT NULL,
  PRIMARY KEY (run, segment, number)) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS pictures (
  name TEXT NOT NULL, version TEXT NOT NULL, wall REAL NOT NULL, data BLOB NOT NULL,
  PRIMARY KEY (name, version));
"""
#: The monitor of a run, by its name as a node; empty: it is not known.
MONITOR = "substr(session, instr(session, ' ') + 1)"
#: Condition for the runs of a monitor, and those of which the monitor is not known.
OF_MONITOR = f"+run IN (SELECT id FROM runs WHERE session = '' OR {MONITOR} = {{}})"
_LAST_RUN = """
SELECT id, MAX(number), MAX(ended) FROM runs JOIN segments ON run = id
WHERE session = ? GROUP BY id ORDER BY id DESC LIMIT 1;
"""
_INDICES = """
CREATE INDEX IF NOT EXISTS events_in_time ON events (run, wall);
CREATE INDEX IF NOT EXISTS events_marked ON events (run, wall) WHERE mark != '';
"""


class HistoryError(RuntimeError):
    """The file cannot be used; the text says why."""


def open_for_writing(name: str) -> sqlite3.Connection:
    """Opens a file, which is made if there is none, and brings an older one up to date.

    :raises HistoryError: a newer MERLIN, or another program, has written it.
    :raises sqlite3.Error: it cannot be written, is damaged, or is something else.
    """
    connection = sqlite3.connect(name, timeout=BUSY, check_same_thread=False)
    try:
        if _foreign(connection, new=True):
            raise HistoryError("it is the file of another program")
        version = connection.execute("PRAGMA user_version").fetchone()[0]
        if version > VERSION:
            raise HistoryError(_newer(version))
        connection.execute("PRAGMA journal_mode=WAL")
        connection.execute("PRAGMA synchronous=NORMAL")
        connection.isolation_level = None
        connection.execute("BEGIN IMMEDIATE")  # two monitors may begin with one file
        for statement in _SCHEMA.split(";"):
            connection.execute(statement)
        for table, added in (("events", "mark"), ("runs", "session")):
            if added not in [column[1] for column in connection.execute(f"PRAGMA table_info({table})")]:
                connection.execute(f"ALTER TABLE {table} ADD COLUMN {added} TEXT NOT NULL DEFAULT ''")
        for statement in _INDICES.split(";"):
            connection.execute(statement)
        connection.execute(f"PRAGMA user_version={VERSION}")
        connection.execute("COMMIT")
        connection.isolation_level = "DEFERRED"
    except BaseException:
        connection.close()
        raise
    return connection


def begin_run(connection: sqlite3.Connection, wall: float, session: str = "") -> int:
    """The number of a run that begins.

    :param session: of the master, a blank, and the monitor's name. A later life of this monitor with the
        same one goes on with the run; empty: none does.
    """
    with connection:
        row = "INSERT INTO runs (began, session) VALUES (?,?)"
        return connection.execute(row, (wall, session)).lastrowid or 0


class LastRun(NamedTuple):
    """The run of an earlier life of this monitor: its number, and that of its last segment."""

    run: int
    segment: int


def last_run(connection: sqlite3.Connection, wall: Optional[float], session: str) -> Optional[LastRun]:
    """The run of a session; None: none, one of long ago, or the computer's clock went back since.

    :param wall: now, s since 1970; None: of any time.
    """
    row = session and connection.execute(_LAST_RUN, (session,)).fetchone()
    if row and (wall is None or row[2] <= wall <= row[2] + LONGEST_GAP):
        return LastRun(row[0], row[1])
    return None


def open_for_reading(path: Path, events_only: bool = False) -> sqlite3.Connection:
    """Opens the history of a run, also while that run goes on.

    :param path: the file, or the folder that it lies in.
    :param events_only: its events are enough, as older files have them.
    :raises HistoryError: when it is missing, damaged, newer, another file, or without what was shown.
    """
    try:
        file = path / FILE if path.is_dir() else path
        there = file.is_file()
    except OSError as error:  # of a folder into which this user may not look
        raise HistoryError(f"{path} cannot be read: {error.strerror}") from error
    if not there:
        raise HistoryError(
            f"there is no history {file}; name the results folder of a run that had a monitor, or its file"
        )
    try:
        return _checked(file, "mode=ro", events_only)
    except sqlite3.OperationalError:
        # A folder that cannot be written cannot take SQLite's lock files either.
        try:
            return _checked(file, "mode=ro&immutable=1", events_only)
        except sqlite3.Error as error:
            raise HistoryError(f"{file} cannot be read: {error}") from error
    except sqlite3.DatabaseError as error:
        raise HistoryError(f"{file} is not a history, or damaged: {error}") from error


def _checked(file: Path, how: str, events_only: bool) -> sqlite3.Connection:
    connection = sqlite3.connect(
        f"{file.resolve().as_uri()}?{how}", uri=True, timeout=BUSY, check_same_thread=False
    )
    try:
        if _foreign(connection, new=False):
            raise HistoryError(f"{file} is the file of another program, not a history")
        version = connection.execute("PRAGMA user_version").fetchone()[0]
        if version > VERSION:
            raise HistoryError(f"{file}: {_newer(version)}")
        shown = version and connection.execute("SELECT 1 FROM segments LIMIT 1").fetchone()
        if not (shown or events_only):
            raise HistoryError(
                f"{file} holds events only, not what was shown; read them with 'rosrun merlin history {file}'"
            )
        connection.execute(
            "SELECT COUNT(*), MAX(detail) FROM (SELECT detail FROM events ORDER BY id DESC LIMIT 200)"
        )
    except BaseException:
        connection.close()
        raise
    return connection


def _foreign(connection: sqlite3.Connection, new: bool) -> bool:
    """Whether a file is another program's.

    :param new: whether one without tables is not.
    """
    tables = {row[0] for row in connection.execute("SELECT name FROM sqlite_master WHERE type='table'")}
    return not ({"events", "runs"} <= tables or (new and not tables))


def _newer(version: int) -> str:
    return f"a newer MERLIN has written this file (version {version}, this one knows {VERSION}); update it"


class WallClock:
    """s since 1970 that never go back, also when the computer's clock is set. Safe between threads.

    No two readings are the same: of two times of a history, the smaller one is of what was first.

    :param now: s since 1970, never going back; None: of this computer.
    """

    def __init__(self, now: Optional[Callable[[], float]] = None) -> None:
        began = time.time() - time.monotonic()
        self._now = now or (lambda: began + time.monotonic())
        self._lock = threading.Lock()  # guards _last
        self._last = 0.0

    def __call__(self) -> float:
        """Wall time, s since 1970, that never jumps."""
        with self._lock:
            self._last = round(max(self._now(), self._last + LEAST), DIGITS)
            return self._last
