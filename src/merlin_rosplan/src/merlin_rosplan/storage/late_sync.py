"""Brings a file to the disk a moment after it was written, without the writer having to wait for it."""

import logging
import os
import threading

DELAY = 0.1  # s of wall time in which writes are gathered for one sync

_log = logging.getLogger(__name__)


class LateSync:
    """Syncs one file, in a thread of its own, at most `DELAY` after it was asked to.

    :param path: of a file that exists, and stays the same one until :meth:`close`.
    """

    def __init__(self, path: str) -> None:
        self._file = os.open(path, os.O_RDONLY)
        self._changed = threading.Condition()  # guards the two below
        self._wanted = False
        self._closed = False
        self._thread = threading.Thread(target=self._run, name=f"sync {os.path.basename(path)}", daemon=True)
        self._thread.start()

    def soon(self) -> None:
        """The file was written; returns at once."""
        with self._changed:
            if not self._wanted:
                self._wanted = True
                self._changed.notify_all()

    def close(self) -> None:
        """Ends the thread; what was asked for and not done is left to the operating system."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        self._thread.join()
        os.close(self._file)

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._wanted or self._closed)
                if self._changed.wait_for(lambda: self._closed, timeout=DELAY):
                    return
                self._wanted = False
            try:
                os.fdatasync(self._file)
            except OSError as error:
                _log.error("the last changes may be lost in a power cut: %s", error)
