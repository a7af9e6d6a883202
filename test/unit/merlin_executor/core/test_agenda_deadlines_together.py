# SPDX-License-Identifier: Apache-2.0
"""Requests with deadlines in one plan, in virtual time: who joins, and that none is late because of it."""

import itertools
import math
from typing import Dict, List, Optional, Sequence, Tuple

import pytest
from fakes.errands import CANCELLED, DONE, LIMIT, MOST, Clock, Errand, go
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from merlin_executor.core.agenda import Agenda, AgendaAnswer, Decision, Refusal, ReviseRun, StopRun
from merlin_executor.core.outcome import Outcome, Verdict
from merlin_executor.core.ticket import Ticket

LATE = Refusal("cannot all be in time", late=True)
NOT_FOUND = Refusal("no plan for all was found in time")


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def agenda(clock: Clock) -> "Agenda[Errand]":
    return Agenda(clock, LIMIT, MOST)


def revises(decisions: List[Decision]) -> List[int]:
    assert not any(isinstance(decision, StopRun) for decision in decisions), "it would be stopped"
    return [decision.ticket.order for decision in decisions if isinstance(decision, ReviseRun)]


def driven(agenda: "Agenda[Errand]", *errands: Errand) -> None:
    """The first of these is carried out, and the others have come."""
    agenda.pause(True)
    for errand in errands:
        agenda.receive(errand)
    agenda.pause(False)
    agenda.begin()
    go(agenda)


def orders(errands: Sequence[Errand]) -> List[int]:
    return [errand.order for errand in errands]


def test_one_with_a_deadline_begins_by_itself_and_the_others_join_its_plan(agenda: "Agenda[Errand]") -> None:
    timed = Errand(2, deadline=900.0)
    driven(agenda, Errand(0), Errand(1), timed)
    assert agenda.together == [timed] and orders(agenda.revision) == [2, 0, 1]
    assert agenda.revised(agenda.revision) == [] and orders(agenda.together) == [2, 0, 1]


def test_one_that_was_interrupted_joins_like_any_other(agenda: "Agenda[Errand]") -> None:
    interrupted, timed = Errand(0), Errand(2, deadline=900.0)
    driven(agenda, interrupted)
    agenda.receive(Errand(1, 5))
    agenda.ended(CANCELLED)
    interrupted.under_way = False
    agenda.begin()
    agenda.receive(timed)
    agenda.ended(DONE)
    assert agenda.begin() is timed
    go(agenda)
    assert orders(agenda.revision) == [2, 0]
    assert agenda.revised(agenda.revision) == [] and orders(agenda.together) == [2, 0]
    go(agenda)
    assert agenda.revision == [] and not agenda.elapse()
    assert orders([answer.ticket for answer in agenda.achieved([interrupted], DONE)]) == [0]


@pytest.mark.parametrize("limited", [False, True])
def test_one_with_a_deadline_joins_what_runs(agenda: "Agenda[Errand]", clock: Clock, limited: bool) -> None:
    driven(agenda, Errand(0, **({"deadline": 900.0} if limited else {})))
    clock.now += 30.0
    assert revises(agenda.receive(Errand(1, deadline=200.0))) == [1]
    agenda.revised(agenda.revision)
    assert orders(agenda.together) == [0, 1] and agenda.next_change == 200.0


def test_those_with_deadlines_join_one_by_one_and_the_others_then_at_once(agenda: "Agenda[Errand]") -> None:
    driven(agenda, Errand(0, deadline=150.0), Errand(1), Errand(2, deadline=300.0), Errand(3, deadline=200.0))
    joined = []
    while agenda.revision:
        joined.append(orders(agenda.revision))
        agenda.revised(agenda.revision)
        go(agenda)
    assert joined == [[0, 3], [0, 3, 2], [0, 3, 2, 1]]


def test_one_whose_window_opens_joins_then(agenda: "Agenda[Errand]", clock: Clock) -> None:
    driven(agenda, Errand(0))
    assert agenda.receive(Errand(1, not_before=130.0, deadline=200.0)) == []
    assert agenda.next_change == 130.0
    clock.now = 130.0
    assert revises(agenda.elapse()) == [1]


def test_one_that_would_be_late_waits_and_keeps_no_other_one_out(agenda: "Agenda[Errand]") -> None:
    tight, later, free = Errand(1, deadline=130.0), Errand(2, deadline=300.0), Errand(3)
    driven(agenda, Errand(0, deadline=120.0), tight, later, free)
    assert revises(agenda.not_revised(agenda.revision, LATE)) == [] and orders(agenda.revision) == [0, 2]
    agenda.revised(agenda.revision)
    go(agenda)
    agenda.revised(agenda.revision)
    assert orders(agenda.together) == [0, 2, 3] and agenda.waiting == [tight]
    assert dict(agenda.outlooks())[tight].waits == "does not join (checked room_0): cannot all be in time"


def test_one_that_would_be_late_is_not_overtaken_for_ever(agenda: "Agenda[Errand]", clock: Clock) -> None:
    tight = Errand(1, deadline=130.0 + LIMIT)
    driven(agenda, Errand(0, priority=1), tight)
    clock.now += LIMIT - 10.0
    agenda.ended(DONE)
    driven(agenda, Errand(2, deadline=120.0 + LIMIT))
    agenda.not_revised(agenda.revision, LATE)
    assert revises(agenda.receive(Errand(3))) == [3]
    clock.now += 11.0
    assert agenda.revision == [] and agenda.waiting[0] is tight


def test_one_for_which_no_plan_was_found_is_not_overtaken(agenda: "Agenda[Errand]") -> None:
    driven(agenda, Errand(0), Errand(1, deadline=300.0), Errand(2, deadline=400.0), Errand(3))
    agenda.not_revised(agenda.revision, NOT_FOUND)
    assert agenda.revision == [] and revises(agenda.receive(Errand(4, deadline=500.0))) == []
    assert revises(agenda.receive(Errand(5, deadline=250.0))) == [5], "it would begin before that one"


def test_one_that_was_late_is_tried_again_when_another_one_has_left(agenda: "Agenda[Errand]") -> None:
    driven(agenda, Errand(0, deadline=120.0), Errand(1))
    agenda.revised(agenda.revision)
    go(agenda)
    assert revises(agenda.receive(Errand(2, deadline=130.0))) == [2]
    agenda.not_revised(agenda.revision, LATE)
    assert revises(agenda.cancel(agenda.together[0])) == [0]
    assert revises(agenda.revised(agenda.revision)) == [2]


def test_a_plan_for_several_that_is_late_lets_each_begin_by_itself(agenda: "Agenda[Errand]") -> None:
    driven(agenda, Errand(0, deadline=120.0), Errand(1, deadline=130.0))
    agenda.revised(agenda.revision)
    assert agenda.planned_again() == agenda.together, "an action has failed"
    assert agenda.ended(Verdict(Outcome.LATE, "cannot all be in time")) == []
    agenda.begin()
    assert orders(agenda.together) == [0]
    late = Verdict(Outcome.LATE, "needs 95.0 s")
    first = agenda.together[0]
    assert agenda.ended(late) == [AgendaAnswer(first, late)] and orders(agenda.waiting) == [1]


def test_a_plan_that_is_made_without_deadlines_takes_none_in(agenda: "Agenda[Errand]", clock: Clock) -> None:
    agenda.receive(Errand(0))
    agenda.begin()
    assert agenda.receive(Errand(1, deadline=900.0)) == [], "it is still planned"
    assert orders(agenda.planned_again()) == [0]
    go(agenda)
    assert orders(agenda.revision) == [0, 1]


# --- at random ----------------------------------------------------------------------------------------


class Stop(Errand):
    """An errand; done from when the robot has been there."""

    done = False


class Street:
    """Errands at places of a street, 1 m/s: the planner and the robot of the test.

    :ivar leg: the drive under way: the errand and when it is there; None: it stands.
    """

    def __init__(self) -> None:
        self.at: Dict[Stop, float] = {}
        self.place = 0.0
        self.leg: Optional[Tuple[Stop, float]] = None
        self.rest: List[Stop] = []  # of the plan

    def ends(self, tour: Sequence[Stop], place: float, begin: float) -> List[float]:
        """When each of them is done."""
        found = []
        for errand in tour:
            begin += abs(self.at[errand] - place)
            place = self.at[errand]
            found.append(begin)
        return found

    def behind(self, now: float) -> Tuple[float, float]:
        """Where and when what runs will have ended."""
        return (self.at[self.leg[0]], self.leg[1]) if self.leg else (self.place, now)

    def plan(self, errands: Sequence[Stop], now: float, bound: Sequence[Stop]) -> Optional[List[Stop]]:
        """The shortest plan behind what runs that keeps the deadlines of some; None: there is none."""
        place, begin = self.behind(now)
        left = [errand for errand in errands if not errand.done and not (self.leg and errand is self.leg[0])]
        tours = [
            (ends[-1] if ends else 0.0, number, list(tour))
            for number, tour in enumerate(itertools.permutations(left))
            for ends in [self.ends(tour, place, begin)]
            if all(end <= each.window.deadline for each, end in zip(tour, ends) if each in bound)
        ]
        return min(tours)[2] if tours else None

    def take(self, plan: List[Stop], now: float) -> None:
        """This is the rest of the plan from now on."""
        place, begin = self.behind(now)
        self.rest = plan
        for errand, end in zip(plan, self.ends(plan, place, begin)):
            errand.ends = end
        if self.leg is not None:
            self.leg[0].ends = self.leg[1]


class StreetAgenda(RuleBasedStateMachine):
    """Arrivals with deadlines, joins, ends and cancels in any order; the robot drives meanwhile."""

    def __init__(self) -> None:
        super().__init__()
        self.clock = Clock()
        self.agenda: Agenda[Stop] = Agenda(self.clock, LIMIT, MOST)
        self.street = Street()
        self.tickets: List[Stop] = []
        self.answered: Dict[Ticket, Verdict] = {}
        self.ready: Dict[Ticket, float] = {}  # since when a request could begin
        self.on_time: set = set()  # that were on time when they began or joined

    def take(self, decisions: List[Decision]) -> None:
        for decision in decisions:
            if isinstance(decision, AgendaAnswer):
                assert decision.ticket not in self.answered, "answered twice"
                self.answered[decision.ticket] = decision.verdict
                if decision.verdict.outcome.achieved:
                    assert decision.ticket.done, "succeeded, and its goals do not hold"  # type: ignore[attr-defined]
                if decision.verdict.outcome is Outcome.LATE:
                    assert decision.ticket not in self.on_time, "a join has made it late"
        for ticket in self.agenda.waiting:
            if ticket.window.not_before <= self.clock.now:
                self.ready.setdefault(ticket, self.clock.now)

    @rule(
        place=st.integers(-30, 30),
        window=st.sampled_from([None, 15, 30, 60, 120]),
        later=st.sampled_from([0, 0, 20]),
    )
    def receive(self, place: int, window: Optional[int], later: int) -> None:
        begin = self.clock.now + later
        times = {"not_before": begin} if later else {}
        if window is not None:
            times["deadline"] = begin + window + 0.5
        ticket = Stop(len(self.tickets), **times)  # type: ignore[arg-type]
        self.tickets.append(ticket)
        self.street.at[ticket] = float(place)
        self.take(self.agenda.receive(ticket))

    @precondition(lambda self: not self.agenda.together)
    @rule()
    def begin(self) -> None:
        """The first one runs, with those that have no deadlines; one that is late all the same, too."""
        if self.agenda.begin() is None:
            return
        self.follows_the_order(self.agenda.together)
        plan = self.street.plan(self.agenda.together, self.clock.now, [])
        assert plan is not None
        self.street.take(plan, self.clock.now)
        self.on_time |= {errand for errand in plan if self.is_on_time(errand)}
        go(self.agenda)

    def is_on_time(self, errand: Stop) -> bool:
        return errand.ends is not None and errand.ends <= errand.window.deadline

    def follows_the_order(self, begun: Sequence[Stop]) -> None:
        """Of those that have waited for long, none is overtaken."""
        for other in self.agenda.waiting:
            if other.window.is_open(self.clock.now) and self.clock.now - self.ready[other] > LIMIT:
                assert all(self.ready[each] <= self.ready[other] for each in begun), "overtaken"

    @precondition(lambda self: self.agenda.together and self.agenda.revision)
    @rule(found=st.sampled_from([True, True, True, False]))
    def revise(self, found: bool) -> None:
        """The planner answers; sometimes it finds nothing."""
        wanted, together = self.agenda.revision, self.agenda.together
        leaves = any(ticket.stop for ticket in together)
        bound = [each for each in wanted if each not in together or self.is_on_time(each)]
        leg, self.street.leg = self.street.leg, None if self.kept(wanted) is None else self.street.leg
        plan = self.street.plan(wanted, self.clock.now, bound)
        if not found or plan is None:
            self.street.leg = leg
            self.take(self.agenda.not_revised(wanted, LATE if found else NOT_FOUND))
            return
        self.street.take(plan, self.clock.now)
        newcomers = [each for each in wanted if each not in together]
        assert all(map(self.is_on_time, newcomers))
        self.on_time |= set(newcomers)
        if leaves:  # without the drive of the one that leaves the others may be later
            self.on_time -= {each for each in wanted if not self.is_on_time(each)}
        self.take(self.agenda.revised(wanted))
        if not leaves:
            self.follows_the_order(newcomers)
        go(self.agenda)
        self.take(self.agenda.achieved([each for each in wanted if each.done], DONE))

    def kept(self, wanted: Sequence[Stop]) -> Optional[Stop]:
        leg = self.street.leg
        return leg[0] if leg is not None and leg[0] in wanted else None

    @precondition(lambda self: self.agenda.together)
    @rule(steps=st.integers(1, 6))
    def drive(self, steps: int) -> None:
        """Time passes, and the robot follows its plan."""
        for _ in range(steps):
            self.end_if_done()
            if not self.agenda.together or self.agenda.stopping:
                return
            if self.street.leg is None:
                if not self.street.rest:
                    return
                errand = self.street.rest.pop(0)
                distance = abs(self.street.at[errand] - self.street.place)
                self.street.leg = errand, self.clock.now + distance
            errand, end = self.street.leg
            self.step_to(min(end, self.clock.now + 10.0))
            if self.clock.now >= end and self.street.leg is not None and not self.agenda.stopping:
                self.street.place, self.street.leg = self.street.at[errand], None
                errand.done = True
                self.take(self.agenda.achieved([errand], DONE))

    def step_to(self, now: float) -> None:
        while True:
            change = self.agenda.next_change
            if change is None or change > now:
                break
            self.clock.now = max(change, self.clock.now)
            before = self.agenda.next_change
            self.take(self.agenda.elapse())
            if self.agenda.next_change == before:
                break
        self.clock.now = max(now, self.clock.now)
        self.take(self.agenda.elapse())

    def end_if_done(self) -> None:
        """The plan ends when all is done; that does not wait for another one."""
        together = self.agenda.together
        goes_on = self.street.rest or self.street.leg or self.agenda.stopping
        if together and not goes_on and all(each.done for each in together if each.stop is None):
            if self.agenda.revision:
                self.take(self.agenda.not_revised(self.agenda.revision, NOT_FOUND))
            self.finish(DONE)

    @precondition(lambda self: self.agenda.together and self.agenda.stopping)
    @rule()
    def stopped(self) -> None:
        """What runs has stopped on its way."""
        self.on_time -= set(self.agenda.together)  # planned again from elsewhere
        self.finish(CANCELLED)

    def finish(self, verdict: Verdict) -> None:
        if self.street.leg is not None:
            self.street.place, self.street.leg = self.street.at[self.street.leg[0]] - 1.0, None
        self.street.rest = []
        for ticket in self.agenda.together:
            ticket.under_way, ticket.ends = False, None
        self.take(self.agenda.ended(verdict))

    @precondition(lambda self: self.tickets)
    @rule(number=st.integers(0, 30))
    def cancel(self, number: int) -> None:
        ticket = self.tickets[number % len(self.tickets)]
        self.take(self.agenda.cancel(ticket))

    @precondition(lambda self: not self.agenda.together)
    @rule(step=st.floats(0.0, 90.0))
    def pass_time(self, step: float) -> None:
        self.step_to(self.clock.now + step)

    @invariant()
    def no_request_is_lost(self) -> None:
        for ticket in self.tickets:
            places = [ticket in self.agenda.waiting, ticket in self.agenda.together, ticket in self.answered]
            assert places.count(True) == 1, places

    @invariant()
    def what_may_end_later_has_an_alarm(self) -> None:
        change = self.agenda.next_change
        limited = [t.window.deadline for t in (*self.agenda.waiting, *self.agenda.together) if not t.stop]
        assert min(limited, default=math.inf) == math.inf or (change is not None and change <= min(limited))

    def teardown(self) -> None:
        """Without further arrivals everything is answered."""
        for _ in range(12 * len(self.tickets) + 12):
            if not self.agenda.together:
                self.pass_time(20.0)
                self.begin()
            elif self.agenda.stopping:
                self.stopped()
            elif self.agenda.revision:
                self.revise(True)
            else:
                self.drive(6)
        assert set(self.answered) == set(self.tickets)


StreetAgenda.TestCase.settings = settings(max_examples=100, stateful_step_count=40, deadline=None)
test_any_order_of_arrivals_with_deadlines = StreetAgenda.TestCase
