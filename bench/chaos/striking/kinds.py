# SPDX-License-Identifier: Apache-2.0
"""Which stroke belongs to which kind of fault, and why a fault cannot be done here."""

from typing import Callable, Dict, Type

from chaos.faults import (
    AGAIN,
    CANCEL_AHEAD,
    CLOCK_BACK,
    DESCRIPTORS,
    DISK_FULL,
    FORGED_PAUSE,
    HALF_OPEN,
    LINK,
    PAGE_STOP,
    SECOND_CLOCK,
    SECOND_NODE,
    SOCKETS,
    THREADS,
    WALL_CLOCK,
    Fault,
)
from chaos.striking.shortages import Descriptors, Sockets, Threads, why_no_threads
from chaos.striking.strangers import CancelAhead, ForgedPause, HalfOpen, PageStop
from chaos.striking.stroke import Stroke
from chaos.striking.surroundings import (
    Again,
    ClockBack,
    DiskFull,
    Link,
    SecondClock,
    SecondNode,
    WallClock,
)
from chaos.under_test.network import why_impossible
from chaos.under_test.wall_clock import why_not_set

STROKES: Dict[str, Type[Stroke]] = {
    AGAIN: Again,
    CANCEL_AHEAD: CancelAhead,
    CLOCK_BACK: ClockBack,
    DESCRIPTORS: Descriptors,
    DISK_FULL: DiskFull,
    FORGED_PAUSE: ForgedPause,
    HALF_OPEN: HalfOpen,
    LINK: Link,
    PAGE_STOP: PageStop,
    SECOND_CLOCK: SecondClock,
    SECOND_NODE: SecondNode,
    SOCKETS: Sockets,
    THREADS: Threads,
    WALL_CLOCK: WallClock,
}
#: Why a machine cannot do a kind; empty when it can.
REASONS: Dict[str, Callable[[], str]] = {
    LINK: why_impossible,
    THREADS: why_no_threads,
    WALL_CLOCK: why_not_set,
}


def why_not(fault: Fault) -> str:
    """Why this machine cannot do a fault; empty when it can."""
    return REASONS[fault.kind]() if fault.kind in REASONS else ""
