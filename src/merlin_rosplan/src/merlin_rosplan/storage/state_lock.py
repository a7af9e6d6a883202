"""Keeps a state file for one process."""

import errno
import fcntl
import os


class StateLockedError(Exception):
    """Another process holds the lock; the text says which."""


class StateLock:
    """An exclusive lock beside a file; it ends with the process, whatever kills it.

    The lock has a file of its own: the file it guards may be damaged, missing, or about to be removed. It is
    never removed itself, because two processes could then hold the locks of two files of one name.

    :param path: of the file to guard.
    :raises StateLockedError: when another process holds the lock.
    :raises OSError: when the lock file cannot be written.
    """

    def __init__(self, path: str) -> None:
        self._file = os.open(f"{path}.lock", os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            holder = os.read(self._file, 20).decode("ascii", "replace").strip()
            os.close(self._file)
            if error.errno not in (errno.EWOULDBLOCK, errno.EACCES):
                raise
            raise StateLockedError(f"process {holder or 'unknown'} has it open") from error
        os.ftruncate(self._file, 0)
        os.pwrite(self._file, f"{os.getpid()}\n".encode(), 0)

    def close(self) -> None:
        """Releases the lock. A second call does nothing."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1
