# SPDX-License-Identifier: Apache-2.0
"""The outbox in a file: what was reported to it survives a power cut."""

import os
import sqlite3
from pathlib import Path
from typing import Any, Dict, Tuple

from merlin_fleet.core import records
from merlin_fleet.core.records import RecordError, Report
from merlin_fleet.core.reporting import Kept, Outbox

#: The file's own version.
VERSION = 1


class OutboxError(Exception):
    """The file is not an outbox that this version can use."""


class SqliteOutbox(Outbox):
    """Keeps reports in a file; a report that was added is on the disk. For one thread at a time.

    A full disk costs the safety of new reports, not the reports: they stay in memory, and `add` says so.

    :param path: is made when it does not exist; its folder, too. It may begin with `~`.
    :raises OutboxError: for a file that is not an outbox of this version, or cannot be opened.
    """

    def __init__(self, path: str) -> None:
        super().__init__()
        self._path = path = os.path.expanduser(path)
        self._only_in_memory: Dict[Tuple[str, int], Kept] = {}
        try:
            Path(path).parent.mkdir(parents=True, exist_ok=True)
            self._file = sqlite3.connect(path, isolation_level=None, check_same_thread=False)
            # With FULL the removal of the journal may not be on the disk yet: a power cut would bring the
            # journal back, and the next process would undo with it what was reported.
            self._file.execute("PRAGMA synchronous = EXTRA")
            self._open()
        except (OSError, sqlite3.Error) as error:
            raise OutboxError(f"{path} cannot be used as the fleet's outbox: {error}") from None

    def _open(self) -> None:
        (version,) = self._file.execute("PRAGMA user_version").fetchone()
        if version not in (0, VERSION):
            raise OutboxError(
                f"{self._path} is of version {version}, this is version {VERSION}; it is left as it is"
            )
        if version == 0:  # one that exists is only read: the disk may be full
            self._make()
        rows = self._file.execute("SELECT final, report FROM reports ORDER BY rowid").fetchall()
        for final, text in rows:
            try:
                super().add(records.decode(Report, text), bool(final))
            except RecordError as error:
                raise OutboxError(f"{self._path} holds a report that cannot be read: {error}") from None

    def _make(self) -> None:
        self._file.execute("BEGIN IMMEDIATE")
        self._file.execute(
            "CREATE TABLE IF NOT EXISTS reports "
            "(goal TEXT, epoch INTEGER, final INTEGER, report TEXT, PRIMARY KEY (goal, epoch))"
        )
        self._file.execute("CREATE TABLE IF NOT EXISTS notes (name TEXT PRIMARY KEY, value TEXT)")
        self._file.execute(f"PRAGMA user_version = {VERSION}")
        self._file.execute("COMMIT")

    @property
    def fleet_id(self) -> str:
        """The fleet of which the robot is; empty: of none yet."""
        row = self._file.execute("SELECT value FROM notes WHERE name = 'fleet'").fetchone()
        return str(row[0]) if row else ""

    def note_fleet(self, fleet_id: str) -> str:
        """Notes of which fleet the robot is; returns why that failed, empty: it did not."""
        return self._write("INSERT OR REPLACE INTO notes VALUES ('fleet', ?)", (fleet_id,))

    def add(self, report: Report, final: bool) -> str:
        """Keeps a report; returns why it will not survive the process, empty: it will."""
        super().add(report, final)
        key = (report.goal, report.epoch)
        problem = self._insert((report, final))
        if problem:
            self._only_in_memory[key] = (report, final)
            return problem
        for waiting, kept in list(self._only_in_memory.items()):  # there is space again
            if not self._insert(kept):
                del self._only_in_memory[waiting]
        return ""

    def remove(self, goal: str, epoch: int) -> None:
        """The store has the report. When that cannot be written, the next process reports it again."""
        super().remove(goal, epoch)
        self._only_in_memory.pop((goal, epoch), None)
        self._write("DELETE FROM reports WHERE goal = ? AND epoch = ?", (goal, epoch))

    def close(self) -> None:
        """Closes the file."""
        self._file.close()

    def _insert(self, kept: Kept) -> str:
        report, final = kept
        row = (report.goal, report.epoch, int(final), records.encode(report))
        return self._write("INSERT OR REPLACE INTO reports VALUES (?, ?, ?, ?)", row)

    def _write(self, statement: str, values: Tuple[Any, ...]) -> str:
        try:
            self._file.execute(statement, values)
        except sqlite3.Error as error:
            return f"{self._path}: {error}"
        return ""
