# SPDX-License-Identifier: Apache-2.0
"""The history of the present run: its events and what the page showed, in a file that outlives the node."""

import concurrent.futures
import contextlib
import json
import logging
import os
import queue
import sqlite3
import time
import zlib
from pathlib import Path
from typing import Any, Callable, Dict, List, Optional, Tuple

from merlin_monitor.history.event_log import EventLog, Row, row_of
from merlin_monitor.history.frames import Frame
from merlin_monitor.history.history_file import (
    SIDE_FILES,
    HistoryError,
    LastRun,
    WallClock,
    begin_run,
    last_run,
    open_for_writing,
)
from merlin_monitor.history.history_reader import HistoryReader
from merlin_monitor.state.history_events import Event, sentence
from merlin_monitor.state.state_tree import StateTree, apply_changes
from merlin_monitor.text.phrase import Phrase, in_english, say
from merlin_ros.alarms import call_later

__all__ = ["HistoryError", "HistoryStore"]

PRUNE_EVERY = 1000  # events between two looks at the limit
MEGABYTE = 1_000_000
SECTION = "history"
NEWEST = 200  # events in the state; older ones are asked for page by page
SET_BACK = 1.0  # s by which ROS time goes back when a simulator is begun anew; a clock is set by less
GATHER = 0.2  # s that changes are gathered for one frame
LONGEST_SEGMENT = 300.0  # s
LARGEST_SEGMENT = 256 * 1024  # characters of changes, or as many as the whole state has
LEFT_OUT = (SECTION,)  # sections that are in no frame: the events have a table of their own
END_OF_TIME = 1e12  # s since 1970
AGAIN = 10.0  # s between two tries to make a file that is missing
DAMAGED = ("malformed", "Could not decode")  # what SQLite says of a file that is
_COPIED = (
    ("events", "wall, at, kind, text, detail, mark"),
    ("segments", "number, began, ended, bytes"),
    ("frames", "segment, number, data"),
)

_log = logging.getLogger("rosout")


class Frames:
    """What was shown, in frames: the changes since the one before, in segments that begin with all of it.

    :param tree: the state.
    :param clock: s since 1970, never going back.
    :param wake: called when something has changed since the last frame; must not block.
    :param segment: the last one of the run; 0: it begins.
    """

    def __init__(
        self, tree: StateTree, clock: Callable[[], float], wake: Callable[[], object], segment: int = 0
    ) -> None:
        self._tree, self._clock = tree, clock
        self._feed = tree.subscribe(wake)
        self.close = self._feed.close
        self._segment, self._number = segment, 0
        self._room = -1  # characters that the segment may still take
        self._until = 0.0  # s of the clock at which the segment ends
        self._at = 0.0  # ROS time of the last frame, s
        self._pack: Any = None

    def begin_segment(self) -> None:
        """Has the next frame begin a segment: one was lost, and each builds on those before it."""
        self._room = -1

    def next(self, marked: bool) -> Optional[Frame]:
        """The frame for the changes until now; None: there are none.

        :param marked: whether there is one all the same.
        """
        # Before the changes are taken: a frame of a time has all that was changed by then.
        wall = self._clock()
        version, changes = self._feed.take()
        kept = [change for change in changes.as_list() if change[0][0] not in LEFT_OUT]
        if not (kept or changes.whole or marked or self._pack is None):
            return None
        text = _compact(kept)
        at = self._tree.get("meta", "time") or 0.0
        back = 0.0 < at < self._at - SET_BACK
        self._at = at or self._at
        if back:  # who searches for a ROS time begins here
            self._tree.set("meta", "set_back", wall)
        if changes.whole or back or len(text) > self._room or wall > self._until:
            self._segment, self._number = self._segment + 1, -1
            self._until = wall + LONGEST_SEGMENT
            self._pack = zlib.compressobj(6)
            # What changed since the feed was read is in here, and comes again: that changes nothing.
            version, text = self._tree.as_json(LEFT_OUT)
            self._room = max(LARGEST_SEGMENT, len(text))
        else:
            self._room -= len(text)
        whole = f"[{wall},{_compact(at)},{text},{version}]".encode()
        data = self._pack.compress(whole) + self._pack.flush(zlib.Z_SYNC_FLUSH)
        self._number += 1
        return Frame(self._segment, self._number, wall, data, zlib.crc32(whole))


def _compact(value: Any) -> str:
    return json.dumps(value, separators=(",", ":"))


def last_state(segment: Optional[str]) -> Dict[str, Any]:
    """The state to which a segment leads.

    :param segment: of :meth:`merlin_monitor.history.frames.Recording.segment`.
    :raises ValueError, LookupError, TypeError: it cannot be read.
    """
    (_, _, state, _), *later = json.loads(segment or "")["frames"]
    own: Dict[int, Any] = {}
    for _, _, changes, _ in later:
        apply_changes(state, changes, own)
    return dict(state)


class HistoryStore(HistoryReader):
    """Keeps events, and what is shown.

    :param path: of the file.
    :param limit: most events that are kept; the oldest go first.
    :param make_folder: whether the file's folder is made. Otherwise all is kept in memory until it
        exists, so that a run which never began leaves nothing behind.
    :param megabytes: most that is kept of what was shown; the oldest goes first.
    :param clock: s since 1970, the time of all that is kept; None: now.
    :param session: of the master, a blank, and this monitor's name. With that of an earlier life, its run is
        gone on with; of other monitors that share the file nothing is shown. Empty: a run begins.
    :raises HistoryError: the file is that of another program, or of a newer MERLIN. One that is damaged is
        set aside; in place of one that cannot be written, all is kept in memory until it can.
    """

    def __init__(
        self,
        path: Path,
        limit: int,
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
        self.on_events: Callable[[List[Row]], None] = lambda events: None
        """Called with the events as they were stored, in the store's thread."""
        self._lost = 0
        self._newest: Dict[str, Tuple[str, bytes]] = {}  # name of a picture → its version and data
        self._again_at = 0.0  # monotonic, s
        self._written = PRUNE_EVERY  # many short runs are looked at too
        self._frames: Optional[Frames] = None
        self._live = False  # whether frames are made by themselves
        self._due = False  # whether one is to come; these two are set before what is to be in it
        self._marked = False  # whether it comes also when nothing changes
        self.problems: Dict[str, Phrase] = {}
        """What is wrong with the file now, ``unwritten``, or was at the begin, ``damaged``."""
        self._make_folder = make_folder
        self._in_memory = False
        self.last: Optional[LastRun] = None
        """The run that is gone on with; None: a new one."""
        self.run = 0
        try:
            connection = self._open()
        except (OSError, sqlite3.Error, HistoryError) as error:
            raise HistoryError(
                f"the history file {path} cannot be used: {error}; name another one, history:=…"
            ) from error
        super().__init__(connection, session.partition(" ")[2])

    def _open(self) -> sqlite3.Connection:
        try:
            if self._make_folder:
                self.path.parent.mkdir(parents=True, exist_ok=True)
            if self.path.parent.is_dir():
                try:
                    return self._begin(str(self.path))
                except (sqlite3.DatabaseError, ValueError) as error:
                    if isinstance(error, sqlite3.Error) and not any(said in str(error) for said in DAMAGED):
                        raise
                    self._set_aside()
                    return self._begin(str(self.path))
        except (FileExistsError, NotADirectoryError):
            raise
        except (OSError, sqlite3.OperationalError) as error:
            self._fail(error)
            _log.error(
                "the history %s cannot be written: %s; it is kept in memory until it can", self.path, error
            )
        self._in_memory = True
        return self._begin(":memory:")

    def _begin(self, name: str) -> sqlite3.Connection:
        connection = open_for_writing(name)
        try:
            EventLog(connection).page(None, NEWEST, ())  # the page begins with them
            self.last = last_run(connection, self._began, self._session)
            self.run = self.last.run if self.last else begin_run(connection, self._began, self._session)
        except BaseException:
            connection.close()
            raise
        return connection

    def _set_aside(self) -> None:
        kept = f"{self.path}.damaged-{time.strftime('%Y-%m-%d-%H-%M-%S', time.localtime(self._began))}"
        for ending in SIDE_FILES:
            with contextlib.suppress(FileNotFoundError):
                os.replace(f"{self.path}{ending}", f"{kept}{ending}")
        self.problems["damaged"] = say("the history was damaged; it is kept as {file}", file=kept)
        _log.error(in_english(self.problems["damaged"]))

    def last_state(self, limit: float) -> Dict[str, Any]:
        """What the earlier life showed last; empty: there is none, or it cannot be read.

        :param limit: s for the answer.
        """
        if self.last is None:
            return {}
        try:
            return last_state(self.segment(self.run, END_OF_TIME).result(limit))
        except (HistoryError, ValueError, LookupError, TypeError, concurrent.futures.TimeoutError):
            return {}

    def follow(self, tree: StateTree, live: bool = True) -> None:
        """Keeps what is shown from now on, in a frame every `GATHER` seconds in which something changes.

        :param live: False: the caller makes the frames, by :meth:`take`.
        """
        self._live = live
        self._frames = Frames(tree, lambda: self.now(), self._wake, self.last.segment if self.last else 0)
        self._wake()

    def take(self) -> None:
        """Keeps what is shown now, if something has changed or was added; may wait for the disk."""
        frame = self._next_frame()
        if frame is not None:
            self._jobs.put((None, frame))

    def add(self, event: Event) -> None:
        """Takes an event; returns at once."""
        self._put(self.now(), event)
        # What an event is about may be in a frame from before it, and the next one be about something else.
        self._marked = True
        self._wake()

    def add_picture(self, name: str, version: str, data: bytes) -> None:
        """Takes a picture; the next frame may name it."""
        self._newest[name] = version, data
        self._put((name, version), data)

    def _put(self, key: Any, job: Any) -> None:
        try:
            self._jobs.put_nowait((key, job))
        except queue.Full:
            self._lost += 1

    def _next_frame(self) -> Optional[Frame]:
        self._due = False
        marked = self._marked
        if marked:
            self._marked = False
        return self._frames.next(marked) if self._frames is not None else None

    def _wake(self) -> None:
        if self._live and not self._due:
            self._due = True
            call_later(GATHER, self._take_or_again)

    def _take_or_again(self) -> None:
        asked = self._ask(self._make_frame)
        if asked.done() and asked.exception() and self._thread.is_alive():  # too much waits for the disk
            call_later(GATHER, self._take_or_again)

    # --- in the thread of the history -----------------------------------------------------------------------

    def _make_frame(self) -> None:
        frame = self._next_frame()
        if frame is not None:
            self._write([(None, frame)])

    def _write(self, jobs: List[Any]) -> None:
        lost, self._lost = self._lost, 0
        if lost:
            self._begin_anew()
            said = say("{count} events came too fast to be kept", count=str(lost))
            jobs = [*jobs, (self.now(), sentence("monitor", said, 0.0))]
        try:
            if jobs:
                self._leave_memory()
                self.on_events(self._store(jobs))
                self._make_again()
                if not self._in_memory:
                    self.problems.pop("unwritten", None)
        except Exception as error:  # a full disk, or a strange event, must not end the monitor
            self._begin_anew()
            self._fail(error)

    def _fail(self, error: Exception) -> None:
        self.trouble = str(error)
        said = self.problems["unwritten"] = say("the history could not be written: {why}", why=str(error))
        self.on_events([{"id": 0, **row_of(0, self.now(), sentence("monitor", said, 0.0))}])

    def _begin_anew(self) -> None:
        """Something is lost: the next frame is whole, and comes with the newest pictures."""
        if self._frames is not None:
            self._frames.begin_segment()

    def _store(self, jobs: List[Any]) -> List[Row]:
        stored: List[Row] = []
        with self._connection:
            for key, job in jobs:
                if isinstance(job, Frame):
                    self._recording.add(self.run, job, self._bytes)
                    # It names them: kept with its time, they are not older than what is kept of this run.
                    for name, picture in () if job.number else list(self._newest.items()):
                        self._recording.put_picture(name, picture[0], job.wall, picture[1])
                elif isinstance(job, bytes):
                    self._recording.put_picture(key[0], key[1], self.now(), job)
                else:
                    stored.append(self._log.add(self.run, key, job))
            self._written += len(stored)
            if self._written >= PRUNE_EVERY:
                self._written = 0
                self._log.prune(self._limit)
        return stored

    def _use(self, connection: sqlite3.Connection) -> None:
        super()._use(connection)
        self._opened = _file_at(self.path)

    def _make_again(self) -> None:
        """The file was removed, as ``rosclean purge`` does: what follows would be lost with it."""
        if self._in_memory or time.monotonic() < self._again_at or _file_at(self.path) == self._opened:
            return
        self._again_at = time.monotonic() + AGAIN
        if self.path.exists():
            self._move()
            _log.warning("the history %s was replaced by another file, and goes on in that one", self.path)
            return
        copy = f"{self.path}.copy-{self.run}"  # another robot's monitor may make it, too
        self.path.parent.mkdir(parents=True, exist_ok=True)
        try:
            self._connection.execute("VACUUM INTO ?", (copy,))
            for left in SIDE_FILES[1:]:  # of the file that was there: they do not fit the copy
                Path(f"{self.path}{left}").unlink(missing_ok=True)
            os.replace(copy, self.path)
        except BaseException:
            Path(copy).unlink(missing_ok=True)
            raise
        self._connection.close()  # first: it removes the log by its name
        self._use(open_for_writing(str(self.path)))
        _log.warning("the history %s was removed, and is made again", self.path)

    def _finish(self) -> None:
        self._again_at = 0.0
        self._leave_memory()
        if self._frames is not None:
            self._make_frame()
            self._frames.close()

    def _leave_memory(self) -> None:
        if not self._in_memory or time.monotonic() < self._again_at:
            return
        try:
            if self._make_folder:
                self.path.parent.mkdir(parents=True, exist_ok=True)
            if self.path.parent.is_dir():
                self._again_at = time.monotonic() + AGAIN
                self._move()
        except (OSError, sqlite3.Error, HistoryError) as error:
            self._fail(error)

    def _move(self) -> None:
        file = open_for_writing(str(self.path))
        try:
            run = self._copy(file)
        except BaseException:
            file.close()
            raise
        self._connection.close()
        self._use(file)
        self.run, self._in_memory = run, False

    def _copy(self, file: sqlite3.Connection) -> int:
        """Copies the run into a file; returns its number there."""
        own = self._connection.execute("SELECT began, session FROM runs WHERE id = ?", (self.run,)).fetchone()
        # Another robot's monitor may have made the file, of what they shared.
        there = file.execute("SELECT id FROM runs WHERE began = ? AND session = ?", own).fetchone()
        run: int = there[0] if there else begin_run(file, *own)
        with file:
            # In a new file, which it nearly always is, events get the numbers that they have.
            for table, columns in _COPIED:
                file.execute(f"DELETE FROM {table} WHERE run = ?", (run,))
                order = "id" if table == "events" else "1, 2"
                ask = f"SELECT {columns} FROM {table} WHERE run = ? ORDER BY {order}"
                marks = ",".join("?" * len(columns.split(",")))
                rows = self._connection.execute(ask, (self.run,))
                file.executemany(f"INSERT INTO {table} (run, {columns}) VALUES ({run},{marks})", rows)
            known = "REPLACE" if self._in_memory else "IGNORE"
            pictures = self._connection.execute("SELECT * FROM pictures ORDER BY rowid")
            file.executemany(f"INSERT OR {known} INTO pictures VALUES (?,?,?,?)", pictures)
        return run


def _file_at(path: Path) -> Optional[Tuple[int, int]]:
    """Which file lies there; None: none."""
    with contextlib.suppress(FileNotFoundError):
        found = path.stat()
        return found.st_dev, found.st_ino
    return None


class HistorySection:
    """Keeps the section ``history`` of the state."""

    def __init__(self, tree: StateTree) -> None:
        self._tree = tree
        tree.set(SECTION, "events", {})

    def add(self, events: List[Dict[str, Any]]) -> None:
        """Shows stored events; the first page comes from another thread."""
        for event in events[-NEWEST:]:
            key = str(event["id"])
            self._tree.remove(SECTION, "events", key)  # where it could not be written, once more
            self._tree.set(SECTION, "events", key, event)
        for old in self._tree.keys(SECTION, "events")[:-NEWEST]:
            self._tree.remove(SECTION, "events", old)
