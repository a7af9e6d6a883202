# SPDX-License-Identifier: Apache-2.0
"""One thread that owns the model: messages of all topics are taken in one after the other."""

import queue
import sys
import threading
import time
import traceback
from typing import Any, Callable, Optional, Tuple

from merlin_ros.work.threads import failure_text

WAITING = 2000  # messages; a callback that brings more waits, and rospy drops the oldest of its topic


class Inbox:
    """Calls what is put in, in order, in its own thread.

    :param complain: takes one line about a call that raised an exception; the others continue.
    """

    def __init__(self, complain: Callable[[str], None] = lambda line: print(line, file=sys.stderr)) -> None:
        self._calls: queue.Queue[Any] = queue.Queue(WAITING)
        self._complain = complain
        self._complained = -60.0
        self._thread = threading.Thread(target=self._work, name="inbox", daemon=True)

    def start(self) -> None:
        """Begins to work."""
        self._thread.start()

    def put(self, call: Callable[..., object], *arguments: Any) -> None:
        """Queues a call; blocks while the queue is full."""
        self._calls.put((call, arguments))

    def stop(self, timeout: float = 2.0) -> None:
        """Ends after what was put in before, or at the timeout, s."""
        if self._thread.is_alive() and threading.current_thread() is not self._thread:
            try:
                self._calls.put(None, timeout=timeout)
            except queue.Full:
                return
            self._thread.join(timeout)

    def _work(self) -> None:
        while True:
            item: Optional[Any] = self._calls.get()
            if item is None:
                return
            self._make(*item)

    def _make(self, call: Callable[..., object], arguments: Tuple[Any, ...]) -> None:
        try:
            call(*arguments)
        except Exception as error:  # one strange message must not blind the monitor
            if time.monotonic() - self._complained > 10.0:
                self._complained = time.monotonic()
                where = traceback.extract_tb(error.__traceback__)[-1]
                self._complain(
                    f"a message could not be shown: {failure_text(error)} "
                    f"({where.filename.rsplit('/', 1)[-1]}:{where.lineno})"
                )


class DirectInbox(Inbox):
    """Calls at once, in the thread of the caller, which owns the model: for a recording."""

    def put(self, call: Callable[..., object], *arguments: Any) -> None:
        """Makes the call at once, in the calling thread."""
        self._make(call, arguments)
