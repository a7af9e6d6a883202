# SPDX-License-Identifier: Apache-2.0
"""The events in the file of the history. The caller owns the connection."""

import json
import sqlite3
from typing import Any, Dict, Iterator, List, NamedTuple, Optional, Sequence, Tuple

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
    """Adds, finds and forgets events."""

    def __init__(self, connection: sqlite3.Connection) -> None:
        self._connection = connection

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
        self._connection.execute("DELETE FROM events WHERE id <= (SELECT MAX(id) FROM events) - ?", (limit,))

    def page(self, before: Optional[int], limit: int, kinds: Sequence[str]) -> List[Row]:
        """The newest events before an id, oldest first."""
        where, values = _where(("id < {}", [] if before is None else [before]), ("kind IN ({})", kinds))
        limit = max(1, min(1000, limit))
        return list(self._select(f"{where} ORDER BY id DESC LIMIT ?", (*values, limit)))[::-1]

    def all(self) -> List[Row]:
        """All events, oldest first."""
        return list(self._select("ORDER BY id", ()))

    def runs(self) -> List[Row]:
        """The runs that have events, oldest first: number, begin (s since 1970) and how many events."""
        rows = self._connection.execute(
            "SELECT runs.id, runs.began, COUNT(*) FROM runs JOIN events ON run = runs.id GROUP BY runs.id"
        )
        return [{"run": run, "began": began, "events": count} for run, began, count in rows]

    def find(self, run: Optional[int], kinds: Sequence[str], since: float) -> List[Row]:
        """Events, oldest first, without their marks, which older files do not have.

        :param run: number; None: of all runs.
        :param kinds: none: all.
        :param since: s since 1970.
        """
        where, values = _where(
            ("wall >= {}", [since]), ("run = {}", [] if run is None else [run]), ("kind IN ({})", kinds)
        )
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
