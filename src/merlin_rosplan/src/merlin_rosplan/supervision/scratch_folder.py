"""A folder for a node's files that does not outlive it for long, however it ends."""

import contextlib
import fcntl
import os
import shutil
import tempfile
import time
from pathlib import Path

NEW = 60.0  # s within which a folder may not be locked yet


class ScratchFolder(tempfile.TemporaryDirectory):  # type: ignore[type-arg]  # no generic on Python 3.8
    """A temporary folder. One whose process was killed is removed when the next of its kind is made.

    The process holds a lock on its folder, which the system releases with it.

    :param kind: begins its name.
    """

    def __init__(self, kind: str) -> None:
        _remove_left(kind)
        super().__init__(prefix=f"{kind}-")
        self._lock = os.open(self.name, os.O_RDONLY)
        fcntl.flock(self._lock, fcntl.LOCK_SH)

    def cleanup(self) -> None:
        """Removes the folder with its contents."""
        super().cleanup()
        if self._lock >= 0:
            os.close(self._lock)
            self._lock = -1


def _remove_left(kind: str) -> None:
    for folder in Path(tempfile.gettempdir()).glob(f"{kind}-*"):
        with contextlib.suppress(OSError):  # of another user, or another process removes it too
            if folder.is_symlink() or time.time() - folder.stat().st_mtime < NEW:
                continue
            lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(folder)
            finally:
                os.close(lock)
