# SPDX-License-Identifier: Apache-2.0
"""The book of a server's work: each piece ends once, no more runs than may, and nothing waits for ever."""

from typing import List, Tuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from merlin_ros.work.work_book import WAITING, Decision, Policy, Step, WorkBook

FIRST, SECOND, OTHER_PLAN = (1, 0), (1, 1), (2, 0)
Key = Tuple[int, int]


def in_turn(room: int = 1) -> "WorkBook[Key]":
    return WorkBook(Policy.IN_TURN, room)


def newest(room: int = 1) -> "WorkBook[str]":
    return WorkBook(Policy.NEWEST, room)


def kinds(decisions: List[Decision]) -> List[Tuple[Step, str]]:
    return [(decision.what, decision.key) for decision in decisions]


def test_a_second_one_waits_for_the_end_of_the_first() -> None:
    book = in_turn()
    assert book.arrive(FIRST) == [Decision(Step.RUN, FIRST)]
    assert book.arrive(SECOND) == [Decision(Step.WAIT, SECOND)]
    assert book.end(FIRST) == [Decision(Step.RUN, SECOND)]


def test_it_does_not_wait_for_ever() -> None:
    book = in_turn()
    book.arrive(FIRST)
    book.arrive(SECOND)
    (refused,) = book.overdue(SECOND)
    assert (refused.what, refused.key) == (Step.REFUSE, SECOND)
    assert "runs already" in refused.reason
    assert book.end(FIRST) == []


def test_each_one_in_the_way_has_the_limit_to_end() -> None:
    book = in_turn()
    for key in (FIRST, SECOND, (1, 2)):
        book.arrive(key)
    assert book.end(FIRST) == [Decision(Step.RUN, SECOND)]
    assert book.overdue((1, 2)) == [Decision(Step.WAIT, (1, 2))]
    assert [each.what for each in book.overdue((1, 2))] == [Step.REFUSE]


def test_what_waits_does_not_grow_without_end() -> None:
    book = in_turn()
    book.arrive(FIRST)
    steps = [book.arrive((1, number))[0] for number in range(1, 2 * WAITING)]
    assert [step.what for step in steps] == [Step.WAIT] * WAITING + [Step.REFUSE] * (WAITING - 1)
    assert f"{WAITING} wait already" in steps[-1].reason
    assert book.end(FIRST) == [Decision(Step.RUN, (1, 1))]
    assert book.arrive((1, 9999))[0].what is Step.WAIT


def test_a_newer_plan_stops_what_the_older_one_has_left() -> None:
    book = in_turn()
    book.arrive(FIRST, batch=1)
    waits, stops = book.arrive(OTHER_PLAN, batch=2)
    assert (waits.what, stops.what, stops.key) == (Step.WAIT, Step.STOP, FIRST)


def test_what_arrives_twice_runs_once() -> None:
    book = in_turn(room=0)
    book.arrive(FIRST)
    assert book.arrive(FIRST) == []


def test_lanes_do_not_wait_for_each_other() -> None:
    book = in_turn()
    book.arrive(FIRST, "ann", 1)
    assert book.arrive(SECOND, "bob", 1) == [Decision(Step.RUN, SECOND)]
    assert book.arrive(OTHER_PLAN, "bob", 2) == [
        Decision(Step.WAIT, OTHER_PLAN),
        Decision(Step.STOP, SECOND, "plan 2 has taken the place of plan 1"),
    ]
    assert book.end(FIRST) == []
    assert book.end(SECOND) == [Decision(Step.RUN, OTHER_PLAN)]


def test_what_waits_runs_as_soon_as_more_may() -> None:
    book = in_turn()
    for key in (FIRST, SECOND, (1, 2), (1, 3)):
        book.arrive(key)
    assert book.allow(3) == [Decision(Step.RUN, SECOND), Decision(Step.RUN, (1, 2))]
    assert book.end(FIRST) == [Decision(Step.RUN, (1, 3))]


def test_the_newest_stops_the_older_one_and_runs_after_it() -> None:
    book = newest()
    assert book.arrive("a") == [Decision(Step.RUN, "a")]
    assert kinds(book.arrive("b")) == [(Step.STOP, "a")]
    assert kinds(book.arrive("c")) == [(Step.REFUSE, "b")]
    assert kinds(book.end("a")) == [(Step.RUN, "c")]


def test_what_does_not_stop_is_abandoned() -> None:
    book = newest()
    book.arrive("a")
    assert kinds(book.cancel("a", "cancelled")) == [(Step.STOP, "a")]
    book.arrive("b")
    assert kinds(book.overdue("a")) == [(Step.ABANDON, "a"), (Step.RUN, "b")]
    assert book.end("a") == []  # late, and of no interest any more


def test_what_does_not_have_to_stop_is_not_abandoned() -> None:
    book = newest()
    book.arrive("a")
    assert book.overdue("a") == []
    assert book.running == ["a"]


def test_with_room_for_two_the_third_stops_the_oldest() -> None:
    book = newest(room=2)
    assert kinds(book.arrive("a")) == [(Step.RUN, "a")]
    assert kinds(book.arrive("b")) == [(Step.RUN, "b")]
    assert kinds(book.arrive("c")) == [(Step.STOP, "a")]
    assert kinds(book.end("b")) == [(Step.RUN, "c")]
    assert book.running == ["a", "c"]


@pytest.mark.parametrize("before", [True, False])
def test_when_fewer_may_run_all_that_are_too_many_stop_for_the_newest(before: bool) -> None:
    book = newest(room=2)
    for key in "ab" if before else "abc":
        book.arrive(key)
    decisions = book.allow(1)
    assert kinds(decisions) == ([] if before else [(Step.STOP, "b")])  # "a" stops already
    if before:
        assert kinds(book.arrive("c")) == [(Step.STOP, "a"), (Step.STOP, "b")]
    assert book.end("a") == []
    assert kinds(book.end("b")) == [(Step.RUN, "c")]


def test_when_all_has_to_stop_what_waits_does_not_begin() -> None:
    book = newest()
    book.arrive("a")
    book.arrive("b")  # which stops the first
    assert kinds(book.cancel_all("the master is lost")) == [(Step.REFUSE, "b")]
    assert book.end("a") == []


def test_an_owner_that_asks_gets_the_newest_when_it_asks() -> None:
    book: WorkBook[str] = WorkBook(Policy.NEWEST, asked=True)
    assert book.arrive("a") == []
    assert kinds(book.arrive("b")) == [(Step.REFUSE, "a")]
    assert book.begin() == "b"
    assert kinds(book.arrive("c")) == [(Step.STOP, "b")]
    assert book.begin() is None
    assert book.end("b") == []
    assert book.begin() == "c"


_events = st.tuples(st.sampled_from(["arrive", "cancel", "end", "late", "allow", "begin"]), st.integers(0, 7))


@pytest.mark.parametrize("policy", Policy)
@given(st.integers(0, 3), st.booleans(), st.lists(_events, max_size=60))
def test_each_piece_ends_once_and_no_more_runs_than_may(
    policy: Policy, room: int, asked: bool, events: List[Tuple[str, int]]
) -> None:
    book: WorkBook[int] = WorkBook(policy, room, asked)
    running: List[int] = []
    waiting, stopped, ended = set(), set(), set()

    def lane(key: int) -> str:
        return "ann" if key % 2 else "bob"

    def runs(key: int) -> None:
        assert key not in running
        waiting.discard(key)
        running.append(key)
        assert not room or sum(lane(other) == lane(key) for other in running) <= room

    def carry_out(decisions: List[Decision]) -> None:
        for what, key, reason in decisions:
            if what is Step.RUN:
                assert not asked
                runs(key)
            elif what is Step.STOP:
                assert key in running and key not in stopped and reason
                stopped.add(key)
            elif what is Step.ABANDON:
                assert key in stopped
                running.remove(key)
                ended.add(key)
            elif what is Step.REFUSE:
                waiting.discard(key)
                assert key not in running and reason
                ended.add(key)

    arrived = 0
    for event, choice in events:
        key = max(1, arrived - choice)
        if event == "arrive":
            arrived += 1
            waiting.add(arrived)
            carry_out(book.arrive(arrived, lane(arrived), batch=choice))
        elif event == "cancel":
            carry_out(book.cancel(key, "cancelled"))
        elif event == "late":
            carry_out(book.overdue(key))
        elif event == "allow":
            room = max(1, choice) if room else 0
            carry_out(book.allow(room))
        elif event == "begin" and asked:
            found = book.begin()
            if found is not None:
                runs(found)
        elif key in running:
            running.remove(key)
            ended.add(key)
            carry_out(book.end(key))
        assert book.running == running
        if not asked:
            assert all(any(lane(key) == lane(waits) for key in running) for waits in waiting)
        if policy is Policy.NEWEST:
            assert all(sum(lane(waits) == each for waits in waiting) <= 1 for each in ("ann", "bob"))
            going = [key for key in running if key not in stopped]
            assert not room or all(sum(lane(key) == lane(each) for key in going) < room for each in waiting)
    carry_out(book.cancel_all("the end"))
    assert not waiting
    for key in list(running):
        running.remove(key)
        ended.add(key)
        carry_out(book.end(key))
    assert book.idle and ended == set(range(1, arrived + 1))
