# SPDX-License-Identifier: Apache-2.0
"""When the master counts as lost, and what is due when it is back."""

from typing import List, Optional, Tuple, Union

from hypothesis import given
from hypothesis import strategies as st

from merlin_ros.master.master_watch import HUNG, PATIENCE, SILENT, MasterWatch, WatchDecision

ME, OTHER = "http://me:1/", "http://other:1/"


def watching() -> MasterWatch:
    watch = MasterWatch(ME)
    assert watch.answered(1, ME) is WatchDecision.NOTHING
    return watch


def lost() -> MasterWatch:
    watch = watching()
    assert [watch.refused() for _ in range(PATIENCE)] == [WatchDecision.NOTHING] * (PATIENCE - 1) + [
        WatchDecision.LOST
    ]
    return watch


def test_a_question_that_was_refused_is_no_loss() -> None:
    watch = watching()
    for _ in range(PATIENCE * 3):
        for _ in range(PATIENCE - 1):
            assert watch.refused() is WatchDecision.NOTHING
        assert watch.answered(1, ME) is WatchDecision.NOTHING
    assert not watch.lost


def test_a_loss_is_reported_once() -> None:
    watch = lost()
    assert watch.lost
    assert [watch.refused() for _ in range(10)] == [WatchDecision.NOTHING] * 10


def test_a_master_that_takes_questions_and_is_silent_is_waited_for() -> None:
    watch = watching()
    assert watch.unanswered(SILENT - 0.1) is WatchDecision.NOTHING
    assert watch.unanswered(SILENT) is WatchDecision.PAUSE
    assert watch.unanswered(HUNG - 0.1) is WatchDecision.NOTHING
    assert watch.silent and not watch.lost
    assert watch.answered(1, ME) is WatchDecision.NOTHING
    assert not watch.silent


def test_a_master_that_is_silent_for_too_long_hangs() -> None:
    watch = watching()
    assert watch.unanswered(SILENT) is WatchDecision.PAUSE
    assert watch.unanswered(HUNG) is WatchDecision.LOST
    assert watch.unanswered(HUNG + 1.0) is WatchDecision.NOTHING
    assert watch.answered(1, ME) is WatchDecision.BACK_SAME


def test_a_silent_master_that_dies_is_lost_at_once() -> None:
    watch = watching()
    watch.unanswered(SILENT)
    assert [watch.refused() for _ in range(PATIENCE)][-1] is WatchDecision.LOST


def test_what_a_slow_master_may_have_missed_is_registered_again() -> None:
    watch = watching()
    watch.unanswered(SILENT)
    assert watch.answered(1, ME, missed=True) is WatchDecision.BACK_SAME
    watch.registered()
    assert watch.answered(1, ME) is WatchDecision.NOTHING


def test_the_same_master_back() -> None:
    watch = lost()
    assert watch.answered(1, ME) is WatchDecision.BACK_SAME
    watch.registered()
    assert not watch.lost
    assert watch.answered(1, ME) is WatchDecision.NOTHING


def test_a_new_master_is_new_also_when_its_absence_was_not_noticed() -> None:
    watch = watching()
    assert watch.answered(2, None) is WatchDecision.BACK_NEW
    watch.registered()
    assert watch.answered(2, ME) is WatchDecision.NOTHING


def test_a_new_master_with_the_old_process_id_is_new() -> None:
    watch = lost()
    assert watch.answered(1, None) is WatchDecision.BACK_NEW


def test_a_new_master_at_which_something_was_registered_already_is_new() -> None:
    watch = lost()
    assert watch.answered(2, ME) is WatchDecision.BACK_NEW


def test_a_registration_that_failed_is_due_again() -> None:
    watch = lost()
    assert watch.answered(2, None) is WatchDecision.BACK_NEW
    assert watch.answered(2, ME) is WatchDecision.BACK_NEW  # half of it succeeded
    assert watch.refused() is WatchDecision.NOTHING
    assert watch.answered(2, ME) is WatchDecision.BACK_NEW


def test_the_name_of_another_node_is_not_taken_from_it() -> None:
    watch = lost()
    assert watch.answered(2, OTHER) is WatchDecision.TAKEN
    assert watch.answered(2, OTHER) is WatchDecision.NOTHING
    assert watch.answered(2, None) is WatchDecision.BACK_NEW


def test_a_master_that_is_lost_again_while_registration_is_due_is_reported_again() -> None:
    watch = lost()
    watch.answered(2, None)
    watch.registered()
    assert [watch.refused() for _ in range(PATIENCE)][-1] is WatchDecision.LOST


ANSWER = st.tuples(st.integers(1, 3), st.sampled_from([None, ME]))
SILENCE = st.floats(0.0, 2 * HUNG)


@given(st.lists(st.one_of(st.none(), SILENCE, ANSWER), max_size=40), st.data())
def test_after_any_scenario_an_answering_master_knows_the_node(
    scenario: List[Union[None, float, Tuple[int, Optional[str]]]], data: st.DataObject
) -> None:
    watch = watching()
    process, known = 1, True
    for event in scenario:
        if event is None:
            watch.refused()
            continue
        if isinstance(event, float):
            watch.unanswered(event)
            continue
        if event[0] != process:  # another master, that knows nothing
            process, known = event[0], False
        decision = watch.answered(process, ME if known else None)
        assert (decision is not WatchDecision.NOTHING) or known
        if decision in (WatchDecision.BACK_SAME, WatchDecision.BACK_NEW) and data.draw(st.booleans()):
            known = True
            watch.registered()
    decision = watch.answered(process, ME if known else None)
    if decision is WatchDecision.NOTHING:
        assert known and not watch.lost
