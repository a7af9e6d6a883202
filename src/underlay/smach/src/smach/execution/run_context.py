# SPDX-License-Identifier: Apache-2.0
"""Which run a preempt request belongs to.

A request counts for the run in which it is made: a request to an idle state or container is forgotten
when its next run begins. All requests and all beginnings of runs are therefore numbered in one order. What
a thread is executing for a container is kept with the number at which that began, so that a request that
reached a container while the state *around* it was already running still counts.
"""

import itertools
import threading
from typing import Any, NamedTuple, Optional

_numbers = itertools.count(1)
# Owner of every state's `_preempt_requested` together with `_preempt_number`. Re-entrant, because a signal
# handler may preempt a container while its thread is right here.
flag_lock = threading.RLock()


class Run(NamedTuple):
    """A state that a container executes in this thread."""

    state: Any
    begin: int


class _Context(threading.local):
    run: Optional[Run] = None


_context = _Context()


def next_number() -> int:
    """The next number in the order of requests and beginnings."""
    return next(_numbers)


def enter(state: Any, begin: int) -> Optional[Run]:
    """This thread continues to execute a state.

    :param begin: number at which its run began.
    :return: to be given to :func:`leave`.
    """
    outer = _context.run
    _context.run = Run(state, begin)
    return outer


def leave(outer: Optional[Run]) -> None:
    """The execution has ended."""
    _context.run = outer


def executing() -> bool:
    """Whether this thread is executing a state for some container."""
    return _context.run is not None


def begin_run(state: Any) -> bool:
    """Called by a state as its execution begins; forgets requests that were made before this run.

    :return: whether a container executes it, which then reads and clears its preempt flag.
    """
    run = _context.run
    if run is not None and run.state is state:
        return True  # the container has cleared the flag already
    with flag_lock:
        begin = state._prepared_at or (run.begin if run is not None else next_number())
        state._prepared_at = 0
        if state._preempt_number < begin:
            state._preempt_requested = False
    return False


def end_run(state: Any, by_container: bool) -> None:
    """Called by a state as its execution ends, with what :func:`begin_run` returned."""
    if not by_container:
        state._preempt_requested = False
