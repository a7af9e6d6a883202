# SPDX-License-Identifier: Apache-2.0
"""What a process prints and logs, where that may end or stand: a pipe, a full disk, a terminal after Ctrl-S.

The work goes on: what cannot be written is lost, and a screen that takes nothing is waited for once.
"""

import contextlib
import io
import logging
import math
import os
import select
import stat
import sys
import time
from typing import Any

PATIENCE = 1.0  # s of wall time for which a screen that takes nothing is waited for, once
OTHERS_FIRST = 1000  # times in a row that other writers may take the room which one has seen
REMIND = 60.0  # s of wall time between two words about a log that cannot be written


class Screen(io.RawIOBase):
    """A file that takes all that is written, and never fails.

    :param descriptor: of the open file, pipe or terminal behind it, which stays open.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = self._own = descriptor
        with contextlib.suppress(OSError):
            # Others, and other processes, write there, too, and a terminal may have room for one character:
            # a write may not wait for room that was there. The flags of the other descriptor are shared.
            if os.isatty(descriptor) or stat.S_ISFIFO(os.fstat(descriptor).st_mode):
                how = os.O_WRONLY | os.O_NONBLOCK | os.O_NOCTTY
                self._own = os.open(f"/proc/self/fd/{descriptor}", how)
        self._stands = False

    def fileno(self) -> int:
        """Its descriptor."""
        return self._descriptor

    def isatty(self) -> bool:
        """Whether it is a terminal."""
        return os.isatty(self._descriptor)

    def writable(self) -> bool:
        """True: it takes all."""
        return True

    def write(self, data: Any) -> int:
        """Writes what there is room for; returns the length of all."""
        left = whole = bytes(data)
        room = select.poll()  # not one for all: it is for one thread at a time
        room.register(self._own, select.POLLOUT)
        tries = 0
        with contextlib.suppress(OSError):
            while left and tries < OTHERS_FIRST:
                self._stands = not room.poll(0 if self._stands else 1000 * PATIENCE)
                if self._stands:
                    break
                tries += 1
                with contextlib.suppress(BlockingIOError):
                    # A pipe that has room takes so much at once.
                    left = left[os.write(self._own, left[: select.PIPE_BUF]) :]
                    tries = 0
        return len(whole)

    def close(self) -> None:
        """Takes nothing any more."""
        if not self.closed and self._own != self._descriptor:
            os.close(self._own)
        super().close()


def print_without_failing() -> None:
    """What this process prints from now on goes to a :class:`Screen`, unless that was replaced before.

    Of a log that cannot be written it is said once; Python would print a traceback with each line.
    """
    logging.Handler.handleError = _lose_line  # type: ignore[assignment]
    _open_closed()
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is not getattr(sys, f"__{name}__") or not isinstance(stream, io.TextIOWrapper):
            continue  # a test reads it
        with contextlib.suppress(OSError):
            stream.flush()
        file: Any = Screen(stream.fileno())
        screen = io.TextIOWrapper(
            file,
            stream.encoding,
            "backslashreplace" if stream.errors == "strict" else stream.errors,
            line_buffering=stream.line_buffering,
            write_through=stream.write_through,
        )
        setattr(sys, name, screen)


def _open_closed() -> None:
    """Input and outputs that are closed, as a daemon may close them, are /dev/null, for children, too."""
    for descriptor, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:  # what has the descriptor now was opened by chance, and was read
            null = os.open(os.devnull, os.O_RDWR)
            os.dup2(null, descriptor)
            os.set_inheritable(descriptor, True)
            if null != descriptor:
                os.close(null)
            setattr(sys, name, os.fdopen(descriptor, "w" if descriptor else "r", closefd=False))


_usual = logging.Handler.handleError
_said = -math.inf  # s of wall time: when a log could not be written


def _lose_line(handler: logging.Handler, record: logging.LogRecord) -> None:
    global _said
    error = sys.exc_info()[1]
    if not isinstance(error, OSError):
        _usual(handler, record)
    elif time.monotonic() - _said >= REMIND:
        _said = time.monotonic()
        file = getattr(handler, "baseFilename", "the log")
        print(f"{file} cannot be written: {error.strerror}; its lines are lost", file=sys.stderr)
