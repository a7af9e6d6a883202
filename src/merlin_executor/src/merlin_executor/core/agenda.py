# SPDX-License-Identifier: Apache-2.0
"""The agenda of the Executor: which request runs, which wait, which stop. Events in, decisions out.

Pure and not thread-safe. Every request that was received gets exactly one :class:`AgendaAnswer`. Of equal
priorities the one with the earliest deadline begins first, then the oldest; but one that could have begun for
the overtake limit is not overtaken any more by those that could begin later.

One run carries out one request, or several together that follow each other in this order. One with a deadline
begins by itself; others join it, and it joins others, where a plan is found that keeps all of them in time.
Whatever ends the run of several and is not an end of each of them puts the others back into their places.
"""

import itertools
import math
from typing import Callable, Dict, Generic, List, Mapping, NamedTuple, Optional, Sequence, Tuple, Union

from merlin_executor.core.outcome import Outcome, Stop, StopKind, Verdict
from merlin_executor.core.request_limits import why_full
from merlin_executor.core.ticket import OVERTAKE_LIMIT, Client, T, Ticket, WaitingLine, lines, outlooks
from merlin_executor.core.time_window import Outlook
from merlin_pddl.breakpoints import Breakpoints

CANCELLED = Stop(StopKind.CANCELLED)
STOPPED = "cancelled"
NOT_BEGUN = "cancelled before it began"
NOT_RESUMED = "cancelled before it went on"
#: Requests in one plan: so many errands are planned in 0.3 s at most.
TOGETHER = 20
#: s of ROS time after its begin for which a run that is still being planned is planned again with a newcomer.
GATHER = 1.0
#: Outcomes of a joint run that one of its requests alone may have caused.
APART = (
    Outcome.REFUSED,
    Outcome.UNSOLVABLE,
    Outcome.NO_PLAN,
    Outcome.PLANNER_TIMEOUT,
    Outcome.PLANNER_ERROR,
    Outcome.ACTION_FAILED,
)


def client_was_lost(reason: str) -> bool:
    """Whether the reason of a verdict says that the request was cancelled because its client was silent."""
    return reason.startswith(tuple(f"{how}: its client " for how in (STOPPED, NOT_BEGUN, NOT_RESUMED)))


class AgendaAnswer(NamedTuple):
    """The request has ended: its client gets this verdict."""

    ticket: Ticket
    verdict: Verdict


class StopRun(NamedTuple):
    """The run has to stop because of this request of it, :attr:`Ticket.stop` says why."""

    ticket: Ticket


class ReviseRun(NamedTuple):
    """Because of this request the plan that is carried out should be one for :attr:`Agenda.revision`."""

    ticket: Ticket


class Refusal(NamedTuple):
    """Why a request does not join the plan that is carried out."""

    reason: str = ""
    """As part of a sentence; empty: there is nothing to say."""
    late: bool = False
    """It is proven that not all would be in time: it comes too late behind that plan, too."""


NOT_SAID = Refusal()
Decision = Union[AgendaAnswer, StopRun, ReviseRun]


class Agenda(Generic[T]):
    """The requests of one Executor: the most urgent ones run, equal ones together, and the others wait.

    :param clock: ROS time, s; may be set back and forward.
    :param overtake_limit: s for which requests of equal priority may overtake one that could begin.
    :param together: requests in one run at most.
    """

    def __init__(
        self,
        clock: Callable[[], float] = lambda: 0.0,
        overtake_limit: float = OVERTAKE_LIMIT,
        together: int = 1,
    ) -> None:
        self._together = together
        self._parties = itertools.count(1)
        self._waiting: WaitingLine[T] = WaitingLine(clock, overtake_limit)
        self._running: Tuple[T, ...] = ()  # replaced as a whole: other threads read it
        self._gathers_until = -math.inf  # of the time as it passes
        self.stopping = False
        """Whether all of what runs stops; it may be planned again then."""
        self._refused: Dict[int, Refusal] = {}  # newcomers that wait for the next plan
        self._surplus = False  # the plan is for one, too, that was taken back meanwhile
        self.closing = False
        """Whether no further request begins."""
        self.paused = False
        """Whether no further request begins until it is resumed."""
        self._hold = False
        self.breakpoints = Breakpoints()
        """Goals before whose request it is held."""

    @property
    def running(self) -> Optional[T]:
        """The request that runs; of several the first."""
        running = self._running
        return running[0] if running else None

    @property
    def together(self) -> List[T]:
        """All requests that run, in one plan."""
        return list(self._running)

    @property
    def waiting(self) -> List[T]:
        """The requests that wait, in the order in which they would run."""
        return list(self._waiting)

    @property
    def next_change(self) -> Optional[float]:
        """ROS time, s, at which :meth:`elapse` has to be called; None: time alone changes nothing."""
        windows = [ticket.window for ticket in self._waiting]
        times = [window.deadline for window in windows]
        times += [window.not_before for window in windows if window.not_before > self._waiting.time.now]
        times += [t.window.deadline for t in self._running if not (t.stop and t.stop.is_final)]
        first = min(times, default=math.inf)
        return first if first < math.inf else None

    def outlooks(self) -> List[Tuple[T, Outlook]]:
        """What can be expected of each that waits, in order. Of those that may still join nothing is said."""
        kept = self._kept and f"waits until {self._kept}"
        joining = self._newcomers() if self._under_way else []
        found = []
        for ticket, outlook in outlooks(self._running, self.waiting, self._waiting.time.now, kept):
            refused = self._refused.get(ticket.order, NOT_SAID).reason if self._running else ""
            if ticket in joining:
                outlook = Outlook(waits=outlook.waits)
            elif refused and not outlook.waits:
                outlook = outlook._replace(waits=f"does not join {self._running[0].text}: {refused}")
            found.append((ticket, outlook))
        return found

    def lines(self) -> List[Tuple[T, Tuple[int, ...]]]:
        """See :func:`.ticket.lines`."""
        return lines(self._running, self.waiting)

    # --- events ---------------------------------------------------------------------------------------

    def receive(self, ticket: T, cancelled: bool = False, again: bool = False) -> List[Decision]:
        """A request has arrived.

        :param cancelled: its client has taken it back already.
        :param again: an earlier life of the Executor has taken it: it may be late, and is not refused.
        """
        if self.closing:
            return [AgendaAnswer(ticket, Verdict(Outcome.REFUSED, StopKind.SHUTDOWN.value))]
        if cancelled:
            return [AgendaAnswer(ticket, Verdict(Outcome.CANCELLED, NOT_BEGUN))]
        full = why_full([other.sender for other in self._waiting], ticket.sender)
        self._waiting.look()
        why = full or ticket.window.why_refused(self._waiting.time.now)
        if why and not again:
            return [AgendaAnswer(ticket, Verdict(Outcome.REFUSED, why))]
        chosen = [t.rank + 1 for t in self._waiting.of_priority(ticket) if t.rank or t.left_out]
        ticket.rank = max(chosen, default=0)  # behind those that were chosen, until it is chosen anew
        self._waiting.put(ticket)
        return self._interrupt()

    def cancel(self, ticket: T, stop: Stop = CANCELLED) -> List[Decision]:
        """A request is no longer wanted."""
        if ticket in self._running:
            return self._part(ticket, stop)
        if ticket not in self._waiting:
            return []
        self._waiting.take(ticket)
        self._waiting.choose_anew([ticket])
        not_run = NOT_RESUMED if ticket.interrupted else NOT_BEGUN
        reason = not_run if stop.kind is StopKind.CANCELLED else f"{not_run}: {stop.reason}"
        return [AgendaAnswer(ticket, Verdict(Outcome.CANCELLED, reason))]

    def client(self, ticket: T, client: Client, reason: str = "") -> List[Decision]:
        """The client of a request is silent, is back, or is gone.

        :param reason: as part of a sentence, for a client that is gone.
        """
        if ticket.goes_on or ticket.client is Client.GONE:
            return []
        ticket.client = client
        if client is Client.GONE:
            return self.cancel(ticket, Stop(StopKind.CLIENT_LOST, reason))
        return self._interrupt()

    def elapse(self) -> List[Decision]:
        """Time has passed, or the clock was set: what is late ends, and what may begin now may interrupt."""
        self._waiting.look()
        now = self._waiting.time.now
        late = [ticket for ticket in self._waiting if ticket.window.deadline <= now]
        for ticket in late:
            self._waiting.take(ticket)
        self._waiting.choose_anew(late)
        decisions: List[Decision] = [
            AgendaAnswer(ticket, Verdict(Outcome.LATE, ticket.window.missed)) for ticket in late
        ]
        for ticket in self._running:
            if ticket.window.deadline <= now:
                decisions += self._part(ticket, Stop(StopKind.LATE, ticket.window.missed))
        return [*decisions, *self._interrupt()]

    def arrange(self, ranks: Mapping[int, Tuple[int, str]]) -> List[Decision]:
        """It was decided which requests begin first, where not all can be in time.

        :param ranks: :attr:`Ticket.order` → :attr:`Ticket.rank` and :attr:`Ticket.left_out`.
        """
        self._waiting.arrange(ranks)
        return self._interrupt()

    def pause(self, paused: bool) -> List[Decision]:
        """Sets or ends the pause, in which no further request begins. The running request continues."""
        self.paused = paused
        return self._interrupt()

    def hold(self, hold: bool) -> List[Decision]:
        """A base of the robots is held, or all are free again. As a pause, with an end of its own."""
        self._hold = hold
        return self._interrupt()

    def begin(self) -> Optional[T]:
        """The next request, which runs from now on with those of :attr:`together`; None: none may run now."""
        group = self._group()
        if self._running or self.closing or self._hold or not group:
            if self.breakpoints.held:
                self.breakpoints.admit([])  # it was taken back
            return None
        first = group[0]
        if self.breakpoints.armed:
            if not self.breakpoints.admit([first.text]):
                return None
            self.breakpoints.began(first.text)
        if not any(ticket.stop and ticket.stop.kind is StopKind.JOINED for ticket in group):
            self._gathers_until = self._waiting.time.line + GATHER
        self._take_up(group)
        self._running = tuple(group)
        self.stopping = self._surplus = False
        self._refused.clear()
        return first

    def planned_again(self) -> List[T]:
        """The run is to be planned again: for these, once it is :meth:`revised`."""
        self._surplus = False
        self._refused.clear()
        return self._joined(behind=False) or list(self._running)

    @property
    def revision(self) -> List[T]:
        """The requests for which the plan that is carried out should be; none: it is, or it is to end."""
        if self.stopping or not self._under_way:
            return []
        left = [ticket for ticket in self._running if ticket.stop is None]
        return left if self._surplus or len(left) < len(self._running) else self._joined(behind=True)

    def revised(self, wanted: Sequence[T]) -> List[Decision]:
        """The plan that is carried out is for these from now on: newcomers join, and others have left."""
        if self.stopping:
            return []
        joined = [ticket for ticket in wanted if ticket in self._waiting]
        parted = [ticket for ticket in self._running if ticket.stop and ticket not in wanted]
        self._take_up(joined)
        self._running = tuple(t for t in (*self._running, *joined) if t not in parted)
        self._surplus = not all(ticket.begun for ticket in wanted)
        if parted:  # a plan without them may have room
            self._refused.clear()
        left = [self._leave(ticket, "") for ticket in parted]
        return [*itertools.chain(*left), *self._interrupt()]

    def not_revised(self, wanted: Sequence[T], refusal: Refusal = NOT_SAID) -> List[Decision]:
        """No plan for these can take the place: newcomers wait, and one that leaves them stops the run."""
        if self.stopping:
            return []
        self._refused.update({ticket.order: refusal for ticket in wanted if ticket in self._waiting})
        stopped = [ticket for ticket in self._running if ticket.stop]
        if self._surplus and not stopped:
            return self._stop(self._running, Stop(StopKind.JOINED, StopKind.ANOTHER.value))
        parting = [ticket for ticket in stopped if ticket not in wanted]
        self.stopping = bool(parting)
        return [StopRun(ticket) for ticket in parting]

    def achieved(self, tickets: Sequence[T], verdict: Verdict) -> List[Decision]:
        """The goals of some of the requests that run together hold: these end now.

        Not the last one, which ends with the run, and none that is being stopped.
        """
        wanted = [ticket for ticket in tickets if ticket in self._running and ticket.stop is None]
        left = tuple(ticket for ticket in self._running if ticket not in wanted)
        if not left:
            left = tuple(wanted[-1:])
        ended, self._running = [ticket for ticket in wanted if ticket not in left], left
        decisions: List[Decision] = [AgendaAnswer(ticket, verdict) for ticket in ended]
        if all(ticket.stop for ticket in left):  # who was to leave is alone now
            return [*decisions, *self.not_revised([])]
        return [*decisions, *self._interrupt()]

    def ended(self, verdict: Verdict) -> List[Decision]:
        """The run has ended.

        :param verdict: on the run; what it means for a request depends on why that was stopped, and on
            whether another one of the run may be the reason.
        """
        members, self._running = self._running, ()
        assert members
        if not verdict.outcome.achieved:
            self._waiting.choose_anew(members)
        stopped = any(ticket.stop for ticket in members)
        divided = len(members) > 1 and verdict.outcome in APART
        # Of those that are late one may be in time.
        apart = divided or (len(members) > 1 and verdict.outcome is Outcome.LATE)
        if divided:
            self._divide(members)
        decisions: List[Decision] = []
        for ticket in members:
            of_another = verdict.outcome is Outcome.CANCEL_TIMEOUT and stopped and ticket.stop is None
            left_it = ticket.parts and verdict.outcome.achieved  # its goals were not looked at
            if apart or of_another or left_it or (verdict.outcome is Outcome.CANCELLED and stopped):
                decisions += self._leave(ticket, "" if apart else verdict.trouble)
            else:
                decisions.append(AgendaAnswer(ticket, verdict))
        return decisions

    def close(self) -> List[Decision]:
        """The Executor ends: no further request begins, and the running one stops."""
        self.closing = True
        reason = StopKind.SHUTDOWN.value
        decisions: List[Decision] = [
            AgendaAnswer(ticket, Verdict(Outcome.CANCELLED, reason)) for ticket in self._waiting.clear()
        ]
        return [*decisions, *self._stop(self._running, Stop(StopKind.SHUTDOWN))]

    # --- the rules ------------------------------------------------------------------------------------

    @property
    def _kept(self) -> str:
        """Until when a more urgent request waits for what runs; empty: that is interrupted, or stops."""
        staying = [] if self.stopping else [ticket for ticket in self._running if ticket.stop is None]
        return next((ticket.keeps for ticket in staying if ticket.keeps), "")

    @property
    def _resting(self) -> bool:
        return self.paused or self._hold

    def _ready(self) -> List[T]:
        self._waiting.look()
        return self._waiting.ready(begun_only=self.paused)

    @property
    def _under_way(self) -> bool:
        return all(ticket.under_way for ticket in self._running)

    def _group(self) -> List[T]:
        """Those that would begin together now: the first, and what follows it."""
        ready = self._ready()
        return _without_deadlines(self._following(ready[:1], ready)) or ready[:1]

    def _following(self, run: Sequence[T], ready: Sequence[T]) -> List[T]:
        """Those that may be in one plan with a run, as far as there is room for them.

        None is left out between two: that one would be overtaken.
        """
        if not run or run[0].alone or self.breakpoints.armed:
            return []
        kind = (run[0].priority, run[0].party)
        following = itertools.takewhile(lambda t: not t.alone and (t.priority, t.party) == kind, ready)
        return list(itertools.islice(following, self._together))

    def _interrupt(self) -> List[Decision]:
        """Stops what runs when something more urgent may run, or when others can join it."""
        ticket, running = next(iter(self._ready()), None), self.running
        if self._resting or ticket is None or running is None:
            return []
        if ticket.priority > running.priority:
            return [] if self._kept else self._stop(self._running, Stop(StopKind.INTERRUPTED))
        return self._join()

    def _join(self) -> List[Decision]:
        """Has a run go on with those that have come meanwhile, or begin again where its plan is not made."""
        if self._under_way:
            return [ReviseRun(ticket) for ticket in self._joined(behind=True)[-1:]]
        if self._waiting.time.line <= self._gathers_until and not self._kept and self._joined(behind=False):
            return self._stop(self._running, Stop(StopKind.JOINED))
        return []

    def _joined(self, behind: bool) -> List[T]:
        """Those that run and those that may join them next; none: no other may.

        :param behind: whether a plan behind what runs shows that all are in time; otherwise none with a
            deadline joins, nor is joined. One at a time does: it is found out which one is late.
        """
        running, newcomers = self._running, self._newcomers()
        joining = _without_deadlines(newcomers)
        if behind:
            joining = joining or newcomers[:1]
        elif any(ticket.window.is_limited for ticket in running):
            joining = []
        return [*running, *joining] if joining else []

    def _newcomers(self) -> List[T]:
        """Those that wait and may join what runs, in order."""
        running = self._running
        if not running or self._resting or any(ticket.stop for ticket in running):
            return []
        ready, overdue = self._ready(), self._waiting.is_overdue
        # A run that goes on and on with newcomers would overtake those of its own that come last.
        if any(map(overdue, running)):
            return []
        ready = [t for t in ready if overdue(t) or not self._refused.get(t.order, NOT_SAID).late]
        following = self._following(running, ready)[: max(0, self._together - len(running))]
        return list(itertools.takewhile(lambda t: t.order not in self._refused, following))

    def _take_up(self, tickets: Sequence[T]) -> None:
        """Those that wait run from now on; why they were stopped before is over."""
        for ticket in tickets:
            self._waiting.take(ticket)
            ticket.stop = None
            ticket.begun, ticket.parts = True, False

    def _part(self, ticket: T, stop: Stop) -> List[Decision]:
        """Takes one out of a run: the others go on where their plan can be exchanged."""
        stopping = self.stopping
        decisions = self._stop([ticket], stop)
        goes_on = any(each.stop is None for each in self._running)
        if not decisions or stopping or not goes_on or not self._under_way:
            return decisions
        self.stopping, ticket.parts = False, True
        return [ReviseRun(ticket)]

    def _divide(self, members: Sequence[T]) -> None:
        """Lets two halves run apart: what makes a joint run fail is found in few runs."""
        half = len(members) // 2
        for part in (members[:half], members[half:]):
            party = next(self._parties)
            for ticket in part:
                ticket.party = party

    def _leave(self, ticket: T, trouble: str) -> List[Decision]:
        """A request whose run was stopped ends, or waits again."""
        stop = ticket.stop
        if stop is not None and stop.kind is not StopKind.JOINED:
            reason = f"{STOPPED}: {stop.reason}" if stop.kind is StopKind.CLIENT_LOST else stop.reason
            reason = f"{reason}; {trouble}" if trouble else reason
            if stop.is_final:
                outcome = Outcome.LATE if stop.kind is StopKind.LATE else Outcome.CANCELLED
                return [AgendaAnswer(ticket, Verdict(outcome, reason))]
            if not ticket.resumes:
                return [AgendaAnswer(ticket, Verdict(Outcome.DROPPED, reason))]
            ticket.interrupted, ticket.begun = True, False
        if self.closing:
            return [AgendaAnswer(ticket, Verdict(Outcome.CANCELLED, StopKind.SHUTDOWN.value))]
        self._waiting.put(ticket)
        return []

    def _stop(self, tickets: Sequence[T], stop: Stop) -> List[Decision]:
        decisions: List[Decision] = []
        for ticket in tickets:
            before = ticket.stop
            if before is None or before.kind is StopKind.JOINED or (stop.is_final and not before.is_final):
                ticket.stop = stop
                decisions.append(StopRun(ticket))
        self.stopping = self.stopping or bool(decisions)
        return decisions


def _without_deadlines(tickets: Sequence[T]) -> List[T]:
    """The first of them, up to one with a deadline."""
    return list(itertools.takewhile(lambda ticket: not ticket.window.is_limited, tickets))
