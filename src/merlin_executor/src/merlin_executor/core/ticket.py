# SPDX-License-Identifier: Apache-2.0
"""A request as the agenda sees it, the line in which requests wait, and what can be expected of these."""

from dataclasses import dataclass, field
from enum import Enum
from typing import Any, Callable, Generic, Iterator, List, Mapping, Optional, Sequence, Tuple, TypeVar

from merlin_executor.core.outcome import Stop, Verdict
from merlin_executor.core.time_window import (
    ALWAYS,
    Forecast,
    Outlook,
    TimeWindow,
    outlook_foreseen,
    outlook_waiting,
)
from merlin_ros.work.passed_time import PassedTime

#: s of ROS time for which requests of equal priority may overtake one that could begin.
OVERTAKE_LIMIT = 600.0


class Client(Enum):
    """State of a request's client."""

    ALIVE = "alive"
    SILENT = "silent"
    GONE = "gone"


@dataclass(eq=False)
class Ticket:
    """A request as the agenda and the engine see it.

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

    order: int
    priority: int = 0
    resumes: bool = True
    goes_on: bool = True
    sender: str = ""
    window: TimeWindow = ALWAYS
    alone: bool = False
    interruptible: bool = True
    value: float = 1.0
    party: int = field(default=0, init=False)
    forecast: Optional[Forecast] = field(default=None, init=False)
    rank: int = field(default=0, init=False)
    left_out: str = field(default="", init=False)
    ready_since: Optional[float] = field(default=None, init=False)
    begun: bool = field(default=False, init=False)
    parts: bool = field(default=False, init=False)
    interrupted: bool = field(default=False, init=False)
    client: Client = field(default=Client.ALIVE, init=False)
    stop: Optional[Stop] = field(default=None, init=False)

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
    def under_way(self) -> bool:
        """Whether its plan is carried out: another one would stop its actions, or be exchanged for it."""
        return False

    def begin(self, run: Sequence[Any]) -> None:
        """A run begins: the first, or after another one was stopped.

        :param run: all requests of that run, in the same order for each of them.
        """

    def join(self, first: Any) -> None:
        """Becomes part of a run whose plan is carried out.

        :param first: the first request of that run.
        """

    def accept(self) -> None:
        """Called when the request runs for the first time."""

    def end(self, verdict: Verdict) -> bool:
        """Answers the client; False when that was done before."""
        raise NotImplementedError


T = TypeVar("T", bound=Ticket)


class WaitingLine(Generic[T]):
    """The requests that wait, the more urgent first; of equal ones the earliest deadline, then the oldest.

    :param clock: ROS time, s; may be set back and forward.
    :param overtake_limit: s for which requests of equal priority may overtake one that could begin.
    :ivar time: of the clock, as it was looked at last.
    """

    def __init__(self, clock: Callable[[], float], overtake_limit: float) -> None:
        self._clock = clock
        self._overtake_limit = overtake_limit
        self._tickets: List[T] = []
        self.time = PassedTime(clock())

    def __iter__(self) -> Iterator[T]:
        return iter(list(self._tickets))

    def put(self, ticket: T) -> None:
        """A request waits, from now on or again."""
        self._tickets.append(ticket)
        self.look()

    def take(self, ticket: T) -> None:
        """A request no longer waits."""
        self._tickets.remove(ticket)

    def clear(self) -> List[T]:
        """None waits any more; returns those that did."""
        left, self._tickets = self._tickets, []
        return left

    def look(self) -> None:
        """Looks at the clock and puts what waits in the order in which it would run now."""
        line = self.time.look(self._clock())
        for ticket in self._tickets:
            if ticket.ready_since is None and ticket.window.not_before <= self.time.now:
                ticket.ready_since = line
        self._tickets.sort(key=self._place)

    def is_overdue(self, ticket: T) -> bool:
        """Whether it could have begun for so long that no other one overtakes it any more."""
        since = ticket.ready_since
        return since is not None and self.time.line - since >= self._overtake_limit

    def ready(self, begun_only: bool = False) -> List[T]:
        """Those that may run now.

        :param begun_only: only those that have begun already.
        """
        ready = [t for t in self._tickets if t.may_run and t.window.is_open(self.time.now)]
        return [t for t in ready if t.begun] if begun_only else ready

    # --- where not all can be in time ---------------------------------------------------------------------

    def of_priority(self, ticket: T) -> List[T]:
        """Those that wait, of the priority of one with a deadline."""
        return [t for t in self._tickets if ticket.window.is_limited and t.priority == ticket.priority]

    def choose_anew(self, tickets: Sequence[T]) -> None:
        """Takes back what :meth:`arrange` has decided: there may be time for others than these now."""
        for ticket in tickets:
            for other in self.of_priority(ticket):
                other.rank, other.left_out = 0, ""
        self.look()

    def arrange(self, ranks: Mapping[int, Tuple[int, str]]) -> None:
        """See :meth:`.Agenda.arrange`."""
        for ticket in self._tickets:
            ticket.rank, ticket.left_out = ranks.get(ticket.order, (ticket.rank, ticket.left_out))
        self.look()

    def _place(self, ticket: T) -> Tuple[float, ...]:
        window, priority, order = ticket.window, -ticket.priority, ticket.order
        if window.not_before > self.time.now:
            return 1, window.not_before, priority, window.deadline, order
        if self.is_overdue(ticket):
            return 0, priority, 0, ticket.ready_since or 0.0, order
        group = 2 if ticket.left_out else 0 if window.is_limited else 1
        return 0, priority, 1, group, ticket.rank, window.deadline, order


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
    ends = [ticket.expected_end for ticket in running]
    free = end_of_run = None if not ends or None in ends else max(end for end in ends if end is not None)
    found = []
    for ticket, ahead in lines(running, waiting):
        before, end = "", None
        goes_first = first is None or first.priority < ticket.priority
        if first is not None and not goes_first:
            before, end = first.text, end_of_run
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
