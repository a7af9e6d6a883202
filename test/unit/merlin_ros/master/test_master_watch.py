"""When the master counts as lost, and what is due when it is back."""

from typing import List, Optional, Tuple

from hypothesis import given
from hypothesis import strategies as st

from merlin_ros.master.master_watch import PATIENCE, MasterWatch, WatchDecision

ME, OTHER = "http://me:1/", "http://other:1/"


def watching() -> MasterWatch:
    watch = MasterWatch(ME)
    assert watch.answered(1, ME) is WatchDecision.NOTHING
    return watch


def lost() -> MasterWatch:
    watch = watching()
    assert [watch.failed() for _ in range(PATIENCE)] == [WatchDecision.NOTHING] * (PATIENCE - 1) + [
        WatchDecision.LOST
    ]
    return watch


def test_a_question_without_an_answer_is_no_loss() -> None:
    watch = watching()
    for _ in range(PATIENCE * 3):
        for _ in range(PATIENCE - 1):
            assert watch.failed() is WatchDecision.NOTHING
        assert watch.answered(1, ME) is WatchDecision.NOTHING
    assert not watch.lost


def test_a_loss_is_told_once() -> None:
    watch = lost()
    assert watch.lost
    assert [watch.failed() for _ in range(10)] == [WatchDecision.NOTHING] * 10


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
    assert watch.failed() is WatchDecision.NOTHING
    assert watch.answered(2, ME) is WatchDecision.BACK_NEW


def test_the_name_of_another_node_is_not_taken_from_it() -> None:
    watch = lost()
    assert watch.answered(2, OTHER) is WatchDecision.TAKEN
    assert watch.answered(2, OTHER) is WatchDecision.NOTHING
    assert watch.answered(2, None) is WatchDecision.BACK_NEW


def test_a_master_that_is_lost_again_while_registration_is_due_is_told_again() -> None:
    watch = lost()
    watch.answered(2, None)
    watch.registered()
    assert [watch.failed() for _ in range(PATIENCE)][-1] is WatchDecision.LOST


ANSWER = st.tuples(st.integers(1, 3), st.sampled_from([None, ME]))


@given(st.lists(st.one_of(st.none(), ANSWER), max_size=40), st.data())
def test_after_any_story_an_answering_master_knows_the_node(
    story: List[Optional[Tuple[int, Optional[str]]]], data: st.DataObject
) -> None:
    watch = watching()
    process, known = 1, True
    for event in story:
        if event is None:
            watch.failed()
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
