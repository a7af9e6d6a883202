# SPDX-License-Identifier: Apache-2.0
"""Passes on what the nodes of a run write to standard error, until the run ends.

A node that is stopped while it still starts dies with a traceback that says nothing to a user; a warning in
the middle of a run does. So the lines go to the screen while the run lasts, and to the log file always.
"""

import contextlib
import io
import os
import threading
from pathlib import Path

from merlin_ros.processes.screen import Screen
from merlin_ros.work.threads import start_thread

STDERR = 2


class LogFile(io.TextIOBase):
    """A log that ends nothing: what a full disk does not take is lost."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def add(self, data: bytes) -> None:
        """Writes bytes at the end."""
        with contextlib.suppress(OSError), self._path.open("ab") as file:
            file.write(data)

    def write(self, text: str) -> int:
        """Writes text, as a file does."""
        self.add(text.encode(errors="replace"))
        return len(text)


class ErrorRelay:
    """Stands in for this process's standard error; processes started meanwhile inherit it.

    Use as a context manager around everything that starts processes.
    """

    def __init__(self, log_file: LogFile) -> None:
        """
        :param log_file: takes every line.
        """
        self._log_file = log_file
        self._muted = threading.Event()

    def __enter__(self) -> "ErrorRelay":
        self._given = os.dup(STDERR)
        self._screen = Screen(self._given)
        self._source, sink = os.pipe()
        os.dup2(sink, STDERR)
        os.close(sink)
        self._reader = start_thread("error_relay", self._relay)  # until the pipe's last holder has ended
        return self

    def __exit__(self, *_: object) -> None:
        os.dup2(self._given, STDERR)
        self._reader.join(timeout=5.0)
        self._screen.close()
        os.close(self._given)

    def say(self, text: str) -> None:
        """Puts one line of our own on the screen."""
        self._screen.write(f"{text}\n".encode())

    def mute(self) -> None:
        """Sends the nodes' lines to the log file only, from now on."""
        self._muted.set()

    def _relay(self) -> None:
        with os.fdopen(self._source, "rb") as source:
            for line in source:  # to the last one: without a reader a node that warns would fail
                self._log_file.add(line)
                if not self._muted.is_set():
                    self._screen.write(line)
