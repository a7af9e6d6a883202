# SPDX-License-Identifier: Apache-2.0
"""Keeps a knowledge base in an SQLite file, so that a killed process finds everything again.

What was acknowledged survives the process, whatever kills it: it is in the write-ahead log before the
answer. A power cut is another matter, because a sync to the disk costs milliseconds: a transaction of the
journal of executions waits for one, and takes all earlier ones with it; the others are synced within 0.1 s.
So a power cut may take the knowledge of the last 0.1 s, never the beginning or the end of an execution, and
never the file's consistency.

On a full disk new knowledge is refused. What ends something still succeeds, from space kept for that: else
executions and goals would stay open that nothing carries out any more.
"""

import contextlib
import errno
import fcntl
import json
import logging
import os
import sqlite3
import threading
import time
from operator import itemgetter
from typing import Any, Dict, List, NoReturn, Optional, Sequence, Tuple

from merlin_pddl.domain import Domain
from merlin_pddl.knowledge import Row
from merlin_ros.alarms import call_later
from merlin_ros.work.threads import CallQueue
from merlin_rosplan.knowledge.knowledge_store import Journal
from merlin_rosplan.knowledge.transaction import Step
from merlin_rosplan.storage.state_codec import decode_row, encode_row

_log = logging.getLogger(__name__)

SYNC_DELAY = 0.1  # s of wall time in which writes are gathered for one sync
AGAIN = 10.0  # s of wall time between two tries to make a file that was removed
#: bytes; a closed execution takes about 20 thousand.
RESERVE_SIZE = 256 * 1024
FORMAT = "1"
_TABLES = {
    "meta": "(name TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID",
    "row": "(kind TEXT, key TEXT, place INTEGER NOT NULL, data TEXT NOT NULL, PRIMARY KEY (kind, key)) "
    "WITHOUT ROWID",
}
#: what reading a row raises that something else has written
_DAMAGE = (ValueError, KeyError, TypeError, AssertionError, AttributeError, RecursionError)
_WHAT_TO_DO = "move it away, or start once with reset_state:=true"


class StateFileError(Exception):
    """The state file cannot be used; the text says why and what to do."""


class StateFile(Journal):
    """A state file, opened for this process alone. The store's lock guards it.

    :param path: of the file; it is made when it does not exist.
    :param domain: whose knowledge it holds.
    :param reset: forget what the file holds.
    :raises StateFileError: when it is damaged, in use, not writable, or of another domain.
    """

    def __init__(self, path: str, domain: Domain, reset: bool = False) -> None:
        self._path = os.path.abspath(os.path.expanduser(path))
        self._domain = domain
        self._sync: Optional[LateSync] = None
        self._make_again_at = 0.0  # monotonic, s
        self._reserve = DiskReserve(f"{self._path}.reserve")
        try:
            os.makedirs(os.path.dirname(self._path), exist_ok=True)
            self._lock = StateLock(self._path)
            try:
                if reset:
                    self._remove()
                self._connect()
            except BaseException:
                self._lock.close()
                raise
        except StateLockedError as error:
            raise StateFileError(
                f"the state file {self._path} cannot be used: {error}; is another knowledge base using it?"
            ) from error
        except (sqlite3.Error, OSError) as error:
            hint = "; is another knowledge base using it?" if "locked" in str(error) else ""
            raise StateFileError(f"the state file {self._path} cannot be used: {error}{hint}") from error

    def _remove(self) -> None:
        for suffix in ("", "-wal", "-shm", "-journal", ".reserve"):
            if os.path.exists(self._path + suffix):
                os.remove(self._path + suffix)

    def _connect(self) -> None:
        self._database = sqlite3.connect(
            self._path, timeout=1.0, isolation_level=None, check_same_thread=False
        )
        try:
            self._open()
            log = f"{self._path}-wal"
            if os.path.exists(log):  # otherwise the file system allows none, and every commit is synced
                self._sync = LateSync(log)
            if not self._reserve.hold():
                _log.warning("there is no space for %s.reserve: the disk is nearly full", self._path)
        except BaseException:
            self._database.close()
            raise

    def _open(self) -> None:
        execute = self._database.execute
        execute("PRAGMA locking_mode = EXCLUSIVE")
        execute("PRAGMA journal_mode = WAL")
        execute("PRAGMA synchronous = NORMAL")
        execute("BEGIN IMMEDIATE")
        tables = {name for (name,) in execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
        if not tables:
            for name, columns in _TABLES.items():
                execute(f"CREATE TABLE {name} {columns}")
        for name in _TABLES:
            if tables and name not in tables:
                self._damaged(f"the table '{name}' is missing")
        known = dict(execute("SELECT name, value FROM meta"))
        ours = {"format": FORMAT, "domain": self._domain.name, "digest": self._domain.digest}
        if not known and execute("SELECT 1 FROM row LIMIT 1").fetchone() is None:
            known = {**ours, "version": "0"}
            self._database.executemany("INSERT INTO meta VALUES (?, ?)", list(known.items()))
        execute("COMMIT")
        self._check(known, ours)

    def _check(self, known: Dict[str, Any], ours: Dict[str, str]) -> None:
        for name in (*ours, "version"):
            if name not in known:
                self._damaged(f"the row '{name}' of the table 'meta' is missing")
        for name, value in ours.items():
            if known[name] != value:
                raise StateFileError(
                    f"the state file {self._path} holds knowledge of another domain or of another version "
                    f"of it ({name} '{known[name]}', not '{value}'): {_WHAT_TO_DO}"
                )

    def _damaged(self, what: str, cause: Optional[Exception] = None) -> NoReturn:
        raise StateFileError(f"the state file {self._path} is damaged: {what}; {_WHAT_TO_DO}") from cause

    def load(self) -> Tuple[int, List[Tuple[str, Row]]]:
        """Version and rows of the last commit. Version 0: nothing was ever stored.

        :raises StateFileError: when a row cannot be read; the text names it.
        """
        found: List[Tuple[str, Row]] = []
        try:
            (text,) = self._database.execute("SELECT value FROM meta WHERE name = 'version'").fetchone()
            stored = self._database.execute("SELECT kind, key, place, data FROM row").fetchall()
        except (sqlite3.Error, TypeError) as error:
            self._damaged(str(error), error)
        values = _decoded(stored)
        for (kind, key, place, data), value in zip(stored, values or [None] * len(stored)):
            try:
                found.append(
                    (kind, self._row(kind, key, place, json.loads(data) if values is None else value))
                )
            except _DAMAGE as error:
                shown = str(key).replace(_SEPARATOR, " ")[:100]
                self._damaged(f"the row '{kind}' '{shown}' of the table 'row' is wrong: {error}", error)
        version = int(text) if str(text).isdigit() else -1
        if version < (1 if found else 0):
            self._damaged(f"the row 'version' of the table 'meta' is '{text}'")
        return version, found

    @staticmethod
    def _row(kind: Any, key: Any, place: Any, value: Any) -> Row:
        if not isinstance(place, int):
            raise ValueError(f"its place is {place!r}, not a whole number")
        row = decode_row(kind, value)
        row.order = place
        if _text(row.key) != key:
            raise ValueError(f"it holds '{_text(row.key).replace(_SEPARATOR, ' ')}'")
        return row

    def commit(self, steps: Sequence[Step], version: int) -> None:
        """Writes a transaction; one that opens or closes an execution survives a power cut, too.

        What is new needs the reserve: another process may take the rest of the disk before it ends.

        :raises OSError: when it could not be written; the file holds what it held before.
        """
        if not os.path.exists(self._path) and time.monotonic() >= self._make_again_at:
            self._make_again_at = time.monotonic() + AGAIN
            self._make_again()
        journalled = any(table.kind == "execution" for table, *_ in steps)
        ends = _ends_something(steps)
        if not (ends or self._reserve.hold()):
            raise OSError(f"{self._path}: database or disk is full")
        try:
            try:
                self._write(steps, version, journalled)
            except sqlite3.OperationalError:
                if not (ends and self._reserve.release()):
                    raise
                self._write(steps, version, journalled)
        except sqlite3.Error as error:
            raise OSError(f"{self._path}: {error}") from error
        if self._sync is not None and not journalled:
            self._sync.soon()

    def _make_again(self) -> None:
        """The file was removed, as ``rosclean purge`` does: the next process would begin with nothing."""
        copy = f"{self._path}.copy"
        try:
            os.makedirs(os.path.dirname(self._path), exist_ok=True)
            if not self._lock.stays:
                self._lock.close()
                self._lock = StateLock(self._path)
            self._database.execute("VACUUM INTO ?", (copy,))
            for suffix in ("-wal", "-shm"):  # of the file that was there: they do not fit the copy
                with contextlib.suppress(FileNotFoundError):
                    os.remove(self._path + suffix)
            os.replace(copy, self._path)
        except (sqlite3.Error, OSError, StateLockedError) as error:
            _log.error("the state file %s was removed, and cannot be made again: %s", self._path, error)
            with contextlib.suppress(OSError):
                os.remove(copy)
            return
        _log.warning("the state file %s was removed, and is made again", self._path)
        if self._sync is not None:
            self._sync.close()
            self._sync = None
        self._database.close()  # first: it removes the log by its name
        self._reserve.close()
        self._connect()

    def _write(self, steps: Sequence[Step], version: int, journalled: bool) -> None:
        execute = self._database.execute
        execute(f"PRAGMA synchronous = {'FULL' if journalled else 'NORMAL'}")
        execute("BEGIN IMMEDIATE")
        try:
            for table, key, _, after in steps:
                if key is None:
                    execute("DELETE FROM row WHERE kind = ?", (table.kind,))
                elif after is None:
                    execute("DELETE FROM row WHERE kind = ? AND key = ?", (table.kind, _text(key)))
                else:
                    execute(
                        "INSERT OR REPLACE INTO row VALUES (?, ?, ?, ?)",
                        (table.kind, _text(key), after.order, json.dumps(encode_row(after))),
                    )
            execute("UPDATE meta SET value = ? WHERE name = 'version'", (str(version),))
            execute("COMMIT")
        except BaseException:
            if self._database.in_transaction:
                execute("ROLLBACK")
            raise

    def close(self) -> None:
        """Closes the file."""
        if self._sync is not None:
            self._sync.close()
            self._sync = None
        self._database.close()
        self._reserve.close()
        self._lock.close()


def _ends_something(steps: Sequence[Step]) -> bool:
    """Whether a transaction closes an execution, or only takes away."""
    return not any(after for *_, after in steps) or any(
        table.kind == "execution" and after and after.data.get("ended") for table, _, _, after in steps
    )


_SEPARATOR = "\x1f"


def _text(key: Any) -> str:
    return _SEPARATOR.join(key) if isinstance(key, tuple) else str(key)


def _decoded(stored: List[Tuple[Any, Any, Any, Any]]) -> Optional[List[Any]]:
    """Sorts rows by their place and decodes them; None when each has to be looked at by itself.

    One document is decoded in half the time of its lines, and sorting here is faster than by SQLite.
    """
    try:
        stored.sort(key=itemgetter(2))
        values = json.loads(f"[{','.join([data for *_, data in stored])}]")
    except (ValueError, TypeError, RecursionError):
        return None
    return values if len(values) == len(stored) else None


class LateSync:
    """Syncs one file, in another thread, at most `SYNC_DELAY` after it was asked to.

    :param path: of a file that exists, and stays the same one until :meth:`close`.
    """

    def __init__(self, path: str) -> None:
        self._file = os.open(path, os.O_RDONLY)
        self._syncing = threading.Lock()  # held while it is synced; guards the next
        self._closed = False
        self._wanted = False
        self._calls = CallQueue(f"sync {os.path.basename(path)}")

    def soon(self) -> None:
        """The file was written; returns at once."""
        if not self._wanted:
            self._wanted = True
            call_later(SYNC_DELAY, lambda: self._calls.put(self._sync))

    def close(self) -> None:
        """Closes it; what was asked for and not done is left to the operating system."""
        with self._syncing:
            self._closed = True
            os.close(self._file)

    def _sync(self) -> None:
        self._wanted = False  # first: what is written from now on is for the next sync
        with self._syncing:
            if self._closed:
                return
            try:
                os.fdatasync(self._file)
            except OSError as error:
                _log.error("the last changes may be lost in a power cut: %s", error)


class StateLockedError(Exception):
    """Another process holds the lock; the text says which."""


class StateLock:
    """An exclusive lock beside a file; it ends with the process, whatever kills it.

    The lock has a file of its own: the file it guards may be damaged, missing, or about to be removed. It is
    never removed itself, because two processes could then hold the locks of two files of one name.

    :param path: of the file to guard.
    :raises StateLockedError: when another process holds the lock.
    :raises OSError: when the lock file cannot be written.
    """

    def __init__(self, path: str) -> None:
        self._path = f"{path}.lock"
        self._file = os.open(self._path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            holder = os.read(self._file, 20).decode("ascii", "replace").strip()
            os.close(self._file)
            if error.errno not in (errno.EWOULDBLOCK, errno.EACCES):
                raise
            raise StateLockedError(f"process {holder or 'unknown'} has it open") from error
        os.ftruncate(self._file, 0)
        os.pwrite(self._file, f"{os.getpid()}\n".encode(), 0)

    @property
    def stays(self) -> bool:
        """Whether its file still has its name: else another process may lock another one."""
        try:
            return os.path.samestat(os.fstat(self._file), os.stat(self._path))
        except OSError:
            return False

    def close(self) -> None:
        """Releases the lock. A second call does nothing."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1


class DiskReserve:
    """A file that only takes space, and gives it back when it is needed.

    :param path: of the file. A killed process leaves it, the next one continues with it.
    """

    def __init__(self, path: str) -> None:
        self._path = path
        self._file: Optional[int] = None
        self._held = False

    def hold(self) -> bool:
        """Takes the space, if that was not done; False when there is too little."""
        if self._held:
            return True
        try:
            if self._file is None:
                self._file = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
            os.posix_fallocate(self._file, 0, RESERVE_SIZE)
        except OSError as error:  # where no such file can be, nothing is refused for it
            self._free()
            return error.errno not in (errno.ENOSPC, errno.EDQUOT)
        self._held = True
        return True

    def release(self) -> bool:
        """Gives the space back; False when there was none."""
        held, self._held = self._held, False
        return held and self._free()

    def close(self) -> None:
        """Takes the file away."""
        self._held = False
        if self._file is not None:
            os.close(self._file)
            self._file = None
            with contextlib.suppress(OSError):
                os.remove(self._path)

    def _free(self) -> bool:
        if self._file is None:
            return False
        try:
            os.ftruncate(self._file, 0)
        except OSError:
            return False
        return True
