# SPDX-License-Identifier: Apache-2.0
"""The containers that are being built: ``with container:`` and the static ``add`` methods meet here.

Each thread builds its own containers, so the stack belongs to the thread and needs no lock.
"""

import threading
from typing import Any, Dict, List, NamedTuple, Optional

from smach.exceptions import InvalidStateError


class _Open(NamedTuple):
    container: Any
    defaults: Dict[str, Any]


class _Stack(threading.local):
    def __init__(self) -> None:
        self.open: List[_Open] = []


_stack = _Stack()


def push(container: Any, defaults: Optional[Dict[str, Any]] = None) -> None:
    """A container is opened.

    :param defaults: arguments for every ``add`` while it is the innermost one.
    """
    _stack.open.append(_Open(container, defaults or {}))


def pop(container: Any) -> None:
    """A container is closed.

    :raises InvalidStateError: it is not the innermost open one.
    """
    if not _stack.open or _stack.open[-1].container is not container:
        raise InvalidStateError(
            f"Closing container '{container._path()}', which is not the innermost open one of this thread"
        )
    _stack.open.pop()


def is_open(container: Any) -> bool:
    """Whether this thread has the container open."""
    return any(entry.container is container for entry in _stack.open)


def innermost(kind: type, method: str) -> Any:
    """The innermost open container of this thread.

    :param kind: the class it must be of.
    :param method: the method that asks, for the error.
    :raises InvalidStateError: none is open, or one of another kind.
    """
    if not _stack.open:
        raise InvalidStateError(
            f"{method}() needs an open container: call it inside 'with container:' (in the same thread)"
        )
    container = _stack.open[-1].container
    if not isinstance(container, kind):
        raise InvalidStateError(
            f"{method}() was called while the open container '{container._path()}' is a "
            f"{type(container).__name__}, which is not a {kind.__name__}"
        )
    return container


def defaults() -> Dict[str, Any]:
    """The default arguments given when the innermost container was opened."""
    return _stack.open[-1].defaults if _stack.open else {}
