# SPDX-License-Identifier: Apache-2.0
"""What was shown, in the file of the history. The caller owns the connection.

A run is a row of segments. The first frame of a segment is the whole state, each further one holds what
changed; the texts of a segment are one stream of zlib, flushed after each frame, so that each frame that is
in the file can be read although no later one ever came. After each flush comes the CRC-32 of the frame's
text, which older files do not have: the stream has no checksum before its end, which never comes.
"""

import contextlib
import json
import sqlite3
import zlib
from typing import Any, Dict, List, NamedTuple, Optional

from merlin_monitor.history.history_file import MONITOR, OF_MONITOR

Row = Dict[str, Any]
_FLUSHED = b"\x00\x00\xff\xff"  # ends each flush of zlib
_CHECK = 4  # bytes of the CRC-32


class Frame(NamedTuple):
    """A frame as it is stored.

    :ivar segment: number in its run, from 1.
    :ivar number: in its segment; 0: the whole state.
    :ivar wall: s since 1970.
    :ivar data: compressed text, ``[wall, at, state or changes, version of the state]``.
    :ivar check: CRC-32 of the text; None: none is kept.
    """

    segment: int
    number: int
    wall: float
    data: bytes
    check: Optional[int] = None


def _unpacked(unpack: Any, data: bytes) -> str:
    """The text of the next frame.

    :param unpack: of zlib, for the segment.
    :raises zlib.error, ValueError: it is damaged.
    """
    checked = data[-_CHECK - len(_FLUSHED) : -_CHECK] == _FLUSHED
    text: bytes = unpack.decompress(data[:-_CHECK] if checked else data)
    if not checked:
        json.loads(text)
    elif zlib.crc32(text) != int.from_bytes(data[-_CHECK:], "big"):
        raise ValueError("its checksum is wrong")
    return text.decode()


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
            self._prune(limit, frame.wall)
            self._connection.execute(
                "INSERT INTO segments VALUES (?,?,?,?,0)", (run, frame.segment, frame.wall, frame.wall)
            )
        data = frame.data if frame.check is None else frame.data + frame.check.to_bytes(_CHECK, "big")
        self._connection.execute(
            "INSERT INTO frames VALUES (?,?,?,?)", (run, frame.segment, frame.number, data)
        )
        self._connection.execute(
            "UPDATE segments SET ended = ?, bytes = bytes + ? WHERE run = ? AND number = ?",
            (frame.wall, len(data), run, frame.segment),
        )

    def put_picture(self, name: str, version: str, wall: float, data: bytes) -> None:
        """Keeps a picture, within a transaction of the caller."""
        row = name, version, wall, data
        self._connection.execute("INSERT OR REPLACE INTO pictures VALUES (?,?,?,?)", row)

    def picture(self, name: str, version: str) -> Optional[bytes]:
        """A recorded picture in that version; None: there is none."""
        row = self._one("SELECT data FROM pictures WHERE name = ? AND version = ?", name, version)
        return row[0] if row else None

    def runs(self, monitor: str = "") -> List[Row]:
        """The runs of which something was kept, oldest first: their first and last time, and size.

        :param monitor: whose; empty: all.
        """
        where = f"WHERE {OF_MONITOR.format('?')}" if monitor else ""
        rows = self._connection.execute(
            f"SELECT run, MIN(began), MAX(ended), SUM(bytes) FROM segments {where} GROUP BY run ORDER BY run",
            (monitor,) if monitor else (),
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
                frames.append(_unpacked(unpack, blob))
            except (zlib.error, ValueError) as error:
                if not frames:
                    raise ValueError(f"segment {number} of run {run} is damaged: {error}") from error
                damaged = True  # each frame builds on those before it
                break
        after = json.dumps(following and following[1])
        return (
            f'{{"run":{run},"number":{number},"began":{json.dumps(began)},"next":{after},'
            f'"damaged":{json.dumps(damaged)},'
            f'"frames":[{",".join(frames)}]}}'
        )

    def readable(self, run: int, oldest: bool = False, since: float = 0.0) -> Optional[str]:
        """The newest segment of a run of which something can be read, as :meth:`segment` has it.

        :param oldest: the oldest one instead.
        :param since: of those that began then or later, s since 1970.
        """
        order = "ASC" if oldest else "DESC"
        ask = f"SELECT began FROM segments WHERE run = ? AND began >= ? ORDER BY number {order}"
        for (began,) in self._connection.execute(ask, (run, since)).fetchall():
            with contextlib.suppress(ValueError, sqlite3.DatabaseError):
                return self.segment(run, began)
        return None

    def _prune(self, limit: float, wall: float) -> None:
        (size,) = self._one("SELECT (SELECT TOTAL(bytes) FROM segments) + TOTAL(LENGTH(data)) FROM pictures")
        while size > limit:
            freed = self._prune_pictures(wall) or self._prune_segment()
            if not freed:
                return
            size -= freed

    def _prune_segment(self) -> int:
        """Forgets the oldest segment of the monitor that has most; returns its bytes, 0: there is none."""
        held = f"SELECT run, number, bytes, {MONITOR} AS monitor FROM segments LEFT JOIN runs ON run = id"
        most = "SELECT monitor FROM held GROUP BY monitor ORDER BY SUM(bytes) DESC LIMIT 1"
        oldest = self._one(
            f"WITH held AS ({held}) SELECT run, number, bytes FROM held WHERE monitor IS ({most})"
            " ORDER BY run, number LIMIT 1"
        )
        if oldest is None:
            return 0
        run, number, size = oldest
        ask = self._connection.execute
        ask("DELETE FROM frames WHERE run = ? AND segment = ?", (run, number))
        ask("DELETE FROM segments WHERE run = ? AND number = ?", (run, number))
        return int(size)

    def _prune_pictures(self, wall: float) -> int:
        """Forgets the pictures that no kept frame can name; returns their bytes.

        These are of another time than the frames, and the same name has a newer one that is so, too. Newer
        is what was put later: the computer's clock may go back from one run to the next.

        :param wall: of the frame that comes next.
        """
        times = self._one(
            "SELECT MIN(?1, IFNULL(MIN(began), ?1)), MAX(?1, IFNULL(MAX(ended), ?1)) FROM segments", wall
        )
        outdated = (
            "FROM pictures WHERE wall NOT BETWEEN ? AND ? AND rowid < (SELECT MAX(rowid) FROM pictures AS"
            " newer WHERE newer.name = pictures.name AND newer.wall NOT BETWEEN ? AND ?)"
        )
        held = int(self._one(f"SELECT TOTAL(LENGTH(data)) {outdated}", *times, *times)[0])
        self._connection.execute(f"DELETE {outdated}", (*times, *times))
        return held

    def _one(self, question: str, *values: Any) -> Any:
        return self._connection.execute(question, values).fetchone()
