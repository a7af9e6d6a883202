# SPDX-License-Identifier: Apache-2.0
"""A folder for a node's files that does not outlive it for long, however it ends."""

import contextlib
import fcntl
import os
import shutil
import tempfile
import threading
import time
from typing import Optional

NEW = 60.0  # s within which a folder may not be locked yet


class ScratchFolder:
    """A temporary folder. One whose process was killed is removed when the next of its kind is made.

    It is made when its name is first asked for, and again when it was removed meanwhile. The process holds a
    lock on it, which ends with the process.

    :param kind: begins its name.
    """

    def __init__(self, kind: str) -> None:
        self._kind = kind
        self._making = threading.Lock()  # guards the fields below
        self._folder: Optional[tempfile.TemporaryDirectory[str]] = None
        self._lock = -1

    @property
    def name(self) -> str:
        """Its path."""
        with self._making:
            if self._folder is None or (self._lock >= 0 and not os.path.isdir(self._folder.name)):
                self._remove()
                _remove_left(self._kind)
                folder = tempfile.TemporaryDirectory(prefix=f"{self._kind}-")
                self._lock = os.open(folder.name, os.O_RDONLY)
                fcntl.flock(self._lock, fcntl.LOCK_SH)
                self._folder = folder
            return self._folder.name

    def cleanup(self) -> None:
        """Removes the folder with its contents."""
        with self._making:
            self._remove()

    def _remove(self) -> None:
        if self._folder is not None:
            self._folder.cleanup()
        if self._lock >= 0:
            os.close(self._lock)
            self._lock = -1


def _remove_left(kind: str) -> None:
    for folder in os.scandir(tempfile.gettempdir()):
        if not folder.name.startswith(f"{kind}-"):
            continue
        with contextlib.suppress(OSError):  # of another user, or another process removes it too
            if folder.is_symlink() or time.time() - folder.stat().st_mtime < NEW:
                continue
            lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(folder)
            finally:
                os.close(lock)
