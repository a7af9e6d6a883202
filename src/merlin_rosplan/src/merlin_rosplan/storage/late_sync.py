"""Brings a file to the disk a moment after it was written, without the writer having to wait for it."""

import logging
import os
import threading

from merlin_ros.alarms import call_later
from merlin_ros.work.threads import CallQueue

DELAY = 0.1  # s of wall time in which writes are gathered for one sync

_log = logging.getLogger(__name__)


class LateSync:
    """Syncs one file, in another thread, at most `DELAY` after it was asked to.

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
            call_later(DELAY, lambda: self._calls.put(self._sync))

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
