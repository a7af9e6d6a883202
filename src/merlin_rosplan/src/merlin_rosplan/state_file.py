"""Keeps a knowledge base in an SQLite file, so that a killed process finds everything again.

Write-ahead logging with ``synchronous=NORMAL``: what was committed survives the process, whatever kills it;
a power failure may take the last moments, never the file's consistency.
"""

import json
import os
import sqlite3
from typing import Any, List, Sequence, Tuple

from merlin_rosplan.domain import Domain
from merlin_rosplan.knowledge import Row
from merlin_rosplan.knowledge_store import Journal
from merlin_rosplan.state_codec import decode_row, encode_row
from merlin_rosplan.transaction import Step

FORMAT = "1"
_TABLES = """
CREATE TABLE IF NOT EXISTS meta (name TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS row (kind TEXT, key TEXT, place INTEGER NOT NULL, data TEXT NOT NULL,
    PRIMARY KEY (kind, key)) WITHOUT ROWID;
"""


class StateFileError(Exception):
    """The state file cannot be used; the text says why and what to do."""


class StateFile(Journal):
    """A state file, opened for this process alone. The store's lock guards it.

    Parameters
    ----------
    path: of the file; it is made when it does not exist.
    domain: whose knowledge it holds.
    reset: forget what the file holds.

    Raises
    ------
    StateFileError: it is damaged, in use, not writable, or holds the knowledge of another domain.
    """

    def __init__(self, path: str, domain: Domain, reset: bool = False) -> None:
        self._path = os.path.abspath(os.path.expanduser(path))
        self._domain = domain
        try:
            os.makedirs(os.path.dirname(self._path), exist_ok=True)
            if reset:
                self._remove()
            self._database = sqlite3.connect(
                self._path, timeout=1.0, isolation_level=None, check_same_thread=False
            )
            try:
                self._open()
            except BaseException:
                self._database.close()
                raise
        except (sqlite3.Error, OSError) as error:
            hint = "; is another knowledge base using it?" if "locked" in str(error) else ""
            raise StateFileError(f"the state file {self._path} cannot be used: {error}{hint}") from error

    def _remove(self) -> None:
        for suffix in ("", "-wal", "-shm", "-journal"):
            if os.path.exists(self._path + suffix):
                os.remove(self._path + suffix)

    def _open(self) -> None:
        execute = self._database.execute
        execute("PRAGMA locking_mode = EXCLUSIVE")
        execute("PRAGMA journal_mode = WAL")
        execute("PRAGMA synchronous = NORMAL")
        self._database.executescript(_TABLES)
        known = dict(execute("SELECT name, value FROM meta"))
        ours = {"format": FORMAT, "domain": self._domain.name, "digest": self._domain.digest}
        if not known:
            execute("BEGIN IMMEDIATE")
            self._database.executemany("INSERT INTO meta VALUES (?, ?)", [*ours.items(), ("version", "0")])
            execute("COMMIT")
            return
        for name, value in ours.items():
            if known.get(name) != value:
                raise StateFileError(
                    f"the state file {self._path} holds knowledge of another domain or of another version "
                    f"of it ({name} '{known.get(name)}', not '{value}'): "
                    "move it away, or start once with reset_state"
                )

    def load(self) -> Tuple[int, List[Tuple[str, Row]]]:
        """Version and rows of the last commit. Version 0: nothing was ever stored.

        Raises
        ------
        StateFileError: a row cannot be read.
        """
        try:
            (version,) = self._database.execute("SELECT value FROM meta WHERE name = 'version'").fetchone()
            found: List[Tuple[str, Row]] = []
            for kind, place, data in self._database.execute(
                "SELECT kind, place, data FROM row ORDER BY place"
            ):
                row = decode_row(kind, json.loads(data))
                row.order = place
                found.append((kind, row))
            return int(version), found
        except (sqlite3.Error, ValueError, KeyError, TypeError, AssertionError) as error:
            raise StateFileError(
                f"the state file {self._path} is damaged ({error}): "
                "move it away, or start once with reset_state"
            ) from error

    def commit(self, steps: Sequence[Step], version: int) -> None:
        """Writes a transaction.

        Raises
        ------
        OSError: it could not be written; the file holds what it held before.
        """
        execute = self._database.execute
        try:
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
        except sqlite3.Error as error:
            raise OSError(f"{self._path}: {error}") from error

    def close(self) -> None:
        """Closes the file."""
        self._database.close()


def _text(key: Any) -> str:
    return "\x1f".join(key) if isinstance(key, tuple) else str(key)
