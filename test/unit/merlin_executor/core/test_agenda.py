# SPDX-License-Identifier: Apache-2.0
"""The agenda: whatever happens in whatever order, each request gets one answer and never do two run."""

from typing import Dict, List, Optional

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from merlin_executor.core.agenda import Agenda, AgendaAnswer, Decision, StopRun
from merlin_executor.core.outcome import Outcome, Stop, StopKind, Verdict
from merlin_executor.core.request_limits import MAX_OF_CLIENT, MAX_WAITING
from merlin_executor.core.ticket import Client, Ticket

CANCELLED = Verdict(Outcome.CANCELLED, "cancelled")


def answers(decisions: List[Decision]) -> Dict[Ticket, Verdict]:
    return {decision.ticket: decision.verdict for decision in decisions if isinstance(decision, AgendaAnswer)}


def stops(decisions: List[Decision]) -> List[Ticket]:
    return [decision.ticket for decision in decisions if isinstance(decision, StopRun)]


@pytest.fixture
def agenda() -> "Agenda[Ticket]":
    return Agenda()


def test_the_most_urgent_runs_first_and_equals_in_order(agenda: "Agenda[Ticket]") -> None:
    tickets = [Ticket(0, 1), Ticket(1, 5), Ticket(2, 1), Ticket(3, 5)]
    for ticket in tickets:
        assert agenda.receive(ticket) == []
    ran = []
    for _ in tickets:
        ran.append(agenda.begin())
        assert agenda.begin() is None  # one at a time
        assert answers(agenda.ended(Verdict(Outcome.SUCCEEDED))) == {ran[-1]: Verdict(Outcome.SUCCEEDED)}
    assert ran == [tickets[1], tickets[3], tickets[0], tickets[2]]


def test_while_a_base_is_held_nothing_begins_and_nothing_is_interrupted(agenda: "Agenda[Ticket]") -> None:
    first, urgent = Ticket(0), Ticket(1, 3)
    agenda.receive(first)
    assert agenda.begin() is first
    agenda.hold(True)
    assert agenda.receive(urgent) == []
    agenda.ended(Verdict(Outcome.SUCCEEDED))
    agenda.pause(False)  # an operator who resumes beside a hold
    assert agenda.begin() is None
    agenda.hold(False)
    assert agenda.begin() is urgent


@pytest.mark.parametrize("resumes", [True, False])
def test_an_urgent_request_interrupts_and_the_other_resumes_or_is_dropped(
    agenda: "Agenda[Ticket]", resumes: bool
) -> None:
    first, urgent = Ticket(0, resumes=resumes), Ticket(1, 3)
    agenda.receive(first)
    agenda.begin()
    assert stops(agenda.receive(urgent)) == [first]
    assert agenda.begin() is None  # before the first has stopped
    verdicts = answers(agenda.ended(CANCELLED))
    assert agenda.begin() is urgent
    agenda.ended(Verdict(Outcome.SUCCEEDED))
    if resumes:
        assert not verdicts
        assert agenda.begin() is first and first.interrupted and first.stop is None
    else:
        assert verdicts[first].outcome is Outcome.DROPPED
        assert "more urgent" in verdicts[first].reason
        assert agenda.begin() is None


def test_an_interrupted_request_that_did_not_stop_ends_so(agenda: "Agenda[Ticket]") -> None:
    """It does not run again: what it has begun may still move the robot."""
    first = Ticket(0, resumes=True)
    agenda.receive(first)
    agenda.begin()
    agenda.receive(Ticket(1, 3))
    reported = Verdict(Outcome.CANCEL_TIMEOUT, "(drive a b) did not stop; the guard has halted the base")
    assert answers(agenda.ended(reported)) == {first: reported}


class ForKitchen(Ticket):
    text = "(checked kitchen)"


def test_a_request_is_held_before_its_goal_and_goes_on(agenda: "Agenda[Ticket]") -> None:
    agenda.breakpoints.set(["(checked *)"])
    held, other = ForKitchen(1), Ticket(0)
    agenda.receive(held)
    agenda.receive(other)
    assert agenda.begin() is other
    agenda.ended(Verdict(Outcome.SUCCEEDED))
    assert agenda.begin() is None and agenda.breakpoints.held == held.text
    assert agenda.begin() is None
    agenda.breakpoints.go_on()
    assert agenda.begin() is held and agenda.breakpoints.held == ""


def test_a_held_request_can_be_cancelled(agenda: "Agenda[Ticket]") -> None:
    agenda.breakpoints.set(["checked"])
    held = ForKitchen(0)
    agenda.receive(held)
    assert agenda.begin() is None
    assert answers(agenda.cancel(held))[held].outcome is Outcome.CANCELLED
    assert agenda.begin() is None and agenda.breakpoints.held == ""


def test_an_equal_request_waits(agenda: "Agenda[Ticket]") -> None:
    first = Ticket(0, 3)
    agenda.receive(first)
    agenda.begin()
    assert agenda.receive(Ticket(1, 3)) == []
    assert first.stop is None


def test_a_request_that_ended_by_itself_in_the_moment_of_its_cancel_ended_by_itself(
    agenda: "Agenda[Ticket]",
) -> None:
    ticket = Ticket(0)
    agenda.receive(ticket)
    agenda.begin()
    assert stops(agenda.cancel(ticket)) == [ticket]
    assert answers(agenda.ended(Verdict(Outcome.SUCCEEDED)))[ticket].outcome is Outcome.SUCCEEDED
    assert agenda.cancel(ticket) == []


def test_a_cancel_counts_more_than_an_interruption_and_less_than_an_earlier_end(
    agenda: "Agenda[Ticket]",
) -> None:
    ticket = Ticket(0)
    agenda.receive(ticket)
    agenda.begin()
    agenda.receive(Ticket(1, 1))
    assert stops(agenda.cancel(ticket)) == [ticket]
    assert agenda.close()[1:] == []  # it stops already
    verdict = answers(agenda.ended(CANCELLED))[ticket]
    assert (verdict.outcome, verdict.reason) == (Outcome.CANCELLED, StopKind.CANCELLED.value)


def test_a_waiting_request_is_taken_back(agenda: "Agenda[Ticket]") -> None:
    ticket = Ticket(0)
    agenda.receive(ticket)
    assert answers(agenda.cancel(ticket))[ticket].reason == "cancelled before it began"
    assert agenda.begin() is None and agenda.waiting == []


def test_a_request_that_was_taken_back_before_it_was_read_never_waits(agenda: "Agenda[Ticket]") -> None:
    ticket = Ticket(0)
    assert answers(agenda.receive(ticket, cancelled=True))[ticket].outcome is Outcome.CANCELLED
    assert agenda.waiting == []


def test_the_request_of_a_lost_client_ends_with_the_reason(agenda: "Agenda[Ticket]") -> None:
    running, waiting = Ticket(0, goes_on=False), Ticket(1, goes_on=False)
    agenda.receive(running)
    agenda.begin()
    agenda.receive(waiting)
    verdict = answers(agenda.client(waiting, Client.GONE, "its client /x is gone"))[waiting]
    assert verdict == Verdict(Outcome.CANCELLED, "cancelled before it began: its client /x is gone")
    assert stops(agenda.client(running, Client.GONE, "its client /x is gone")) == [running]
    assert answers(agenda.ended(CANCELLED))[running].reason == "cancelled: its client /x is gone"


def test_a_cancelled_request_names_what_did_not_answer(agenda: "Agenda[Ticket]") -> None:
    ticket = Ticket(0)
    agenda.receive(ticket)
    agenda.begin()
    agenda.cancel(ticket)
    decisions = agenda.ended(Verdict(Outcome.CANCELLED, "cancelled", trouble="the knowledge base hangs"))
    reason = "cancelled by its client; the knowledge base hangs"
    assert answers(decisions) == {ticket: Verdict(Outcome.CANCELLED, reason)}


def test_a_request_that_goes_on_without_its_client_is_left_alone(agenda: "Agenda[Ticket]") -> None:
    running = Ticket(0, goes_on=True)
    agenda.receive(running)
    agenda.begin()
    for client in Client:
        assert agenda.client(running, client) == []
    assert running.stop is None


def test_nothing_begins_for_a_silent_client_and_its_return_counts(agenda: "Agenda[Ticket]") -> None:
    silent, other = Ticket(0, 5, goes_on=False), Ticket(1, 0)
    agenda.receive(silent)
    agenda.client(silent, Client.SILENT)
    assert agenda.begin() is None
    agenda.receive(other)
    assert agenda.begin() is other
    assert stops(agenda.client(silent, Client.ALIVE)) == [other]
    agenda.ended(CANCELLED)
    assert agenda.begin() is silent


def test_after_the_end_of_the_executor_all_is_answered_and_nothing_is_taken(agenda: "Agenda[Ticket]") -> None:
    running, waiting, late = Ticket(0), Ticket(1), Ticket(2)
    agenda.receive(running)
    agenda.begin()
    agenda.receive(waiting)
    decisions = agenda.close()
    assert answers(decisions)[waiting].outcome is Outcome.CANCELLED
    assert stops(decisions) == [running]
    assert answers(agenda.receive(late))[late].outcome is Outcome.REFUSED
    assert answers(agenda.ended(CANCELLED))[running].reason == "the executor shuts down"
    assert agenda.begin() is None


def test_an_interrupted_request_is_answered_when_the_executor_ends(agenda: "Agenda[Ticket]") -> None:
    first = Ticket(0)
    agenda.receive(first)
    agenda.begin()
    agenda.receive(Ticket(1, 1))
    agenda.close()
    assert answers(agenda.ended(CANCELLED))[first].reason == "the executor shuts down"


@pytest.mark.parametrize("interruptible", [True, False], ids=["at a state", "never"])
def test_a_more_urgent_request_waits_for_a_safe_point_and_says_so(
    agenda: "Agenda[Ticket]", interruptible: bool
) -> None:
    first, urgent, less = Keeping(0, interruptible=interruptible), Ticket(1, 3), Ticket(2, -1)
    first.kept = "(deliver cup) can be interrupted" if interruptible else ""
    agenda.receive(first)
    agenda.begin()
    agenda.receive(less)
    assert agenda.receive(urgent) == [] and agenda.elapse() == [] and first.stop is None
    until = first.kept or "the request that runs has ended"
    assert [outlook.waits for _, outlook in agenda.outlooks()] == [f"waits until {until}", ""]
    if interruptible:
        first.kept = ""
        assert stops(agenda.elapse()) == [first]
        agenda.ended(CANCELLED)
    else:
        agenda.ended(Verdict(Outcome.SUCCEEDED))
    assert agenda.begin() is urgent


def test_its_own_client_cancels_a_request_that_is_not_interrupted(agenda: "Agenda[Ticket]") -> None:
    first, urgent = Ticket(0, interruptible=False), Ticket(1, 3)
    agenda.receive(first)
    agenda.begin()
    agenda.receive(urgent)
    assert stops(agenda.cancel(first)) == [first]
    assert dict(agenda.outlooks())[urgent].waits == ""
    assert answers(agenda.ended(CANCELLED))[first].outcome is Outcome.CANCELLED


ENDS = st.sampled_from(
    [CANCELLED, Verdict(Outcome.SUCCEEDED), Verdict(Outcome.CANCEL_TIMEOUT, "x did not stop")]
)


class Keeping(Ticket):
    """One whose actions are at states at which they are not interrupted, when the test says so."""

    kept = ""

    @property
    def keeps(self) -> str:
        return super().keeps or self.kept


class AgendaMachine(RuleBasedStateMachine):
    """Events in any order."""

    def __init__(self) -> None:
        super().__init__()
        self.agenda: Agenda[Ticket] = Agenda()
        self.tickets: List[Keeping] = []
        self.answered: Dict[Ticket, Verdict] = {}
        self.stopped: List[Ticket] = []
        self.running: Optional[Keeping] = None
        self.wanted: Dict[Ticket, bool] = {}  # whether the client has not taken it back
        self.closed = False

    def take(self, decisions: List[Decision]) -> None:
        for decision in decisions:
            if isinstance(decision, AgendaAnswer):
                assert decision.ticket not in self.answered, "answered twice"
                assert decision.ticket is not self.running, "answered while it runs"
                self.answered[decision.ticket] = decision.verdict
            else:
                assert decision.ticket is self.running and decision.ticket.stop is not None
                assert decision.ticket.stop.is_final or not decision.ticket.keeps, "interrupted"

    def pick(self, number: int) -> Optional[Keeping]:
        return self.tickets[number % len(self.tickets)] if self.tickets else None

    @rule(
        priority=st.integers(-2, 2),
        resumes=st.booleans(),
        goes_on=st.booleans(),
        cancelled=st.booleans(),
        interruptible=st.sampled_from([True, True, False]),
    )
    def receive(
        self, priority: int, resumes: bool, goes_on: bool, cancelled: bool, interruptible: bool
    ) -> None:
        number = len(self.tickets)
        ticket = Keeping(number, priority, resumes, goes_on, interruptible=interruptible)
        self.tickets.append(ticket)
        self.wanted[ticket] = not cancelled
        self.take(self.agenda.receive(ticket, cancelled))

    @rule(number=st.integers(0, 20))
    def cancel(self, number: int) -> None:
        ticket = self.pick(number)
        if ticket is not None:
            self.wanted[ticket] = False
            self.take(self.agenda.cancel(ticket))

    @rule(number=st.integers(0, 20), client=st.sampled_from(Client))
    def client(self, number: int, client: Client) -> None:
        ticket = self.pick(number)
        if ticket is not None:
            self.take(self.agenda.client(ticket, client, "its client /x is gone"))
            if client is Client.GONE and not ticket.goes_on:
                self.wanted[ticket] = False

    @rule()
    def begin(self) -> None:
        ticket = self.agenda.begin()
        if ticket is not None:
            assert self.running is None, "two run"
            assert ticket not in self.answered and not self.closed
            assert ticket.stop is None and ticket.may_run
            self.running = ticket

    @precondition(lambda self: self.running is not None)
    @rule(kept=st.sampled_from(["", "(deliver cup) can be interrupted"]))
    def reach_another_state(self, kept: str) -> None:
        assert self.running is not None
        self.running.kept = kept
        self.take(self.agenda.elapse())

    @precondition(lambda self: self.running is not None)
    @rule(verdict=ENDS)
    def end(self, verdict: Verdict) -> None:
        running, self.running = self.running, None
        assert running is not None
        running.kept = ""
        if verdict is CANCELLED and running.stop is None:
            verdict = Verdict(Outcome.ACTION_FAILED, "it failed")
        self.take(self.agenda.ended(verdict))
        if running not in self.answered:
            assert running.interrupted and running in self.agenda.waiting

    @rule()
    def close(self) -> None:
        self.closed = True
        self.take(self.agenda.close())

    @invariant()
    def each_request_waits_runs_or_is_answered(self) -> None:
        assert self.agenda.running is self.running
        waiting = self.agenda.waiting
        for ticket in self.tickets:
            places = [ticket in waiting, ticket is self.running, ticket in self.answered]
            assert places.count(True) == 1, places
        assert not (self.closed and waiting)

    @invariant()
    def what_nothing_wants_is_stopped(self) -> None:
        for ticket, wanted in self.wanted.items():
            if not wanted:
                assert ticket in self.answered or (ticket is self.running and ticket.stop is not None)

    @invariant()
    def nothing_more_urgent_waits_than_runs(self) -> None:
        if self.running is not None and self.running.stop is None and not self.running.keeps:
            ready = [ticket.priority for ticket in self.agenda.waiting if ticket.may_run]
            assert max(ready, default=self.running.priority) <= self.running.priority

    def teardown(self) -> None:
        """In the end everything is answered."""
        self.take(self.agenda.close())
        if self.running is not None:
            self.running = None
            self.take(self.agenda.ended(CANCELLED))
        assert set(self.answered) == set(self.tickets)


AgendaMachine.TestCase.settings = settings(max_examples=200, stateful_step_count=40, deadline=None)
test_any_order_of_events = AgendaMachine.TestCase


def test_a_stop_says_why() -> None:
    assert Stop(StopKind.SHUTDOWN).reason == "the executor shuts down"
    assert Stop(StopKind.CLIENT_LOST, "its client /x is gone").reason == "its client /x is gone"
    assert not Stop(StopKind.INTERRUPTED).is_final


def test_a_pause_lets_what_runs_go_on_and_nothing_begin(agenda: "Agenda[Ticket]") -> None:
    first, urgent = Ticket(0), Ticket(1, priority=5)
    agenda.receive(first)
    agenda.begin()
    assert agenda.pause(True) == []
    assert agenda.receive(urgent) == [], "what could not begin interrupts nothing"
    agenda.ended(Verdict(Outcome.SUCCEEDED))
    assert agenda.begin() is None and agenda.waiting == [urgent]
    assert agenda.pause(False) == [] and agenda.begin() is urgent


def test_what_is_more_urgent_interrupts_when_the_pause_ends(agenda: "Agenda[Ticket]") -> None:
    first, urgent = Ticket(0), Ticket(1, priority=5)
    agenda.receive(first)
    agenda.begin()
    agenda.pause(True)
    agenda.receive(urgent)
    assert stops(agenda.pause(False)) == [first]


def test_a_client_without_measure_is_refused_and_the_others_are_not(agenda: "Agenda[Ticket]") -> None:
    for order in range(MAX_OF_CLIENT):
        assert agenda.receive(Ticket(order, sender="/flood")) == []
    late = Ticket(MAX_OF_CLIENT, priority=9, sender="/flood")
    verdict = answers(agenda.receive(late))[late]
    assert verdict.outcome is Outcome.REFUSED
    assert verdict.reason == "200 requests of /flood wait already; no more may"
    assert agenda.receive(Ticket(order + 2, sender="/client")) == []
    agenda.begin()  # one that runs does not wait
    assert agenda.receive(Ticket(order + 3, sender="/flood")) == []


def test_clients_without_number_are_refused_together(agenda: "Agenda[Ticket]") -> None:
    for order in range(MAX_WAITING):
        assert agenda.receive(Ticket(order, sender=f"/anonymous_{order}")) == []
    late = Ticket(MAX_WAITING, sender="/client")
    assert answers(agenda.receive(late))[late].reason == "1000 requests wait already; no more may"
