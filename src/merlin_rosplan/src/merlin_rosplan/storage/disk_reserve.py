"""Disk space that is kept for the moment when the disk is full."""

import contextlib
import os
from typing import Optional

#: bytes; a closed execution takes about 20 thousand.
SIZE = 256 * 1024


class DiskReserve:
    """A file that only takes space, and gives it back when it is needed.

    :param path: of the file. A killed process leaves it, the next one continues with it.
    """

    def __init__(self, path: str) -> None:
        self._path = path
        self._file: Optional[int] = None
        self._held = False

    def hold(self) -> bool:
        """Takes the space, if that was not done; False when there is too little."""
        if self._held:
            return True
        try:
            if self._file is None:
                self._file = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
            os.posix_fallocate(self._file, 0, SIZE)
        except OSError:
            self._free()
            return False
        self._held = True
        return True

    def release(self) -> bool:
        """Gives the space back; False when there was none."""
        held, self._held = self._held, False
        return held and self._free()

    def close(self) -> None:
        """Takes the file away."""
        self._held = False
        if self._file is not None:
            os.close(self._file)
            self._file = None
            with contextlib.suppress(OSError):
                os.remove(self._path)

    def _free(self) -> bool:
        if self._file is None:
            return False
        try:
            os.ftruncate(self._file, 0)
        except OSError:
            return False
        return True
