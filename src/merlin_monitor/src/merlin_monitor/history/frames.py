# SPDX-License-Identifier: Apache-2.0
"""What was shown, in the file of the history. The caller owns the connection.

A run is a row of segments. The first frame of a segment is the whole state, each further one holds what
changed; the texts of a segment are one stream of zlib, flushed after each frame, so that each frame that is
in the file can be read although no later one ever came.
"""

import json
import sqlite3
import zlib
from typing import Any, Dict, List, NamedTuple, Optional

Row = Dict[str, Any]


class Frame(NamedTuple):
    """A frame as it is stored.

    :ivar segment: number in its run, from 1.
    :ivar number: in its segment; 0: the whole state.
    :ivar wall: s since 1970.
    :ivar data: compressed text, ``[wall, at, state or changes, version of the state]``.
    """

    segment: int
    number: int
    wall: float
    data: bytes


class Recording:
    """Adds, finds and forgets frames and pictures.

    :raises sqlite3.Error: from all methods, when the file cannot be used.
    """

    def __init__(self, connection: sqlite3.Connection) -> None:
        self._connection = connection

    def add(self, run: int, frame: Frame, limit: float) -> None:
        """Adds a frame, within a transaction of the caller.

        :param limit: bytes; with a new segment, the oldest ones beyond are forgotten.
        """
        if not frame.number:
            self._prune(limit)
            self._connection.execute(
                "INSERT INTO segments VALUES (?,?,?,?,0)", (run, frame.segment, frame.wall, frame.wall)
            )
        self._connection.execute(
            "INSERT INTO frames VALUES (?,?,?,?)", (run, frame.segment, frame.number, frame.data)
        )
        self._connection.execute(
            "UPDATE segments SET ended = ?, bytes = bytes + ? WHERE run = ? AND number = ?",
            (frame.wall, len(frame.data), run, frame.segment),
        )

    def put_picture(self, name: str, version: str, wall: float, data: bytes) -> None:
        """Keeps a picture, within a transaction of the caller."""
        row = name, version, wall, data
        self._connection.execute("INSERT OR REPLACE INTO pictures VALUES (?,?,?,?)", row)

    def picture(self, name: str, version: str) -> Optional[bytes]:
        """A recorded picture in that version; None: there is none."""
        row = self._one("SELECT data FROM pictures WHERE name = ? AND version = ?", name, version)
        return row[0] if row else None

    def runs(self) -> List[Row]:
        """The runs of which something was kept, oldest first: their first and last time, and size."""
        rows = self._connection.execute(
            "SELECT run, MIN(began), MAX(ended), SUM(bytes) FROM segments GROUP BY run ORDER BY run"
        )
        return [
            {"run": run, "began": began, "ended": ended, "bytes": size} for run, began, ended, size in rows
        ]

    def segment(self, run: int, wall: float) -> Optional[str]:
        """The segment of a moment as JSON, the first one of the run for a moment before it.

        ``frames`` is a list of ``[wall, at, state, version]`` and then ``[wall, at, changes, version]``;
        ``next`` says when the next segment begins, null: this is the last one; ``damaged`` whether what
        follows the last of these frames cannot be read.

        :raises ValueError: nothing of it can be read.
        """
        ask = "SELECT number, began FROM segments WHERE run = ? "
        row = self._one(f"{ask} AND began <= ? ORDER BY number DESC LIMIT 1", run, wall)
        row = row or self._one(f"{ask} ORDER BY number LIMIT 1", run)
        if row is None:
            return None
        number, began = row
        following = self._one(f"{ask} AND number > ? ORDER BY number LIMIT 1", run, number)
        blobs = self._connection.execute(
            "SELECT number, data FROM frames WHERE run = ? AND segment = ? ORDER BY number", (run, number)
        )
        frames: List[str] = []
        unpack = zlib.decompressobj()
        damaged = False
        for place, blob in blobs:
            if place != len(frames):
                break  # the disk was full for a moment
            try:
                text = unpack.decompress(blob).decode()
                if not text.endswith("]"):
                    raise ValueError("a frame ends early")
            except (zlib.error, ValueError) as error:
                if not frames:
                    raise ValueError(f"segment {number} of run {run} is damaged: {error}") from error
                damaged = True  # each frame builds on those before it
                break
            frames.append(text)
        after = json.dumps(following and following[1])
        return (
            f'{{"run":{run},"number":{number},"began":{json.dumps(began)},"next":{after},'
            f'"damaged":{json.dumps(damaged)},'
            f'"frames":[{",".join(frames)}]}}'
        )

    def _prune(self, limit: float) -> None:
        ask = self._connection.execute
        (size,) = self._one("SELECT (SELECT TOTAL(bytes) FROM segments) + TOTAL(LENGTH(data)) FROM pictures")
        while size > limit:
            oldest = self._one("SELECT run, number, bytes FROM segments ORDER BY run, number LIMIT 1")
            if oldest is None:
                return
            run, number, held = oldest
            ask("DELETE FROM frames WHERE run = ? AND segment = ?", (run, number))
            ask("DELETE FROM segments WHERE run = ? AND number = ?", (run, number))
            size -= held + self._prune_pictures()

    def _prune_pictures(self) -> int:
        """Forgets the pictures that were replaced by others before the first frame that is kept."""
        outdated = (
            "FROM pictures WHERE wall < (SELECT MAX(wall) FROM pictures AS newer WHERE"
            " newer.name = pictures.name AND newer.wall <="
            " (SELECT began FROM segments ORDER BY run, number LIMIT 1))"
        )
        held: int = self._one(f"SELECT TOTAL(LENGTH(data)) {outdated}")[0]
        self._connection.execute(f"DELETE {outdated}")
        return held

    def _one(self, question: str, *values: Any) -> Any:
        return self._connection.execute(question, values).fetchone()
