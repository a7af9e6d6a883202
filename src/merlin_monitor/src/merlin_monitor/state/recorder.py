# SPDX-License-Identifier: Apache-2.0
"""Records what is shown: takes the changes of the state in frames, and packs them, in one thread."""

import json
import threading
import zlib
from typing import Any, Callable, Dict, Optional

from merlin_monitor.history.frames import Frame
from merlin_monitor.state.state_tree import StateTree, apply_changes

GATHER = 0.2  # s that changes are gathered for one frame
LONGEST_SEGMENT = 300.0  # s
LARGEST_SEGMENT = 256 * 1024  # characters of changes, or as many as the whole state has
LEFT_OUT = ("history",)  # sections: the events have a table of their own
STOP_LIMIT = 5.0  # s for the last frame


class Recorder:
    """Puts a frame for what has changed, at most one each `GATHER` seconds.

    :param tree: the state.
    :param put: takes a frame at once; False: it is lost, and the next frame has to be a whole state.
    :param clock: s since 1970, never going back.
    :param segment: the last one of the run; 0: it begins.
    """

    def __init__(
        self, tree: StateTree, put: Callable[[Frame], bool], clock: Callable[[], float], segment: int = 0
    ) -> None:
        self._tree = tree
        self._put = put
        self._clock = clock
        self._changed = threading.Event()
        self._marked = threading.Event()
        self._stopped = threading.Event()
        self._segment, self._number = segment, 0
        self._room = 0  # characters that the segment may still take
        self._until = 0.0  # s of the clock at which the segment ends
        self._pack: Any = None
        self._feed: Any = None
        self._thread = threading.Thread(target=self._work, name="recorder", daemon=True)

    def start(self) -> None:
        """Begins with the whole state."""
        self.follow()
        self._changed.set()
        self._thread.start()

    def follow(self) -> None:
        """Begins without a thread: the caller takes the frames."""
        self._feed = self._tree.subscribe(self._changed.set)

    def mark(self) -> None:
        """Has the next frame put also when nothing changes: it is of the time of an event, or later.

        What an event is about may be in a frame from before it, and the one after it be about something else.
        """
        self._marked.set()
        self._changed.set()

    def stop(self) -> None:
        """Records what has changed until now, and ends."""
        self._stopped.set()
        self._changed.set()
        if self._thread.is_alive():
            self._thread.join(STOP_LIMIT)

    def _work(self) -> None:
        while True:
            self._changed.wait()
            last = self._stopped.wait(GATHER)
            self._changed.clear()
            self.take()
            if last:
                self._feed.close()
                return

    def take(self) -> None:
        """Puts a frame for the changes until now, if there are any, or an event."""
        marked = self._marked.is_set()
        if marked:
            self._marked.clear()
        # Before the changes are taken: a frame of a time has all that was changed by then.
        wall = self._clock()
        version, changes = self._feed.take()
        kept = [change for change in changes.as_list() if change[0][0] not in LEFT_OUT]
        if not kept and not changes.whole and not marked and self._pack is not None:
            return
        text = _compact(kept)
        if changes.whole or len(text) > self._room or wall > self._until:
            self._begin_segment(wall)
            # What changed since the feed was read is in here, and comes again: that changes nothing.
            version, text = self._tree.as_json(LEFT_OUT)
            self._room = max(LARGEST_SEGMENT, len(text))
        else:
            self._room -= len(text)
        at = self._tree.get("meta", "time") or 0.0
        data = self._pack.compress(f"[{wall},{_compact(at)},{text},{version}]".encode())
        data += self._pack.flush(zlib.Z_SYNC_FLUSH)
        if self._put(Frame(self._segment, self._number, wall, data)):
            self._number += 1
        else:
            self._room = -1  # the next frame begins a segment

    def _begin_segment(self, wall: float) -> None:
        self._segment += 1
        self._number = 0
        self._until = wall + LONGEST_SEGMENT
        self._pack = zlib.compressobj(6)


def _compact(value: Any) -> str:
    return json.dumps(value, separators=(",", ":"))


def last_state(segment: Optional[str]) -> Dict[str, Any]:
    """The state to which a segment leads.

    :param segment: of :meth:`merlin_monitor.history.frames.Recording.segment`.
    :raises ValueError, LookupError, TypeError: it cannot be read.
    """
    (_, _, state, _), *later = json.loads(segment or "")["frames"]
    for _, _, changes, _ in later:
        apply_changes(state, changes)
    return dict(state)
