# SPDX-License-Identifier: Apache-2.0
"""Requests with times, in virtual time: which begins when, what is late, and what can be expected."""

import math
from typing import Dict, List, Optional

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from merlin_executor.core.agenda import Agenda, AgendaAnswer, Decision, StopRun
from merlin_executor.core.outcome import Outcome, Stop, StopKind, Verdict
from merlin_executor.core.ticket import Ticket
from merlin_executor.core.time_window import Forecast, Outlook, PlanTimes, TimeWindow, outlook_running

CANCELLED = Verdict(Outcome.CANCELLED, "cancelled")
DONE = Verdict(Outcome.SUCCEEDED)
LIMIT = 60.0


class Clock:
    now = 100.0

    def __call__(self) -> float:
        return self.now


class Errand(Ticket):
    text = "(checked kitchen)"

    def __init__(self, order: int, priority: int = 0, resumes: bool = True, **times: float) -> None:
        super().__init__(order, priority, resumes, window=TimeWindow(**times))
        self.ends: Optional[float] = None

    @property
    def expected_end(self) -> Optional[float]:
        return self.ends


def answers(decisions: List[Decision]) -> Dict[Ticket, Verdict]:
    return {decision.ticket: decision.verdict for decision in decisions if isinstance(decision, AgendaAnswer)}


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def agenda(clock: Clock) -> "Agenda[Errand]":
    return Agenda(clock, LIMIT)


def order_of(agenda: "Agenda[Errand]") -> List[int]:
    """Begins and ends all that may begin now."""
    begun = []
    ticket = agenda.begin()
    while ticket is not None:
        begun.append(ticket.order)
        agenda.ended(DONE)
        ticket = agenda.begin()
    return begun


def test_what_may_not_begin_yet_waits_and_keeps_no_other(agenda: "Agenda[Errand]", clock: Clock) -> None:
    agenda.receive(Errand(0, priority=5, not_before=130.0))
    agenda.receive(Errand(1))
    assert order_of(agenda) == [1]
    assert agenda.next_change == 130.0
    clock.now = 130.0
    agenda.elapse()
    assert order_of(agenda) == [0] and agenda.next_change is None


def test_an_urgent_request_interrupts_when_its_time_has_come(agenda: "Agenda[Errand]", clock: Clock) -> None:
    first, urgent = Errand(0), Errand(1, priority=5, not_before=130.0)
    agenda.receive(first)
    assert agenda.begin() is first
    assert agenda.receive(urgent) == []
    clock.now = 130.0
    assert agenda.elapse() == [StopRun(first)]
    assert agenda.ended(CANCELLED) == [] and agenda.begin() is urgent


def test_of_equals_the_earliest_deadline_begins_first(agenda: "Agenda[Errand]") -> None:
    for order, deadline in enumerate([math.inf, 300.0, 200.0, 300.0, math.inf]):
        agenda.receive(Errand(order, deadline=deadline))
    agenda.receive(Errand(5, priority=1))
    assert order_of(agenda) == [5, 2, 1, 3, 0, 4]


def test_nothing_is_overtaken_for_longer_than_the_limit(agenda: "Agenda[Errand]", clock: Clock) -> None:
    running, patient = Errand(0), Errand(1)
    agenda.receive(running)
    agenda.begin()
    agenda.receive(patient)
    clock.now += LIMIT - 1.0
    agenda.receive(Errand(2, deadline=clock.now + 10.0))
    assert agenda.waiting[0].order == 2
    clock.now += 1.0
    agenda.receive(Errand(3, deadline=clock.now + 10.0))
    agenda.ended(DONE)
    assert order_of(agenda) == [1, 2, 3]


def test_the_time_for_which_a_request_is_overtaken_begins_when_it_may_begin(
    agenda: "Agenda[Errand]", clock: Clock
) -> None:
    agenda.receive(Errand(0, not_before=100.0 + 2 * LIMIT))
    clock.now += 2 * LIMIT
    agenda.receive(Errand(1, deadline=clock.now + 10.0))
    assert order_of(agenda) == [1, 0]


def test_a_waiting_request_ends_when_its_deadline_passes(agenda: "Agenda[Errand]", clock: Clock) -> None:
    agenda.receive(Errand(0))
    agenda.begin()
    late = Errand(1, deadline=110.0)
    agenda.receive(late)
    assert agenda.next_change == 110.0 and agenda.elapse() == []
    clock.now = 110.0
    missed = "late: its goals do not hold by its deadline 110.0 s"
    assert answers(agenda.elapse()) == {late: Verdict(Outcome.LATE, missed)}
    assert agenda.waiting == [] and agenda.next_change is None


def test_what_is_late_does_not_begin_before_it_is_reported(agenda: "Agenda[Errand]", clock: Clock) -> None:
    late = Errand(0, deadline=110.0)
    agenda.receive(late)
    clock.now = 111.0
    assert agenda.begin() is None and agenda.next_change == 110.0
    assert answers(agenda.elapse())[late].outcome is Outcome.LATE


def test_a_running_request_is_stopped_at_its_deadline(agenda: "Agenda[Errand]", clock: Clock) -> None:
    late = Errand(0, deadline=110.0)
    agenda.receive(late)
    agenda.begin()
    clock.now = 110.0
    assert agenda.elapse() == [StopRun(late)]
    assert agenda.elapse() == [] and agenda.next_change is None
    assert answers(agenda.ended(CANCELLED))[late].outcome is Outcome.LATE


def test_goals_that_hold_in_the_moment_of_the_deadline_hold(agenda: "Agenda[Errand]", clock: Clock) -> None:
    ticket = Errand(0, deadline=110.0)
    agenda.receive(ticket)
    agenda.begin()
    clock.now = 110.0
    agenda.elapse()
    assert answers(agenda.ended(DONE))[ticket].outcome is Outcome.SUCCEEDED


@pytest.mark.parametrize("deadline_first", [True, False])
def test_an_interrupted_request_ends_at_its_deadline(
    agenda: "Agenda[Errand]", clock: Clock, deadline_first: bool
) -> None:
    late, urgent = Errand(0, deadline=110.0), Errand(1, priority=3)
    agenda.receive(late)
    agenda.begin()
    assert agenda.receive(urgent) == [StopRun(late)]
    verdicts = {}
    if not deadline_first:
        assert agenda.ended(CANCELLED) == []
    clock.now = 110.0
    verdicts.update(answers(agenda.elapse()))
    if deadline_first:
        verdicts.update(answers(agenda.ended(CANCELLED)))
    assert verdicts[late].outcome is Outcome.LATE
    assert agenda.begin() is urgent


def test_a_cancel_before_the_deadline_stays_a_cancel(agenda: "Agenda[Errand]", clock: Clock) -> None:
    ticket = Errand(0, deadline=110.0)
    agenda.receive(ticket)
    agenda.begin()
    agenda.cancel(ticket, Stop(StopKind.CANCELLED))
    clock.now = 110.0
    assert agenda.elapse() == []
    assert answers(agenda.ended(CANCELLED))[ticket].outcome is Outcome.CANCELLED


@pytest.mark.parametrize(
    ("times", "why"),
    [
        ({"deadline": 14.0}, "its deadline 14.0 s passed 86 s ago"),
        ({"deadline": 100.0}, "its deadline 100.0 s passed 0 s ago"),
        (
            {"not_before": 130.0, "deadline": 130.0},
            "its deadline 130.0 s is not after 130.0 s, when it may begin",
        ),
    ],
)
def test_a_window_that_leaves_no_time_is_refused(
    agenda: "Agenda[Errand]", times: Dict[str, float], why: str
) -> None:
    ticket = Errand(0, **times)
    assert answers(agenda.receive(ticket)) == {ticket: Verdict(Outcome.REFUSED, why)}
    assert agenda.waiting == [] and agenda.next_change is None


def test_a_clock_that_is_set_back_lets_nothing_begin_early(agenda: "Agenda[Errand]", clock: Clock) -> None:
    agenda.receive(Errand(0, not_before=130.0))
    clock.now = 130.0
    agenda.pause(True)
    agenda.elapse()
    clock.now = 50.0
    agenda.pause(False)
    assert agenda.begin() is None and agenda.next_change == 130.0


def test_what_can_be_expected_of_the_requests(agenda: "Agenda[Errand]") -> None:
    running, soon, later = Errand(0), Errand(1, deadline=190.0), Errand(2, deadline=200.0)
    urgent = Errand(3, priority=5, not_before=150.0, deadline=190.0)
    for ticket in (running, soon, later, urgent):
        agenda.receive(ticket)
        agenda.begin()
    assert dict(agenda.outlooks())[soon] == Outlook(), "the end of what runs is not known"
    running.ends = 180.0
    assert dict(agenda.outlooks())[soon] == Outlook(begin=180.0)
    assert dict(agenda.outlooks())[later] == Outlook(), "how long the one before takes is not known"
    running.ends = 195.0
    late = "(checked kitchen) is expected to run until 195.0 s, and the deadline of this one is 190.0 s"
    assert dict(agenda.outlooks())[soon] == Outlook(195.0, late=late)
    assert not dict(agenda.outlooks())[later].late
    assert not dict(agenda.outlooks())[urgent].late, "it interrupts"
    agenda.ended(DONE)
    order_of(agenda)
    assert dict(agenda.outlooks())[urgent] == Outlook(begin=150.0)


def test_the_end_of_a_plan_is_expected_later_when_its_actions_begin_late() -> None:
    times = PlanTimes()
    assert times.end(100.0) is None
    times.begin([(0, 0.0, 20.0), (1, 20.0, 5.0)], 100.0)
    assert times.end(100.0) == 125.0
    times.dispatched([(1, 130.0), (7, 500.0)])
    assert times.end(130.0) == 135.0
    times.dispatched([])
    assert times.end(130.0) == 135.0, "between two actions"
    late = "its plan is expected to end at 135.0 s, after its deadline 130.0 s"
    assert outlook_running(TimeWindow(deadline=130.0), times.end(130.0)) == Outlook(end=135.0, late=late)
    assert outlook_running(TimeWindow(deadline=135.0), times.end(130.0)) == Outlook(end=135.0)
    times.begin([(0, 0.0, 0.001)], 100.0)
    assert times.end(100.0) is None, "a plan without durations"
    times.begin([], 100.0)
    assert times.end(100.0) is None


def test_an_action_that_takes_longer_than_planned_makes_the_end_later_at_once() -> None:
    times = PlanTimes()
    times.begin([(0, 0.0, 20.0), (1, 0.0, 10.0), (2, 20.0, 5.0)], 100.0)
    times.dispatched([(0, 100.0), (1, 100.0)])
    assert [times.end(now) for now in (100.0, 110.0, 111.0, 130.0)] == [125.0, 125.0, 126.0, 145.0]
    times.dispatched([(0, 100.0)])
    assert [times.end(now) for now in (111.0, 120.0, 121.0, 130.0)] == [125.0, 125.0, 126.0, 135.0]
    times.dispatched([])
    assert [times.end(now) for now in (124.0, 126.0)] == [125.0, 126.0], "never in the past"


@settings(max_examples=100, deadline=None)
@given(st.lists(st.tuples(st.integers(-1, 1), st.floats(-50.0, 50.0), st.booleans()), max_size=20))
def test_without_times_the_order_is_that_of_priority_and_arrival(events: list) -> None:
    clock = Clock()
    agenda: Agenda[Errand] = Agenda(clock, 5.0)
    for order, (priority, step, begins) in enumerate(events):
        agenda.receive(Errand(order, priority))
        clock.now = max(0.0, clock.now + step)
        agenda.elapse()
        if begins and agenda.begin() is not None:
            agenda.ended(CANCELLED if agenda.running.stop else DONE)  # type: ignore[union-attr]
        waiting = agenda.waiting
        assert waiting == sorted(waiting, key=lambda ticket: (-ticket.priority, ticket.order))
        assert agenda.next_change is None


OFFSETS = st.one_of(st.none(), st.integers(-20, 200))


class TimedAgenda(RuleBasedStateMachine):
    """Arrivals, ends, cancels and steps of the clock in any order; the alarm rings as it is set."""

    def __init__(self) -> None:
        super().__init__()
        self.clock = Clock()
        self.agenda: Agenda[Errand] = Agenda(self.clock, LIMIT)
        self.tickets: List[Errand] = []
        self.answered: Dict[Ticket, Verdict] = {}
        self.elapsed = 0.0
        self.ready: Dict[Ticket, float] = {}  # by `elapsed`, since when a request could begin

    def take(self, decisions: List[Decision]) -> None:
        for ticket, verdict in answers(decisions).items():
            assert ticket not in self.answered, "answered twice"
            self.answered[ticket] = verdict
            if verdict.outcome is Outcome.LATE:
                assert ticket.window.deadline <= self.clock.now
        for ticket in self.agenda.waiting:
            if ticket.window.not_before <= self.clock.now:
                self.ready.setdefault(ticket, self.elapsed)

    @rule(priority=st.integers(0, 1), resumes=st.booleans(), begin=OFFSETS, end=OFFSETS)
    def receive(self, priority: int, resumes: bool, begin: Optional[int], end: Optional[int]) -> None:
        times = {} if begin is None else {"not_before": self.clock.now + begin}
        if end is not None:
            times["deadline"] = self.clock.now + end
        ticket = Errand(len(self.tickets), priority, resumes, **times)
        self.tickets.append(ticket)
        self.take([*self.agenda.elapse(), *self.agenda.receive(ticket)])

    @precondition(lambda self: self.tickets)
    @rule(number=st.integers(0, 30))
    def cancel(self, number: int) -> None:
        ticket = self.tickets[number % len(self.tickets)]
        self.take([*self.agenda.elapse(), *self.agenda.cancel(ticket)])

    @rule(step=st.floats(0.0, 90.0))
    def pass_time(self, step: float) -> None:
        end = self.clock.now + step
        change = self.agenda.next_change
        while change is not None and change <= end:
            self.step_to(max(change, self.clock.now))
            self.take(self.agenda.elapse())
            change = self.agenda.next_change
            assert change is None or change > self.clock.now, "the alarm would ring for ever"
        self.step_to(end)
        self.take(self.agenda.elapse())

    def step_to(self, now: float) -> None:
        self.elapsed += now - self.clock.now
        self.clock.now = now

    @rule(step=st.floats(-100.0, 0.0))
    def set_back(self, step: float) -> None:
        self.clock.now = max(0.0, self.clock.now + step)
        self.take(self.agenda.elapse())

    @rule()
    def begin(self) -> None:
        before = self.agenda.running
        ticket = self.agenda.begin()
        if ticket is None:
            return
        assert before is None and ticket not in self.answered
        assert ticket.window.not_before <= self.clock.now < ticket.window.deadline
        for other in self.agenda.waiting:
            if other.priority == ticket.priority and other.window.is_open(self.clock.now):
                overdue = self.elapsed - self.ready[other] >= LIMIT + 0.001
                assert not overdue or self.ready[ticket] <= self.ready[other], "overtaken for too long"

    @precondition(lambda self: self.agenda.running is not None)
    @rule(succeeds=st.booleans())
    def end(self, succeeds: bool) -> None:
        running = self.agenda.running
        assert running is not None
        self.take(self.agenda.ended(DONE if succeeds or running.stop is None else CANCELLED))

    @invariant()
    def no_request_is_lost(self) -> None:
        for ticket in self.tickets:
            places = [
                ticket in self.agenda.waiting,
                ticket is self.agenda.running,
                ticket in self.answered,
            ]
            assert places.count(True) == 1, places

    @invariant()
    def what_may_end_or_begin_later_has_an_alarm(self) -> None:
        change = self.agenda.next_change
        times = [ticket.window.deadline for ticket in self.agenda.waiting]
        if any(time < math.inf for time in times):
            assert change is not None and change <= min(times)

    def teardown(self) -> None:
        """In the end everything is answered."""
        self.take(self.agenda.close())
        if self.agenda.running is not None:
            self.take(self.agenda.ended(CANCELLED))
        assert set(self.answered) == set(self.tickets)


TimedAgenda.TestCase.settings = settings(max_examples=150, stateful_step_count=40, deadline=None)
test_any_order_of_events_and_times = TimedAgenda.TestCase


def test_what_is_planned_ahead_says_when_each_request_ends(agenda: "Agenda[Errand]") -> None:
    running, first = Errand(0), Errand(1, deadline=190.0)
    second, third = Errand(2, deadline=230.0), Errand(3, deadline=240.0)
    for ticket in (running, first, second, third):
        agenda.receive(ticket)
        agenda.begin()
    running.ends = 150.0
    assert agenda.lines() == [(first, (0,)), (second, (0, 1)), (third, (0, 1, 2))]
    first.forecast = Forecast((0,), 30.0)
    second.forecast = Forecast((0, 1), 40.0)
    assert dict(agenda.outlooks())[first] == Outlook(150.0, 180.0)
    assert dict(agenda.outlooks())[second] == Outlook(180.0, 220.0)
    assert dict(agenda.outlooks())[third] == Outlook(), "it is not planned yet"
    third.forecast = Forecast((0, 1, 2), 0.5)
    assert dict(agenda.outlooks())[third] == Outlook(220.0, 220.5)
    running.ends = 165.0
    late = "it is expected to begin at 165.0 s and takes 30 s, and its deadline is 190.0 s"
    assert dict(agenda.outlooks())[first] == Outlook(165.0, 195.0, late)
    assert dict(agenda.outlooks())[second] == Outlook(
        195.0, 235.0, late.replace("165", "195").replace("30 s", "40 s").replace("190", "230")
    )
    agenda.ended(DONE)
    agenda.begin()
    first.ends = 170.0
    assert dict(agenda.outlooks())[second] == Outlook(170.0, 210.0), "what ran has ended as planned"
    urgent = Errand(4, priority=1, not_before=180.0, deadline=400.0)
    agenda.receive(urgent)
    urgent.forecast = Forecast((1, 2), 5.0)
    assert dict(agenda.outlooks())[urgent] == Outlook(), "it was planned from elsewhere"


def test_a_request_that_is_late_by_itself_keeps_no_other_one_waiting(agenda: "Agenda[Errand]") -> None:
    running, hopeless, other = Errand(0), Errand(1, deadline=160.0), Errand(2, deadline=230.0)
    for ticket in (running, hopeless, other):
        agenda.receive(ticket)
        agenda.begin()
    running.ends = 150.0
    hopeless.forecast = Forecast((0,), 95.0, "cannot be done before its deadline")
    assert agenda.lines() == [(hopeless, (0,)), (other, (0,))]
    other.forecast = Forecast((0,), 20.0)
    assert dict(agenda.outlooks())[hopeless] == Outlook(150.0, 245.0, "cannot be done before its deadline")
    assert dict(agenda.outlooks())[other] == Outlook(150.0, 170.0)


def test_where_not_all_can_be_in_time_the_chosen_ones_begin_first(
    agenda: "Agenda[Errand]", clock: Clock
) -> None:
    long, short, soon = Errand(0, deadline=140.0), Errand(1, deadline=150.0), Errand(2, deadline=145.0)
    endless, urgent = Errand(3), Errand(4, priority=1)
    for ticket in (long, short, soon, endless, urgent):
        agenda.receive(ticket)
    agenda.arrange({0: (2, "there is no time for it"), 1: (0, ""), 2: (1, "")})
    assert dict(agenda.outlooks())[long].late == "", "nothing is known that makes it late"
    assert order_of(agenda) == [4, 1, 2, 3, 0]


@pytest.mark.parametrize("how", ["cancelled", "late", "failed"])
def test_a_choice_is_taken_back_when_one_that_was_preferred_leaves(
    agenda: "Agenda[Errand]", clock: Clock, how: str
) -> None:
    preferred, left_out, endless = Errand(0, deadline=150.0), Errand(1, deadline=140.0), Errand(2)
    if how == "late":
        left_out.window = TimeWindow(deadline=160.0)
    for ticket in (preferred, left_out, endless):
        agenda.receive(ticket)
    agenda.arrange({0: (0, ""), 1: (1, "there is no time for it (preferred: (checked hall))")})
    if how == "cancelled":
        agenda.cancel(preferred)
    elif how == "late":
        clock.now = 155.0
        agenda.elapse()
    else:
        assert agenda.begin() is preferred
        agenda.ended(Verdict(Outcome.ACTION_FAILED, "it failed"))
    assert left_out.left_out == "" and order_of(agenda) == [1, 2]


def test_a_newcomer_does_not_go_before_those_that_were_chosen(agenda: "Agenda[Errand]") -> None:
    first, second = Errand(0, deadline=150.0), Errand(1, deadline=140.0)
    for ticket in (first, second):
        agenda.receive(ticket)
    agenda.arrange({0: (0, ""), 1: (1, "")})
    for ticket in (Errand(2, deadline=900.0), Errand(3, deadline=145.0, priority=1)):
        agenda.receive(ticket)
    assert order_of(agenda) == [3, 0, 1, 2]
