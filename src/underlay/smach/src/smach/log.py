# SPDX-License-Identifier: Apache-2.0
"""Logging and the shutdown check: functions of the package that an embedding framework replaces."""

import threading
import weakref
from typing import Callable

import smach

_waiting_lock = threading.Lock()  # guards the set below
_waiting = weakref.WeakSet()  # type: ignore[var-annotated]


def loginfo(message: object) -> None:
    """Reports progress; prints unless replaced by :func:`set_loggers`."""
    print(f"[ INFO ] : {message}")


def logwarn(message: object) -> None:
    """Reports what may be a mistake; prints unless replaced by :func:`set_loggers`."""
    print(f"[ WARN ] : {message}")


def logdebug(message: object) -> None:
    """Reports details; prints unless replaced by :func:`set_loggers`."""
    print(f"[ DEBUG ] : {message}")


def logerr(message: object) -> None:
    """Reports a mistake or a failure; prints unless replaced by :func:`set_loggers`."""
    print(f"[ ERROR ] : {message}")


def is_shutdown() -> bool:
    """Whether running containers should end; False unless replaced by :func:`set_shutdown_check`."""
    return False


def set_loggers(
    info: Callable[[object], None],
    warn: Callable[[object], None],
    debug: Callable[[object], None],
    error: Callable[[object], None],
) -> None:
    """Replaces ``smach.loginfo``, ``smach.logwarn``, ``smach.logdebug`` and ``smach.logerr``.

    Note the order of the arguments, which is that of SMACH.
    """
    vars(smach).update(loginfo=info, logwarn=warn, logdebug=debug, logerr=error)


def set_shutdown_check(cb: Callable[[], bool]) -> None:
    """Replaces ``smach.is_shutdown``.

    :param cb: returns True as soon as running containers should end.
    """
    smach.is_shutdown = cb


def wake_at_shutdown(condition: threading.Condition) -> None:
    """Has the condition notified by :func:`notify_shutdown` for as long as it exists."""
    with _waiting_lock:
        _waiting.add(condition)


def notify_shutdown() -> None:
    """Wakes all that wait, so that they ask ``smach.is_shutdown`` at once; for embedding frameworks."""
    with _waiting_lock:
        conditions = list(_waiting)
    for condition in conditions:
        with condition:
            condition.notify_all()
