# SPDX-License-Identifier: Apache-2.0
"""A request as the agenda sees it, and what can be expected of those that wait in line."""

import math
from enum import Enum
from typing import List, Optional, Sequence, Tuple, TypeVar

from merlin_executor.core.outcome import Stop
from merlin_executor.core.time_window import (
    ALWAYS,
    Forecast,
    Outlook,
    TimeWindow,
    outlook_foreseen,
    outlook_waiting,
)


class Client(Enum):
    """State of a request's client."""

    ALIVE = "alive"
    SILENT = "silent"
    GONE = "gone"


class Ticket:
    """What the agenda knows of a request.

    :param order: number of arrival; equal priorities with equal deadlines run in this order.
    :param priority: higher is more urgent.
    :param resumes: whether it runs again after an interruption; otherwise it is dropped.
    :param goes_on: whether it continues without its client.
    :param sender: the node of its client; empty: not known.
    :param window: when it may run.
    :param alone: whether it is never planned together with others.
    :param interruptible: whether more urgent requests interrupt it.
    :param value: what it is worth among those of its priority, where not all can be in time.
    :ivar party: it runs together only with those of the same number; a joint run that failed divides its own.
    :ivar begun: whether it has begun and was not interrupted since; a pause lets it go on.
    :ivar parts: whether it is taken out of a run that goes on with the others.
    :ivar forecast: how long it will take; None: that is not known.
    :ivar rank: of those of its priority that have deadlines, where not all can be in time.
    :ivar left_out: why there is no time for it, as a sentence; empty: that is not so.
    :ivar ready_since: when it could first begin, in the agenda's own time; None: it could not yet.
    """

    def __init__(
        self,
        order: int,
        priority: int = 0,
        resumes: bool = True,
        goes_on: bool = True,
        sender: str = "",
        window: TimeWindow = ALWAYS,
        alone: bool = False,
        interruptible: bool = True,
        value: float = 1.0,
    ) -> None:
        self.order = order
        self.priority = priority
        self.resumes = resumes
        self.goes_on = goes_on
        self.sender = sender
        self.window = window
        self.alone = alone
        self.interruptible = interruptible
        self.value = value
        self.party = 0
        self.forecast: Optional[Forecast] = None
        self.rank = 0
        self.left_out = ""
        self.ready_since: Optional[float] = None
        self.begun = self.parts = False
        self.interrupted = False
        self.client = Client.ALIVE
        self.stop: Optional[Stop] = None

    @property
    def text(self) -> str:
        """What it is for, as PDDL text."""
        return ""

    @property
    def expected_end(self) -> Optional[float]:
        """When its run is expected to end, s of ROS time; None: not known."""
        return None

    @property
    def keeps(self) -> str:
        """Until when it is not interrupted while it runs, as part of a sentence; empty: it is at once."""
        return "" if self.interruptible else f"{self.text or 'the request that runs'} has ended"

    @property
    def may_run(self) -> bool:
        """Whether it may begin: no request of a silent client begins."""
        return self.goes_on or self.client is Client.ALIVE

    @property
    def joins(self) -> bool:
        """Whether it may run together with others; a planner that does not know its deadline may miss it."""
        return not self.alone and self.window.deadline == math.inf

    @property
    def under_way(self) -> bool:
        """Whether its plan is carried out: another one would stop its actions, or be exchanged for it."""
        return False


T = TypeVar("T", bound=Ticket)


def lines(running: Sequence[T], waiting: Sequence[T]) -> List[Tuple[T, Tuple[int, ...]]]:
    """The requests that wait, in order, and the :attr:`Ticket.order` of what runs and waits before each.

    One that is proven late by itself keeps no other one waiting.
    """
    ahead = tuple(ticket.order for ticket in running)
    found = []
    for ticket in waiting:
        found.append((ticket, ahead))
        forecast = ticket.forecast
        if forecast is None or not forecast.late or not forecast.fits(ahead):
            ahead = (*ahead, ticket.order)
    return found


def outlooks(
    running: Sequence[T], waiting: Sequence[T], now: float, kept: str = ""
) -> List[Tuple[T, Outlook]]:
    """The requests that wait, in order, and what can be expected of each.

    :param running: those that run, in one plan.
    :param now: s of ROS time.
    :param kept: why a more urgent one does not interrupt these, as a sentence; empty: it does.
    """
    first = running[0] if running else None
    free = first.expected_end if first is not None else None
    found = []
    for ticket, ahead in lines(running, waiting):
        before, end = "", None
        goes_first = first is None or first.priority < ticket.priority
        if first is not None and not goes_first:
            before, end = first.text, first.expected_end
            before += f" and {len(running) - 1} more" if before and len(running) > 1 else ""
        outlook = outlook_waiting(ticket.window, ticket is waiting[0], before, end)
        forecast = ticket.forecast
        if forecast is not None and forecast.fits(ahead):
            outlook = outlook_foreseen(ticket.window, outlook, forecast, None if goes_first else free)
            free = free if forecast.late else outlook.end
        else:
            free = None
        if outlook.late and ticket.left_out:
            outlook = outlook._replace(late=ticket.left_out)
        if goes_first and first is not None and ticket.window.is_open(now):
            outlook = outlook._replace(waits=kept)
        found.append((ticket, outlook))
    return found
