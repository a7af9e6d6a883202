# SPDX-License-Identifier: Apache-2.0
"""The threads of a process: each is started here. Without ROS.

What a thread dies of is a matter of `threading.excepthook`, which names it; what it survives is logged here.

A node in which a thread cannot be started ends soon, and is started again (`merlin_ros.ports.self_check`).
"""

import contextlib
import logging
import sys
import threading
import traceback
from collections import deque
from functools import partial
from typing import Any, Callable, Deque, Iterator, Type

_log = logging.getLogger("rosout")  # that of `rospy.logerr`
_FRAMES = -30  # the innermost ones: of what recurses there are a thousand


def start_thread(name: str, work: Callable[..., object], *args: Any) -> threading.Thread:
    """Does a piece of work in a thread of its own, for which the end of the process does not wait.

    :raises RuntimeError: the process can have no further thread. Its caller answers whom the work was for.
    """
    thread = threading.Thread(target=work, args=args, name=name, daemon=True)
    thread.start()
    return thread


def log_failure(what: str = "") -> str:
    """Logs the exception that is being handled, with its traceback.

    :param what: failed; "": this thread, which continues.
    :return: :func:`failure_text` of the exception.
    """
    error = sys.exc_info()[1]
    _log.error(
        "%s: %s",
        what or f"the thread '{threading.current_thread().name}' continues after an error",
        traceback.format_exc(limit=_FRAMES),
    )
    return "" if error is None else failure_text(error)


@contextlib.contextmanager
def failure_logged(what: str = "", kind: Type[BaseException] = Exception) -> Iterator[None]:
    """Goes on behind what is done in it, also when that fails: the exception is logged.

    :param what: as of :func:`log_failure`.
    :param kind: other exceptions are raised.
    """
    try:
        yield
    except kind:
        log_failure(what)


def failure_text(error: BaseException) -> str:
    """Kind and text of an exception, for an answer; the kind alone where making its text raises."""
    try:
        return f"{type(error).__name__}: {error}"
    except Exception as fault:
        return f"{type(error).__name__}: (its text raised {type(fault).__name__})"


class CallQueue:
    """Makes calls one after the other, in a thread that is there only while there are some.

    For what may block, and so must run neither in a subscriber's thread nor in the one of the alarms.

    :param name: of the thread.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._lock = threading.Lock()  # guards the fields below
        self._calls: Deque[Callable[[], object]] = deque()
        self._runs = False

    def put(self, call: Callable[..., object], *args: Any) -> None:
        """Has a function called after those that were put before; never blocks. What it raises is logged."""
        with self._lock:
            self._calls.append(partial(call, *args))
            if self._runs:
                return
            with failure_logged(kind=RuntimeError):  # the next call tries again, if the node lives on
                start_thread(self._name, self._work)
                self._runs = True

    def _work(self) -> None:
        while True:
            with self._lock:
                if not self._calls:
                    self._runs = False
                    return
                call = self._calls.popleft()
            with failure_logged(kind=BaseException):  # of users' code, too; what comes behind is to be called
                call()
