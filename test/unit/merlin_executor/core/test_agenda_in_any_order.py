# SPDX-License-Identifier: Apache-2.0
"""Requests that run together, join and leave in any order, in virtual time."""

from typing import Dict, List, Optional, Set

from fakes.errands import CANCELLED, DONE, LIMIT, MOST, UNSOLVABLE, Clock, Errand, go
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from merlin_executor.core.agenda import Agenda, Decision, ReviseRun, StopRun
from merlin_executor.core.outcome import Outcome, Stop, StopKind, Verdict
from merlin_executor.core.ticket import Ticket

GOALS = 6


class TogetherWorld(RuleBasedStateMachine):
    """Arrivals, ends, cancels, goals that come true and failures in any order, over a knowledge base.

    Goal 0 is impossible; goals 1 and 2 exclude each other.
    """

    def __init__(self) -> None:
        super().__init__()
        self.clock = Clock()
        self.agenda: Agenda[Errand] = Agenda(self.clock, LIMIT, MOST)
        self.tickets: List[Errand] = []
        self.goals: Dict[Ticket, Set[int]] = {}
        self.true: Set[int] = set()
        self.stored: Set[int] = set()
        self.answered: Dict[Ticket, Verdict] = {}
        self.ready: Dict[Ticket, float] = {}
        self.plan_for: List[Errand] = []
        self.revising: Optional[List[Errand]] = None  # for which another plan is being made

    def take(self, decisions: List[Decision]) -> None:
        for decision in decisions:
            ticket = decision.ticket
            if isinstance(decision, StopRun):
                assert ticket in self.agenda.together and ticket.stop is not None
                continue
            if isinstance(decision, ReviseRun):
                assert self.agenda.revision or self.agenda.stopping  # because of what came with it
                continue
            assert ticket not in self.answered, "answered twice"
            self.answered[ticket] = decision.verdict
            if decision.verdict.outcome.achieved:
                assert self.goals[ticket] <= self.true, "succeeded, and its goals do not hold"
            if decision.verdict.outcome is Outcome.UNSOLVABLE:
                assert self.impossible([ticket]), "the fault of another one"
        for ticket in self.agenda.waiting:
            if ticket.window.not_before <= self.clock.now:
                self.ready.setdefault(ticket, self.clock.now)
        kept = [self.goals[ticket] for ticket in (*self.agenda.together, *(self.revising or ()))]
        self.stored &= set().union(*kept) if kept else set()

    def impossible(self, tickets: List[Ticket]) -> bool:
        wanted = set().union(*(self.goals[ticket] for ticket in tickets))
        return bool(({0} & wanted) - self.true) or {1, 2} <= wanted

    @rule(
        priority=st.sampled_from([0, 0, 0, 1]),
        resumes=st.booleans(),
        alone=st.sampled_from([False, False, False, True]),
        later=st.sampled_from([0.0, 0.0, 0.0, 5.0]),
        wanted=st.sets(st.integers(0, GOALS - 1), min_size=1, max_size=2),
    )
    def receive(self, priority: int, resumes: bool, alone: bool, later: float, wanted: Set[int]) -> None:
        ticket = Errand(
            len(self.tickets),
            priority,
            resumes,
            alone=alone,
            not_before=self.clock.now + later if later else 0.0,
        )
        self.tickets.append(ticket)
        self.goals[ticket] = wanted
        self.take([*self.agenda.elapse(), *self.agenda.receive(ticket)])

    @precondition(lambda self: self.tickets)
    @rule(number=st.integers(0, 30), stop=st.sampled_from([StopKind.CANCELLED, StopKind.CLIENT_LOST]))
    def cancel(self, number: int, stop: StopKind) -> None:
        ticket = self.tickets[number % len(self.tickets)]
        self.take(self.agenda.cancel(ticket, Stop(stop)))

    @rule(step=st.floats(0.0, 40.0))
    def pass_time(self, step: float) -> None:
        self.clock.now += step
        self.take(self.agenda.elapse())

    @rule(paused=st.booleans())
    def pause(self, paused: bool) -> None:
        self.take(self.agenda.pause(paused))

    @precondition(lambda self: not self.agenda.together)
    @rule()
    def begin(self) -> None:
        self.agenda.begin()
        together = self.agenda.together
        assert len(together) <= MOST
        if not together:
            return
        assert len({(ticket.priority, ticket.party) for ticket in together}) == 1
        assert len(together) == 1 or not any(ticket.alone for ticket in together)
        for ticket in together:
            assert ticket not in self.answered and ticket.stop is None
            assert ticket.window.not_before <= self.clock.now
            for other in self.agenda.waiting:
                if other.priority == ticket.priority and other.window.is_open(self.clock.now):
                    overdue = self.clock.now - self.ready[other] >= LIMIT + 0.001
                    assert not overdue or self.ready[ticket] <= self.ready[other], "overtaken for too long"
        self.stored |= set().union(*(self.goals[ticket] for ticket in together))
        self.plan_for = together

    @precondition(lambda self: self.agenda.together)
    @rule()
    def dispatch(self) -> None:
        if not self.impossible(self.agenda.together):
            go(self.agenda)

    @precondition(lambda self: self.agenda.together)
    @rule()
    def plan_again(self) -> None:
        self.close_revision()
        for ticket in self.agenda.together:
            ticket.under_way = False
        if any(ticket.stop for ticket in self.agenda.together):
            return
        self.take(self.agenda.revised(self.agenda.planned_again()))
        self.stored |= set().union(*(self.goals[ticket] for ticket in self.agenda.together))
        self.plan_for = self.agenda.together

    @precondition(lambda self: self.revising is None and self.agenda.together and self.agenda.revision)
    @rule()
    def begin_revision(self) -> None:
        self.revising = self.agenda.revision
        assert len(self.revising) <= MOST
        self.stored |= set().union(*(self.goals[ticket] for ticket in self.revising))

    @precondition(lambda self: self.revising is not None)
    @rule(exchanged=st.sampled_from([True, True, False]))
    def end_revision(self, exchanged: bool) -> None:
        """Whatever has happened since it began."""
        assert self.revising is not None
        wanted, self.revising = self.revising, None
        if exchanged and not self.impossible(wanted):  # type: ignore[arg-type]
            self.plan_for = wanted
            decisions = self.agenda.revised(wanted)
        else:
            decisions = self.agenda.not_revised(wanted)
        go(self.agenda)
        self.take(decisions)

    def close_revision(self) -> None:
        """The dispatch has ended."""
        self.revising = None
        wanted = self.agenda.revision if self.agenda.together else []
        if wanted:
            self.take(self.agenda.not_revised(wanted))

    @rule(goal=st.integers(1, GOALS - 1), holds=st.booleans())
    def world(self, goal: int, holds: bool) -> None:
        """The world changes."""
        self.change(goal, holds)

    def change(self, goal: int, holds: bool) -> None:
        self.true -= {goal, 3 - goal}
        if holds:
            self.true.add(goal)

    @precondition(lambda self: self.agenda.together)
    @rule()
    def look(self) -> None:
        found = [ticket for ticket in self.agenda.together if self.goals[ticket] <= self.true]
        self.take(self.agenda.achieved(found, DONE))
        assert self.agenda.together

    @precondition(lambda self: self.agenda.together)
    @rule(how=st.sampled_from(["succeeds", "stops", "does not stop", "fails", "is gone"]))
    def end(self, how: str) -> None:
        self.close_revision()
        together = self.agenda.together
        stay = {ticket for ticket in together if ticket.stop is None}
        if (
            any(ticket.stop for ticket in together)
            and how != "does not stop"
            and not (how == "succeeds" and stay)
        ):
            verdict = CANCELLED
        elif how == "is gone" or how == "does not stop":
            verdict = Verdict(Outcome.INTERNAL if how == "is gone" else Outcome.CANCEL_TIMEOUT, "it hangs")
        elif self.impossible(together):
            verdict = UNSOLVABLE
        elif how == "fails":
            verdict = Verdict(Outcome.ACTION_FAILED, "the door is locked")
        else:
            assert stay <= set(self.plan_for), "the plan is not for one of them"
            for ticket in self.plan_for:
                for goal in self.goals[ticket]:
                    self.change(goal, True)
            verdict = DONE
        for ticket in together:
            ticket.under_way = False
        self.take(self.agenda.ended(verdict))

    @invariant()
    def no_request_is_lost(self) -> None:
        for ticket in self.tickets:
            places = [ticket in self.agenda.waiting, ticket in self.agenda.together, ticket in self.answered]
            assert places.count(True) == 1, places

    @invariant()
    def no_goal_outlives_its_requests(self) -> None:
        alive = [self.goals[ticket] for ticket in self.tickets if ticket not in self.answered]
        alive += [self.goals[ticket] for ticket in self.revising or ()]
        assert self.stored <= (set().union(*alive) if alive else set())

    @invariant()
    def nothing_more_urgent_waits_than_runs(self) -> None:
        together = self.agenda.together
        if together and not any(ticket.stop for ticket in together) and not self.agenda.paused:
            now = self.clock.now
            ready = [ticket.priority for ticket in self.agenda.waiting if ticket.window.is_open(now)]
            assert max(ready, default=together[0].priority) <= together[0].priority

    def teardown(self) -> None:
        """Without further arrivals everything is answered, in a bounded number of runs."""
        self.take(self.agenda.pause(False))
        self.pass_time(10.0)
        for _ in range(8 * len(self.tickets) + 8):
            if self.agenda.together:
                self.end("succeeds")
            else:
                self.begin()
        assert set(self.answered) == set(self.tickets)


TogetherWorld.TestCase.settings = settings(max_examples=200, stateful_step_count=50, deadline=None)
test_any_order_of_events = TogetherWorld.TestCase
