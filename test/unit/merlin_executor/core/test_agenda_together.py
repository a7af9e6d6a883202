# SPDX-License-Identifier: Apache-2.0
"""Requests that run together, in virtual time: who joins, who ends when, and what becomes of the others."""

from typing import Dict, List

import pytest
from fakes.errands import CANCELLED, DONE, LIMIT, MOST, UNSOLVABLE, Clock, Errand, go

from merlin_executor.core.agenda import (
    APART,
    GATHER,
    Agenda,
    AgendaAnswer,
    Decision,
    Refusal,
    ReviseRun,
    StopRun,
)
from merlin_executor.core.outcome import Outcome, Verdict
from merlin_executor.core.ticket import Client, Ticket
from merlin_executor.core.time_window import Outlook


def answers(decisions: List[Decision]) -> Dict[Ticket, Verdict]:
    return {decision.ticket: decision.verdict for decision in decisions if isinstance(decision, AgendaAnswer)}


def stops(decisions: List[Decision]) -> List[int]:
    return [decision.ticket.order for decision in decisions if isinstance(decision, StopRun)]


def revises(decisions: List[Decision]) -> List[int]:
    return [decision.ticket.order for decision in decisions if isinstance(decision, ReviseRun)]


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
    assert revises(agenda.receive(Errand(1))) == [1]
    assert agenda.not_revised(agenda.revision) == [], (
        "it is carried out by a dispatcher that cannot exchange it"
    )
    assert agenda.receive(Errand(2)) == [], "nobody is overtaken"
    agenda.together[0].under_way = False
    assert agenda.revised(agenda.planned_again()) == []
    assert [errand.order for errand in agenda.together] == [0, 1, 2] and agenda.waiting == []
    assert agenda.planned_again() == agenda.together


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
    assert revises(agenda.cancel(errands[0])) == [0]
    assert agenda.achieved([errands[0]], DONE) == [], "it is being stopped"
    assert stops(agenda.not_revised(agenda.revision)) == [0]
    assert agenda.revision == [] and agenda.revised(errands[1:]) == []
    ended = rest(agenda, CANCELLED)
    assert list(ended) == [errands[0]] and ended[errands[0]].outcome is Outcome.CANCELLED
    assert begun(agenda) == [1, 2]


def test_one_that_leaves_does_not_stop_the_run_because_no_newcomer_can_join(
    agenda: "Agenda[Errand]",
) -> None:
    errands = [Errand(order) for order in range(3)]
    held(agenda, *errands[:2])
    begun(agenda)
    go(agenda)
    assert revises(agenda.receive(errands[2])) == [2]
    wanted = agenda.revision
    assert wanted == errands and revises(agenda.cancel(errands[0])) == [0]
    assert agenda.not_revised(wanted, Refusal("cancelled")) == [] and agenda.revision == errands[1:2]
    decisions = agenda.revised(agenda.revision)
    assert list(answers(decisions)) == errands[:1]
    assert revises(decisions) == [2] and agenda.revision == errands[1:], "it is tried again"


def test_who_comes_while_the_plan_is_carried_out_joins_it(agenda: "Agenda[Errand]") -> None:
    errands = [Errand(order) for order in range(MOST + 1)]
    receive(agenda, errands[0])
    begun(agenda)
    assert agenda.revision == []
    go(agenda)
    for errand in errands[1:]:
        assert (revises(agenda.receive(errand)) == [errand.order]) == (errand.order < MOST)
    assert agenda.revision == errands[:MOST]
    assert agenda.revised(agenda.revision) == []
    assert agenda.together == errands[:MOST] and agenda.waiting == errands[MOST:]
    go(agenda)
    assert revises(agenda.achieved([errands[0]], DONE)) == [MOST], "there is a place for it now"
    assert agenda.revision == errands[1:]


def test_one_that_leaves_is_answered_and_the_run_goes_on(agenda: "Agenda[Errand]", clock: Clock) -> None:
    errands = [Errand(0), Errand(1), Errand(2)]
    held(agenda, *errands)
    begun(agenda)
    go(agenda)
    assert revises(agenda.cancel(errands[0])) == [0]
    assert agenda.cancel(errands[0]) == []
    assert agenda.revision == errands[1:]
    assert answers(agenda.revised(errands[1:]))[errands[0]].outcome is Outcome.CANCELLED
    assert agenda.together == errands[1:] and agenda.revision == []
    assert set(rest(agenda, DONE)) == set(errands[1:])


@pytest.mark.parametrize("leaves", [0, 1])
def test_one_that_leaves_lets_none_of_the_others_be_interrupted_that_is_not(
    agenda: "Agenda[Errand]", leaves: int
) -> None:
    errands, urgent = [Errand(0), Errand(1, interruptible=False)], Errand(2, priority=3)
    held(agenda, *errands)
    begun(agenda)
    go(agenda)
    assert agenda.receive(urgent) == []
    assert revises(agenda.cancel(errands[leaves])) == [leaves]
    if leaves == 0:
        assert agenda.elapse() == [] and dict(agenda.outlooks())[urgent].waits
    decisions = agenda.revised(agenda.revision)
    assert list(answers(decisions)) == [errands[leaves]]
    assert stops(decisions) == [0] * leaves, "it is interrupted as soon as that is possible"
    assert [*rest(agenda, CANCELLED if leaves else DONE)] == ([] if leaves else errands[1:])
    assert begun(agenda) == [2]


def test_who_leaves_has_not_succeeded_when_the_plan_ends(agenda: "Agenda[Errand]") -> None:
    errands = [Errand(0), Errand(1)]
    held(agenda, *errands)
    begun(agenda)
    go(agenda)
    agenda.cancel(errands[1])
    assert [each.outcome for each in rest(agenda, DONE).values()] == [Outcome.SUCCEEDED, Outcome.CANCELLED]


def test_a_run_of_which_only_those_are_left_that_are_to_leave_stops(agenda: "Agenda[Errand]") -> None:
    errands = [Errand(0), Errand(1), Errand(2)]
    held(agenda, *errands)
    begun(agenda)
    go(agenda)
    agenda.cancel(errands[0])
    assert answers(agenda.achieved(errands[1:2], DONE)) == {errands[1]: DONE}
    assert stops(agenda.cancel(errands[2])) == [2]
    assert [each.outcome for each in rest(agenda, CANCELLED).values()] == [Outcome.CANCELLED] * 2


def test_the_last_one_beside_one_that_leaves_ends_and_the_run_stops(agenda: "Agenda[Errand]") -> None:
    errands = [Errand(0), Errand(1)]
    held(agenda, *errands)
    begun(agenda)
    go(agenda)
    agenda.cancel(errands[0])
    decisions = agenda.achieved(errands[1:], DONE)
    assert (answers(decisions), stops(decisions)) == ({errands[1]: DONE}, [0])


def test_a_newcomer_taken_back_meanwhile_is_taken_out_again(agenda: "Agenda[Errand]") -> None:
    errands = [Errand(0), Errand(1)]
    receive(agenda, errands[0])
    begun(agenda)
    go(agenda)
    agenda.receive(errands[1])
    wanted = agenda.revision
    assert answers(agenda.cancel(errands[1]))[errands[1]].outcome is Outcome.CANCELLED
    assert agenda.revision == []
    agenda.revised(wanted)
    assert agenda.together == agenda.revision == errands[:1], "the plan is for the other one, too"
    assert stops(agenda.not_revised(agenda.revision)) == [0]
    assert rest(agenda, CANCELLED) == {} and begun(agenda) == [0]


def test_a_run_goes_on_with_newcomers_for_a_bounded_time(agenda: "Agenda[Errand]", clock: Clock) -> None:
    receive(agenda, Errand(0))
    begun(agenda)
    go(agenda)
    clock.now += LIMIT - 1.0
    assert revises(agenda.receive(Errand(1))) == [1]
    agenda.revised(agenda.revision)
    go(agenda)
    clock.now += 2.0
    assert agenda.receive(Errand(2)) == [] and agenda.revision == []


def test_the_others_of_a_run_go_on_in_a_pause(agenda: "Agenda[Errand]") -> None:
    errands = [Errand(0), Errand(1)]
    held(agenda, *errands)
    begun(agenda)
    go(agenda)
    agenda.pause(True)
    receive(agenda, Errand(2))
    agenda.cancel(errands[0])
    assert agenda.revision == errands[1:], "who waits does not join"
    agenda.not_revised(agenda.revision)
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


def test_a_request_that_waits_knows_for_how_many(agenda: "Agenda[Errand]") -> None:
    errands = [Errand(0), Errand(1), Errand(2, deadline=100.5)]
    held(agenda, *errands[:2])
    begun(agenda)
    go(agenda)
    errands[0].ends, errands[1].ends = 170.0, 180.0
    assert revises(agenda.receive(errands[2])) == [2]
    assert dict(agenda.outlooks())[errands[2]] == Outlook(), "it may still join"
    assert agenda.not_revised(agenda.revision, Refusal("no time")) == []
    outlook = dict(agenda.outlooks())[errands[2]]
    assert outlook.late.startswith("(checked room_0) and 1 more is expected to run until 180.0 s")
    assert outlook.waits == "does not join (checked room_0): no time"
