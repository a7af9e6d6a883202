# SPDX-License-Identifier: Apache-2.0
"""The book of leases: what a server believes of the owners of its goals."""

from hypothesis import given
from hypothesis import strategies as st

from merlin_ros.actions.lease import (
    KEEP_LOST,
    LEASED,
    LOSE_AFTER,
    LOSE_GONE_AFTER,
    NAMES,
    SUSPEND_AFTER,
    SUSPEND_GONE_AFTER,
    UNNAMED_LOSE_AFTER,
    UNNAMED_SUSPEND_AFTER,
    LeaseBook,
    LeaseChange,
    LeaseState,
)
from merlin_ros.work.liveness import PEERS

GOAL, OTHER = "/client-1", "/client-2"


def states(changes):
    return [(change.goal, change.state) for change in changes]


def test_a_goal_without_a_lease_is_foreign_for_ever():
    book = LeaseBook()
    assert book.pass_time(1000.0) == []
    assert book.state(GOAL) is LeaseState.FOREIGN and book.owner(GOAL) == ""


def test_a_silent_owner_suspends_first_and_loses_later():
    book = LeaseBook()
    assert book.renew("/client", "a", [GOAL], []) == []
    assert book.state(GOAL) is LeaseState.HELD
    assert book.pass_time(SUSPEND_AFTER) == []
    assert states(book.pass_time(0.1)) == [(GOAL, LeaseState.SUSPENDED)]
    assert "/client is silent" in book.reason(GOAL)
    lost = book.pass_time(LOSE_AFTER)
    assert states(lost) == [(GOAL, LeaseState.LOST)] and book.owner(GOAL) == "/client"
    assert "/client has been silent for 3." in lost[0].reason


def test_an_owner_that_returns_in_time_loses_nothing():
    book = LeaseBook()
    book.renew("/client", "a", [GOAL], [])
    book.pass_time(LOSE_AFTER - 0.1)
    assert states(book.renew("/client", "a", [GOAL], [])) == [(GOAL, LeaseState.HELD)]
    assert book.reason(GOAL) == ""


def test_a_closed_connection_shortens_the_wait():
    book = LeaseBook()
    book.renew("/client", "a", [GOAL], [])
    assert book.pass_time(SUSPEND_GONE_AFTER, set()) == []
    assert states(book.pass_time(0.1, set())) == [(GOAL, LeaseState.SUSPENDED)]
    assert states(book.renew("/client", "a", [GOAL], [])) == [(GOAL, LeaseState.HELD)]  # connected again
    assert book.pass_time(SUSPEND_AFTER, {"/client"}) == []
    assert states(book.pass_time(LOSE_GONE_AFTER, {"/another"})) == [(GOAL, LeaseState.LOST)]
    assert "is gone" in book.reason(GOAL)


def test_a_suspension_is_passed_on_and_taken_back():
    book = LeaseBook()
    book.renew("/client", "a", [GOAL, OTHER], [])
    assert states(book.renew("/client", "a", [GOAL, OTHER], [GOAL])) == [(GOAL, LeaseState.SUSPENDED)]
    assert "the owner of /client" in book.reason(GOAL)
    assert states(book.renew("/client", "a", [GOAL, OTHER], [])) == [(GOAL, LeaseState.HELD)]


def test_what_is_not_named_any_more_is_lost():
    book = LeaseBook()
    book.renew("/client", "a", [GOAL, OTHER], [])
    assert states(book.renew("/client", "a", [OTHER], [])) == [(GOAL, LeaseState.LOST)]


def test_a_node_owns_something_until_it_lets_go_of_it_or_is_silent_for_long():
    book = LeaseBook()
    for held in ([GOAL], [], [OTHER]):
        book.renew("/client", "a", held, [])
        assert book.owners == ["/client"] * len(held)
    book.pass_time(LOSE_AFTER)
    assert book.owners == ["/client"]
    book.pass_time(0.1)
    assert book.owners == []


def test_a_new_life_of_the_owner_loses_what_the_old_one_held():
    book = LeaseBook()
    book.renew("/client", "a", [GOAL], [])
    assert states(book.renew("/client", "b", [OTHER], [])) == [(GOAL, LeaseState.LOST)]
    assert book.state(OTHER) is LeaseState.HELD


def test_an_ended_goal_changes_no_more():
    book = LeaseBook()
    book.renew("/client", "a", [GOAL], [])
    book.forget(GOAL)
    assert book.pass_time(100.0) == []
    assert book.renew("/client", "a", [], []) == []
    assert not book.watching


def test_a_goal_whose_client_died_before_its_first_lease_is_lost():
    book = LeaseBook()
    goal = f"/client-1{LEASED}"
    book.arrive(goal)
    book.arrive(GOAL)
    assert states(book.pass_time(UNNAMED_SUSPEND_AFTER + 0.1)) == [(goal, LeaseState.SUSPENDED)]
    assert states(book.pass_time(UNNAMED_LOSE_AFTER)) == [(goal, LeaseState.LOST)]
    assert book.state(GOAL) is LeaseState.FOREIGN


def test_a_goal_that_its_living_owner_never_names_is_lost():
    book = LeaseBook()
    book.arrive(GOAL, "/client")
    for _ in range(int(UNNAMED_SUSPEND_AFTER / 0.5)):
        assert book.renew("/client", "a", [OTHER], []) == []  # the first one was on its way before the goal
        assert book.pass_time(0.5) == []
    book.renew("/client", "a", [OTHER], [])
    assert states(book.pass_time(0.5)) == [(GOAL, LeaseState.SUSPENDED)]
    for _ in range(int(UNNAMED_LOSE_AFTER / 0.5)):
        book.renew("/client", "a", [OTHER], [])
        book.pass_time(0.5)
    assert book.state(GOAL) is LeaseState.LOST


def test_a_goal_whose_owner_dies_before_it_names_it_is_lost_as_others_of_it():
    book = LeaseBook()
    book.renew("/client", "a", [OTHER], [])
    assert book.leases("/client") and not book.leases("/other")
    book.arrive(GOAL, "/client")
    changes = book.pass_time(LOSE_GONE_AFTER + 0.1, connected=[])
    assert set(states(changes)) == {(GOAL, LeaseState.LOST), (OTHER, LeaseState.LOST)}


def test_a_goal_that_is_named_late_is_held():
    book = LeaseBook()
    goal = f"/client-1{LEASED}"
    book.arrive(goal)
    book.pass_time(UNNAMED_SUSPEND_AFTER + 0.1)
    assert states(book.renew("/client", "a", [goal], [])) == [(goal, LeaseState.HELD)]
    assert states(book.pass_time(SUSPEND_AFTER + 0.1)) == [(goal, LeaseState.SUSPENDED)]


def test_a_late_word_of_a_former_life_is_ignored():
    book = LeaseBook()
    book.renew("/client", "a", [GOAL], [])
    book.renew("/client", "b", [OTHER], [])
    assert book.renew("/client", "a", [GOAL], []) == []
    assert book.state(OTHER) is LeaseState.HELD


_goals = st.lists(st.sampled_from(["g1", "g2", "g3"]), unique=True)
_events = st.one_of(
    st.tuples(st.just("renew"), st.sampled_from(["/a", "/b"]), st.sampled_from(["1", "2"]), _goals, _goals),
    st.tuples(st.just("time"), st.floats(0.0, 2.0), st.sets(st.sampled_from(["/a", "/b"]))),
    st.tuples(st.just("forget"), st.sampled_from(["g1", "g2", "g3"])),
)


@given(st.lists(_events, max_size=40))
def test_lost_is_final_and_each_change_is_reported_once(events):
    book = LeaseBook()
    reported = {}
    for event in events:
        if event[0] == "renew":
            changes = book.renew(*event[1:])
        elif event[0] == "time":
            changes = book.pass_time(*event[1:])
        else:
            changes = []
            book.forget(event[1])
            reported.pop(event[1], None)
        for change in changes:
            assert change.state is not reported.get(change.goal, LeaseState.FOREIGN)
            assert reported.get(change.goal) is not LeaseState.LOST
            assert bool(change.reason) == (change.state is not LeaseState.HELD)
            reported[change.goal] = change.state
        for goal, state in reported.items():
            # An end that is remembered long enough may be forgotten.
            assert book.state(goal) in (state, LeaseState.FOREIGN)
            if book.state(goal) is LeaseState.FOREIGN:
                assert state is LeaseState.LOST
        reported = {goal: state for goal, state in reported.items() if book.state(goal) is state}


@given(st.lists(st.floats(0.01, 0.2), min_size=1, max_size=60))
def test_a_held_goal_is_suspended_exactly_when_the_silence_is_too_long(ticks):
    book = LeaseBook()
    book.renew("/client", "a", [GOAL], [])
    silence = 0.0
    for tick in ticks:
        book.pass_time(tick)
        silence += tick
        expected = (
            LeaseState.LOST
            if silence > LOSE_AFTER
            else LeaseState.SUSPENDED
            if silence > SUSPEND_AFTER
            else LeaseState.HELD
        )
        assert book.state(GOAL) is expected


def test_what_one_client_names_does_not_grow_for_ever():
    book = LeaseBook()
    book.renew("/client", "a", [GOAL], [])
    book.renew("/flood", "a", ["mine"], [])
    named = []
    for number in range(20):
        names = [f"{number}-{name}" for name in range(5 * NAMES)]
        named += names
        changes = book.renew("/flood", "a", names, [names[-1]])
        assert LeaseChange(names[-1], LeaseState.SUSPENDED, "the owner of /flood is silent") in changes
        assert book.state(names[-NAMES]) is LeaseState.HELD
        assert book.state(names[-NAMES - 1]) is LeaseState.FOREIGN
        book.pass_time(0.1)
    assert book.state("mine") is LeaseState.FOREIGN  # lost, and long forgotten
    assert book.state(GOAL) is LeaseState.SUSPENDED
    assert sum(book.state(name) is not LeaseState.FOREIGN for name in named) <= NAMES + KEEP_LOST


def test_the_oldest_names_of_a_lease_without_measure_are_lost_and_say_so():
    book = LeaseBook()
    names = [str(number) for number in range(NAMES)]
    book.renew("/client", "a", names, [])
    reason = f"/client holds more than {NAMES} goals"
    assert book.renew("/client", "a", [*names, "next"], []) == [
        LeaseChange("0", LeaseState.LOST, reason, released=True)
    ]


def test_owners_that_come_and_go_are_not_remembered_for_ever():
    book = LeaseBook()
    book.renew("/client", "a", [], [])
    for number in range(3 * PEERS):
        book.renew(f"/anonymous_{number}", "a", [], [])
        book.renew("/client", "b", [GOAL], [])
    assert sum(book.leases(f"/anonymous_{number}") for number in range(3 * PEERS)) == PEERS - 1
    assert book.renew("/client", "a", [], []) == []  # a late word, all the same
    assert book.state(GOAL) is LeaseState.HELD
