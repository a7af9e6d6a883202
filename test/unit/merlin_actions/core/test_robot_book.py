# SPDX-License-Identifier: Apache-2.0
"""Which robots take actions: known from their hosts' messages and silence."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from merlin_msgs.msg import RobotHost

from merlin_actions.core.robot_book import GONE_AFTER, RobotBook, RobotChange


def word(robot, node, life, out="", leaving=False, operators=()):
    variables = ["r"] * len(operators)
    return RobotHost(
        robot=robot,
        node=node,
        life=life,
        out=out,
        leaving=leaving,
        operators=operators,
        robot_parameters=variables,
    )


def ann(life="one", **fields):
    return word("ann", "/ann/merlin_fsm_host", life, operators=["drive"], **fields)


ANN = ann()


@pytest.fixture
def book():
    book = RobotBook()
    assert book.hear(ANN) == [RobotChange("ann", True)]
    return book


def test_a_host_says_where_its_robot_is_and_which_parameter_names_it(book):
    assert book.available("ann") and book.namespace("ann") == "/ann/" and book.parameter("DRIVE") == "r"
    assert book.hear(ANN) == []


def test_a_robot_that_was_never_heard_of_has_no_reason():
    book = RobotBook()
    assert not book.available("ann") and book.why_not("ann") == "" and book.robots == []


def test_a_silent_robot_is_gone_and_one_that_speaks_again_is_back(book):
    assert book.pass_time(GONE_AFTER) == []
    (change,) = book.pass_time(0.1)
    assert not change.available and not change.answers and "is silent" in change.reason
    assert book.pass_time(10.0) == [] and book.parameter("drive") == "r"
    assert book.hear(ANN) == [RobotChange("ann", True)]


def test_only_a_robot_that_was_heard_and_does_not_answer_is_gone(book):
    assert not book.is_gone("ann") and not book.is_gone("bob")
    book.hear(ann(out="is taken out"))
    assert not book.is_gone("ann")
    book.pass_time(GONE_AFTER + 0.1)
    assert book.is_gone("ann")
    book.hear(ANN)
    assert not book.is_gone("ann")


def test_a_book_may_wait_longer():
    book = RobotBook(gone_after=60.0)
    book.hear(ANN)
    assert book.pass_time(60.0) == [] and book.pass_time(0.1)


def test_a_restarted_host_has_lost_what_ran(book):
    lost, back = book.hear(ann(life="two"))
    assert not lost.available and not lost.answers and "restarted" in lost.reason and back.available
    assert book.hear(ANN) == [] and book.available("ann"), "a late word of the life before"


def test_a_robot_that_is_taken_out_still_answers(book):
    (change,) = book.hear(ann(out="was taken out by its operator"))
    assert change == RobotChange("ann", False, "robot ann was taken out by its operator", True)
    assert book.hear(ANN) == [RobotChange("ann", True)]


def test_a_robot_that_leaves_says_so(book):
    (change,) = book.hear(ann(leaving=True))
    assert not change.available and "has ended" in change.reason
    assert book.hear(ANN) == []


def test_two_hosts_of_one_robot_get_nothing(book):
    (change,) = book.hear(word("ann", "/bob/merlin_fsm_host", "three"))
    assert not change.available and change.answers
    assert (
        "two hosts say that they are robot ann: /ann/merlin_fsm_host and /bob/merlin_fsm_host"
        in change.reason
    )
    assert book.hear(word("ann", "/bob/merlin_fsm_host", "three", leaving=True)) == [RobotChange("ann", True)]


def test_a_suspected_robot_is_gone_until_its_next_word(book):
    (change,) = book.suspect("ann", "its process is gone")
    assert not change.available and not change.answers and "its process is gone" in change.reason
    assert book.hear(ANN) == [RobotChange("ann", True)]
    assert book.suspect("bob", "") == []


def test_what_hosts_say_without_end_does_not_grow_without_end(book):
    for number in range(100):
        changes = book.hear(word("ann", f"/h{number}/host", "one"))
    assert changes == [] and len(book.why_not("ann")) < 500
    book.hear(word("bob", "/bob/host", "one", operators=[f"o{n}" for n in range(3000)]))
    assert book.parameter("o0") == "r" and book.parameter("o2999") == "" and book.parameter("drive") == "r"
    assert book.pass_time(0.0) == [] and book.forget("bob").forgotten
    assert book.robots == ["ann"] and book.parameter("o0") == ""
    assert book.pass_time(GONE_AFTER + 0.1) and book.hear(ANN) == [RobotChange("ann", True)]


_words = st.builds(
    word,
    st.sampled_from(["ann", "bob"]),
    st.sampled_from(["/ann/host", "/bob/host"]),
    st.sampled_from(["one", "two", "three"]),
    st.sampled_from(["", "was taken out"]),
    st.booleans(),
)
_events = st.one_of(_words, st.floats(0.0, 3.0), st.sampled_from(["ann", "bob"]))


@given(st.lists(_events, max_size=40))
def test_changes_tell_everything_and_nothing_twice(events):
    book, reported = RobotBook(), {}
    for event in events:
        if isinstance(event, RobotHost):
            changes = book.hear(event)
        elif isinstance(event, float):
            changes = book.pass_time(event)
        else:
            changes = book.suspect(event, "its process is gone")
        for change in changes:
            before = reported.get(change.robot, RobotChange(change.robot, False))
            assert (change.available, change.reason) != (before.available, before.reason)
            assert change.available != bool(change.reason)
            reported[change.robot] = change
        for robot in ("ann", "bob"):
            assert book.available(robot) == (robot in reported and reported[robot].available)
    book.pass_time(GONE_AFTER + 0.1)
    assert not any(book.available(robot) for robot in book.robots)
