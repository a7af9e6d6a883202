# SPDX-License-Identifier: Apache-2.0
"""Requests that run together, in virtual time: who joins, who ends when, and what becomes of the others."""

from typing import Dict, List, Optional, Set

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from merlin_executor.core.agenda import APART, GATHER, Agenda, AgendaAnswer, Decision, StopRun
from merlin_executor.core.outcome import Outcome, Stop, StopKind, Verdict
from merlin_executor.core.ticket import Client, Ticket
from merlin_executor.core.time_window import TimeWindow

CANCELLED = Verdict(Outcome.CANCELLED, "cancelled")
DONE = Verdict(Outcome.SUCCEEDED)
UNSOLVABLE = Verdict(Outcome.UNSOLVABLE, "the problem has no plan")
LIMIT = 60.0
MOST = 4


class Clock:
    now = 100.0

    def __call__(self) -> float:
        return self.now


class Errand(Ticket):
    under_way = False  # type: ignore[assignment]
    ends: Optional[float] = None

    def __init__(self, order: int, priority: int = 0, resumes: bool = True, **more: object) -> None:
        times = {name: more.pop(name) for name in ("not_before", "deadline") if name in more}
        super().__init__(order, priority, resumes, window=TimeWindow(**times), **more)  # type: ignore[arg-type]

    @property
    def expected_end(self) -> Optional[float]:
        return self.ends

    @property
    def text(self) -> str:
        return f"(checked room_{self.order})"


def answers(decisions: List[Decision]) -> Dict[Ticket, Verdict]:
    return {decision.ticket: decision.verdict for decision in decisions if isinstance(decision, AgendaAnswer)}


def stops(decisions: List[Decision]) -> List[int]:
    return [decision.ticket.order for decision in decisions if isinstance(decision, StopRun)]


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def agenda(clock: Clock) -> "Agenda[Errand]":
    return Agenda(clock, LIMIT, MOST)


def receive(agenda: "Agenda[Errand]", *errands: Errand) -> None:
    for errand in errands:
        assert agenda.receive(errand) == []


def begun(agenda: "Agenda[Errand]") -> List[int]:
    """Begins, and says which requests run."""
    agenda.begin()
    return [errand.order for errand in agenda.together]


def go(agenda: "Agenda[Errand]") -> None:
    """The plan is carried out from now on."""
    for errand in agenda.together:
        errand.under_way = True


def rest(agenda: "Agenda[Errand]", verdict: Verdict) -> Dict[Ticket, Verdict]:
    """The run ends."""
    for errand in agenda.together:
        errand.under_way = False
    return answers(agenda.ended(verdict))


def held(agenda: "Agenda[Errand]", *errands: Errand) -> None:
    """Requests that have come while nothing could begin."""
    agenda.pause(True)
    receive(agenda, *errands)
    agenda.pause(False)


def test_equals_that_wait_run_together_up_to_the_most(agenda: "Agenda[Errand]") -> None:
    held(agenda, *(Errand(order) for order in range(MOST + 2)))
    assert begun(agenda) == [0, 1, 2, 3]
    assert len(rest(agenda, DONE)) == MOST
    assert begun(agenda) == [4, 5]


@pytest.mark.parametrize(
    ("others", "together"),
    [
        ([Errand(1), Errand(2, alone=True), Errand(3)], [0, 1]),
        ([Errand(1), Errand(2, deadline=900.0), Errand(3)], [2]),
        ([Errand(1, priority=1), Errand(2)], [1]),
        ([Errand(1, not_before=200.0), Errand(2)], [0, 2]),
    ],
)
def test_who_is_not_joined_is_not_overtaken_either(
    agenda: "Agenda[Errand]", others: List[Errand], together: List[int]
) -> None:
    held(agenda, Errand(0), *others)
    assert begun(agenda) == together


def test_one_at_most_is_one_after_the_other(clock: Clock) -> None:
    agenda: Agenda[Errand] = Agenda(clock, LIMIT, 1)
    receive(agenda, Errand(0), Errand(1))
    assert begun(agenda) == [0]
    assert agenda.receive(Errand(2)) == []
    rest(agenda, DONE)
    assert begun(agenda) == [1]


def test_a_breakpoint_lets_one_after_the_other_begin(agenda: "Agenda[Errand]") -> None:
    agenda.breakpoints.set(["(checked room_1)"])
    held(agenda, Errand(0), Errand(1))
    assert begun(agenda) == [0]
    rest(agenda, DONE)
    assert begun(agenda) == [] and agenda.breakpoints.held == "(checked room_1)"


def test_who_comes_while_a_plan_is_made_joins_at_once(agenda: "Agenda[Errand]") -> None:
    receive(agenda, Errand(0))
    assert begun(agenda) == [0]
    assert stops(agenda.receive(Errand(1))) == [0]
    assert agenda.receive(Errand(2)) == [], "it stops already"
    assert rest(agenda, CANCELLED) == {}
    assert begun(agenda) == [0, 1, 2]
    assert all(errand.stop is None and not errand.interrupted for errand in agenda.together)


def test_a_plan_that_takes_long_is_not_made_again_for_each_newcomer(
    agenda: "Agenda[Errand]", clock: Clock
) -> None:
    receive(agenda, Errand(0))
    begun(agenda)
    clock.now += 0.9 * GATHER
    assert stops(agenda.receive(Errand(1))) == [0]
    rest(agenda, CANCELLED)
    assert begun(agenda) == [0, 1]
    clock.now += 0.9 * GATHER
    assert agenda.receive(Errand(2)) == []
    rest(agenda, DONE)
    assert begun(agenda) == [2]


def test_who_comes_while_the_plan_is_carried_out_joins_the_next_one(
    agenda: "Agenda[Errand]", clock: Clock
) -> None:
    receive(agenda, Errand(0))
    begun(agenda)
    go(agenda)
    clock.now += 10 * GATHER
    receive(agenda, Errand(1), Errand(2))
    agenda.together[0].under_way = False
    assert stops(agenda.planned_again()) == [0]
    assert rest(agenda, CANCELLED) == {}
    assert begun(agenda) == [0, 1, 2]
    go(agenda)
    assert agenda.planned_again() == []


def test_each_ends_when_its_goals_hold_and_the_last_one_with_the_run(agenda: "Agenda[Errand]") -> None:
    errands = [Errand(order) for order in range(3)]
    held(agenda, *errands)
    begun(agenda)
    assert answers(agenda.achieved([errands[1]], DONE)) == {errands[1]: DONE}
    assert agenda.achieved([errands[1]], DONE) == []
    assert answers(agenda.achieved([errands[0], errands[2]], DONE)) == {errands[0]: DONE}
    assert agenda.running is errands[2]
    assert rest(agenda, DONE) == {errands[2]: DONE}


def test_one_that_is_cancelled_leaves_the_others(agenda: "Agenda[Errand]") -> None:
    errands = [Errand(0), Errand(1, resumes=False), Errand(2)]
    held(agenda, *errands)
    begun(agenda)
    go(agenda)
    assert stops(agenda.cancel(errands[0])) == [0]
    assert agenda.achieved([errands[0]], DONE) == [], "it is being stopped"
    ended = rest(agenda, CANCELLED)
    assert list(ended) == [errands[0]] and ended[errands[0]].outcome is Outcome.CANCELLED
    assert begun(agenda) == [1, 2]


def test_the_others_of_a_run_go_on_in_a_pause(agenda: "Agenda[Errand]") -> None:
    errands = [Errand(0), Errand(1)]
    held(agenda, *errands)
    begun(agenda)
    agenda.pause(True)
    receive(agenda, Errand(2))
    agenda.cancel(errands[0])
    rest(agenda, CANCELLED)
    assert begun(agenda) == [1]
    rest(agenda, DONE)
    assert begun(agenda) == []


def test_a_client_that_is_lost_takes_only_its_own_request_along(agenda: "Agenda[Errand]") -> None:
    errands = [Errand(0), Errand(1, goes_on=False)]
    held(agenda, *errands)
    begun(agenda)
    assert stops(agenda.client(errands[1], Client.GONE, "its client /x is gone")) == [1]
    assert rest(agenda, CANCELLED)[errands[1]].reason == "cancelled: its client /x is gone"
    assert begun(agenda) == [0]


def test_what_does_not_stop_ends_the_one_that_was_cancelled_only(agenda: "Agenda[Errand]") -> None:
    errands = [Errand(0), Errand(1)]
    held(agenda, *errands)
    begun(agenda)
    agenda.cancel(errands[1])
    hung = Verdict(Outcome.CANCEL_TIMEOUT, "(drive a b) did not stop")
    assert rest(agenda, hung) == {errands[1]: hung}
    assert begun(agenda) == [0]


def test_a_more_urgent_request_interrupts_all_of_a_run(agenda: "Agenda[Errand]") -> None:
    errands = [Errand(0), Errand(1, resumes=False), Errand(2)]
    held(agenda, *errands)
    begun(agenda)
    assert stops(agenda.receive(Errand(3, priority=5))) == [0, 1, 2]
    ended = rest(agenda, CANCELLED)
    assert list(ended) == [errands[1]] and ended[errands[1]].outcome is Outcome.DROPPED
    assert begun(agenda) == [3]
    rest(agenda, DONE)
    assert begun(agenda) == [0, 2] and errands[0].interrupted


@pytest.mark.parametrize("outcome", APART)
def test_an_impossible_one_is_found_and_the_others_go_on_together(
    agenda: "Agenda[Errand]", outcome: Outcome
) -> None:
    errands = [Errand(order) for order in range(4)]
    held(agenda, *errands)
    runs, ended = [], {}  # type: ignore[var-annotated]
    for _ in range(6):
        if not begun(agenda):
            break
        runs.append([errand.order for errand in agenda.together])
        impossible = errands[2] in agenda.together
        ended.update(rest(agenda, Verdict(outcome, "no") if impossible else DONE))
    assert runs == [[0, 1, 2, 3], [0, 1], [2, 3], [2], [3]]
    assert [ended[errand].outcome for errand in errands] == [
        DONE.outcome,
        DONE.outcome,
        outcome,
        DONE.outcome,
    ]


def test_newcomers_do_not_join_what_was_divided(agenda: "Agenda[Errand]") -> None:
    held(agenda, Errand(0), Errand(1))
    begun(agenda)
    rest(agenda, UNSOLVABLE)
    assert begun(agenda) == [0]
    assert agenda.receive(Errand(2)) == []
    assert rest(agenda, DONE) and begun(agenda) == [1]
    assert rest(agenda, DONE) and begun(agenda) == [2]


def test_what_is_the_fault_of_none_of_them_ends_all(agenda: "Agenda[Errand]") -> None:
    errands = [Errand(0), Errand(1)]
    held(agenda, *errands)
    begun(agenda)
    gone = Verdict(Outcome.INTERNAL, "the dispatcher is gone")
    assert rest(agenda, gone) == {errands[0]: gone, errands[1]: gone}


def test_the_end_of_the_executor_answers_all_that_run_together(agenda: "Agenda[Errand]") -> None:
    held(agenda, Errand(0), Errand(1))
    begun(agenda)
    assert stops(agenda.close()) == [0, 1]
    reasons = [verdict.reason for verdict in rest(agenda, CANCELLED).values()]
    assert reasons == ["the executor shuts down"] * 2


def test_who_waits_is_told_for_how_many(agenda: "Agenda[Errand]") -> None:
    errands = [Errand(0), Errand(1), Errand(2, deadline=100.5)]
    held(agenda, *errands[:2])
    begun(agenda)
    go(agenda)
    receive(agenda, errands[2])
    errands[0].ends = 180.0
    assert agenda.outlook(errands[2]).late.startswith("(checked room_0) and 1 more is expected to run")


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

    def take(self, decisions: List[Decision]) -> None:
        for decision in decisions:
            ticket = decision.ticket
            if isinstance(decision, StopRun):
                assert ticket in self.agenda.together and ticket.stop is not None
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
        kept = [self.goals[ticket] for ticket in self.agenda.together]
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

    @precondition(lambda self: self.agenda.together)
    @rule()
    def dispatch(self) -> None:
        if not self.impossible(self.agenda.together):
            go(self.agenda)

    @precondition(lambda self: self.agenda.together)
    @rule()
    def plan_again(self) -> None:
        for ticket in self.agenda.together:
            ticket.under_way = False
        self.take(self.agenda.planned_again())

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
        together = self.agenda.together
        if any(ticket.stop for ticket in together) and how != "does not stop":
            verdict = CANCELLED
        elif how == "is gone" or how == "does not stop":
            verdict = Verdict(Outcome.INTERNAL if how == "is gone" else Outcome.CANCEL_TIMEOUT, "it hangs")
        elif self.impossible(together):
            verdict = UNSOLVABLE
        elif how == "fails":
            verdict = Verdict(Outcome.ACTION_FAILED, "the door is locked")
        else:
            for ticket in together:
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
