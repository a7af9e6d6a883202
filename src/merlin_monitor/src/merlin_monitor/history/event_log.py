# SPDX-License-Identifier: Apache-2.0
"""The events in the file of the history. The caller owns the connection."""

import json
import sqlite3
from typing import Any, Dict, Iterator, List, NamedTuple, Optional, Sequence, Tuple

from merlin_monitor.history.history_file import OF_MONITOR
from merlin_monitor.text.plain_value import plain, plain_text

Row = Dict[str, Any]
LONGEST_TEXT = 1000  # characters of an event
MARKS = ("failure", "cancel", "replan")
MOST_MARKS = 1000  # most marks that are shown of one run
_OLD_COLUMNS = "id, run, wall, at, kind, text, detail"  # of all versions of the file
_COLUMNS = f"{_OLD_COLUMNS}, mark"


class Neighbour(NamedTuple):
    """Which event is asked for: the next one from here.

    :ivar run: number.
    :ivar wall: s since 1970.
    :ivar identity: of the event from which it continues; 0: none, only the time counts.
    :ivar forward: the next one, else the last one before.
    :ivar kinds: none: all.
    :ivar marks: none: all.
    """

    run: int
    wall: float
    identity: int = 0
    forward: bool = True
    kinds: Tuple[str, ...] = ()
    marks: Tuple[str, ...] = ()


class EventLog:
    """Adds, finds and forgets events.

    :param monitor: whose pages, limit and export these are, as several may share a file; empty: all.
    """

    def __init__(self, connection: sqlite3.Connection, monitor: str = "") -> None:
        self._connection = connection
        self._own = (OF_MONITOR, [monitor] if monitor else [])

    def add(self, run: int, wall: float, event: Any) -> Row:
        """Adds an event, within a transaction of the caller; returns it as it was stored."""
        row = row_of(run, wall, event)
        cursor = self._connection.execute(
            "INSERT INTO events (run, wall, at, kind, text, detail, mark) VALUES (?,?,?,?,?,?,?)",
            tuple(json.dumps(value) if name == "detail" else value for name, value in row.items()),
        )
        return {"id": cursor.lastrowid, **row}

    def prune(self, limit: int) -> None:
        """Forgets the oldest beyond a number."""
        where, values = _where(self._own)
        oldest = f"SELECT id FROM events {where} ORDER BY id DESC LIMIT -1 OFFSET ?"
        self._connection.execute(f"DELETE FROM events WHERE id IN ({oldest})", (*values, limit))

    def page(self, before: Optional[int], limit: int, kinds: Sequence[str]) -> List[Row]:
        """The newest events before an id, oldest first."""
        before_it = ("id < {}", [] if before is None else [before])
        where, values = _where(self._own, before_it, ("kind IN ({})", kinds))
        limit = max(1, min(1000, limit))
        return list(self._select(f"{where} ORDER BY id DESC LIMIT ?", (*values, limit)))[::-1]

    def all(self) -> List[Row]:
        """All events, oldest first."""
        where, values = _where(self._own)
        return list(self._select(f"{where} ORDER BY id", values))

    def runs(self) -> List[Row]:
        """All runs that have events, oldest first.

        Number, begin (s since 1970), how many events, and the session: empty, also in older files.
        """
        columns = [column[1] for column in self._connection.execute("PRAGMA table_info(runs)")]
        session = "runs.session" if "session" in columns else "''"
        rows = self._connection.execute(
            f"SELECT runs.id AS run, runs.began AS began, COUNT(*) AS events, {session} AS session"
            " FROM runs JOIN events ON run = runs.id GROUP BY runs.id"
        )
        return [dict(zip(("run", "began", "events", "session"), row)) for row in rows]

    def find(self, runs: Sequence[int], kinds: Sequence[str], since: float) -> List[Row]:
        """Events, oldest first, without their marks, which older files do not have.

        :param runs: numbers; none: all.
        :param kinds: none: all.
        :param since: s since 1970.
        """
        where, values = _where(("wall >= {}", [since]), ("run IN ({})", runs), ("kind IN ({})", kinds))
        return list(self._select(f"{where} ORDER BY id", values, _OLD_COLUMNS))

    def neighbour(self, wanted: Neighbour) -> Optional[Row]:
        """The next or last event."""
        sign, order = (">", "ASC") if wanted.forward else ("<", "DESC")
        by, place = ("id", wanted.identity) if wanted.identity else ("wall", wanted.wall)
        where, values = _where(
            ("run = {}", [wanted.run]),
            (f"{by} {sign} {{}}", [place]),
            ("kind IN ({})", wanted.kinds),
            ("mark != '' AND mark IN ({})", wanted.marks),  # the first part is for the index
        )
        return next(self._select(f"{where} ORDER BY {by} {order}, id {order} LIMIT 1", values), None)

    def marks(self, run: int) -> List[List[Any]]:
        """The marked events of a run, the newest ones when there are many: id, s since 1970, mark."""
        rows = self._connection.execute(
            "SELECT id, wall, mark FROM events WHERE run = ? AND mark != '' ORDER BY wall DESC LIMIT ?",
            (run, MOST_MARKS),
        )
        return [list(row) for row in rows][::-1]

    def _select(self, rest: str, values: Sequence[Any], columns: str = _COLUMNS) -> Iterator[Row]:
        for row in self._connection.execute(f"SELECT {columns} FROM events {rest}", values):
            event = dict(zip(columns.split(", "), row))
            event["detail"] = json.loads(event["detail"])
            yield event


def row_of(run: int, wall: float, event: Any) -> Row:
    """An event as it is stored, without its id."""
    return {
        "run": run,
        "wall": wall,
        "at": plain(float(event.at)) or 0.0,
        "kind": event.kind,
        "text": plain_text(event.text, LONGEST_TEXT),
        "detail": plain(event.detail),
        "mark": event.mark,
    }


def _where(*parts: Tuple[str, Sequence[Any]]) -> Tuple[str, List[Any]]:
    """Conditions in SQL, and the values in them.

    :param parts: conditions with ``{}`` for their values; one without values is left out.
    """
    used = [(text.format(",".join("?" * len(values))), values) for text, values in parts if values]
    where = f"WHERE {' AND '.join(text for text, _ in used)}" if used else ""
    return where, [value for _, values in used for value in values]
