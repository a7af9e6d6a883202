# SPDX-License-Identifier: Apache-2.0
"""The book of a dispatch: what failed, what may still run, and how the dispatch ended."""

from typing import Dict, List, Optional, Tuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from merlin_planning.dispatch_progress import (
    EARLY,
    PART,
    Action,
    DispatchAnswer,
    DispatchProgress,
    DispatchResult,
    Reply,
)

NAVIGATE = Action(1, 7, "navigate", ("hall", "kitchen"))
WAVE = Action(2, 7, "wave", ())
CANCELLED = {"reason": "cancelled"}
STUCK = {"reason": "the machine does not stop", "stopped": "no"}


def book(*actions: Action, taken: bool = True) -> DispatchProgress:
    progress = DispatchProgress()
    for action in actions:
        progress.dispatched(action)
        if taken:
            progress.answered(action.id, action.plan_id, DispatchAnswer.TAKEN, {})
    return progress


def test_actions_run_until_they_are_answered() -> None:
    progress = book(NAVIGATE, WAVE)
    assert progress.answered(1, 7, DispatchAnswer.SUCCEEDED, {})
    assert len(progress.succeeded) == 1
    assert [action.text for action in progress.running.values()] == ["(wave)"]
    assert progress.result(Reply(achieved=True)) == DispatchResult(True)


def test_an_action_says_when_it_can_be_interrupted() -> None:
    progress = book(NAVIGATE, WAVE)
    assert progress.answered(1, 7, DispatchAnswer.TAKEN, {"interruptible": "no"})
    assert not progress.answered(1, 6, DispatchAnswer.TAKEN, {"interruptible": "yes"})  # of an earlier plan
    assert progress.kept == {1}
    assert progress.answered(1, 7, DispatchAnswer.TAKEN, {"interruptible": "yes"}) and not progress.kept
    progress.answered(2, 7, DispatchAnswer.TAKEN, {"interruptible": "no"})
    progress.answered(2, 7, DispatchAnswer.SUCCEEDED, {})
    assert not progress.kept and list(progress.running) == [1]


def test_goals_that_do_not_hold_are_named() -> None:
    progress = book(NAVIGATE)
    progress.answered(1, 7, DispatchAnswer.SUCCEEDED, {})
    result = progress.result(Reply(), reason="these goals do not hold: (told)", unmet=["(told)"])
    assert result == DispatchResult(False, reason="these goals do not hold: (told)", unmet=("(told)",))


def test_answers_of_other_plans_and_unknown_actions_are_ignored() -> None:
    progress = book(NAVIGATE)
    assert not progress.answered(1, 6, DispatchAnswer.FAILED, {})
    assert not progress.answered(9, 7, DispatchAnswer.FAILED, {})
    assert progress.answered(1, 0, DispatchAnswer.SUCCEEDED, {})
    assert not progress.answered(1, 7, DispatchAnswer.FAILED, {})
    assert progress.failed == ""


def test_answers_that_overtake_their_action_count_when_it_comes() -> None:
    progress = DispatchProgress()
    progress.answered(1, 7, DispatchAnswer.TAKEN, {})
    progress.answered(1, 7, DispatchAnswer.FAILED, {"reason": "the way is blocked", "final": "yes"})
    assert progress.failed == ""
    progress.dispatched(NAVIGATE)
    assert (progress.failed, progress.running) == ("(navigate hall kitchen)", {})
    assert progress.result(Reply(), "(navigate hall kitchen)").no_retry == "(navigate hall kitchen)"
    progress.dispatched(NAVIGATE)  # answers count once
    assert progress.running == {1: NAVIGATE}


def test_an_end_without_a_begin_is_that_of_an_action_of_before() -> None:
    progress = DispatchProgress()
    progress.answered(1, 0, DispatchAnswer.FAILED, {"reason": "the way is blocked"})
    progress.dispatched(NAVIGATE)
    assert (progress.failed, progress.running) == ("", {1: NAVIGATE})
    progress = DispatchProgress()
    for answer in (DispatchAnswer.TAKEN, DispatchAnswer.FAILED):
        progress.answered(1, 6, answer, {})
    progress.dispatched(NAVIGATE)
    assert (progress.failed, progress.running, progress.unanswered) == ("", {1: NAVIGATE}, [])


def test_early_answers_are_kept_in_a_limited_number() -> None:
    progress = DispatchProgress()
    for number in range(1, EARLY + 2):
        progress.answered(number, 7, DispatchAnswer.TAKEN, {})
    progress.dispatched(NAVIGATE)
    progress.dispatched(WAVE)
    assert progress.unanswered == ["(wave)"]


def test_an_answer_is_missing_of_what_was_taken_and_of_what_the_dispatcher_says_has_failed() -> None:
    progress = book(NAVIGATE, WAVE, taken=False)
    assert not progress.answers_missing("") and not progress.answers_missing("(sing)")
    assert progress.answers_missing("(Navigate hall kitchen)")
    progress.answered(1, 7, DispatchAnswer.FAILED, {})
    assert not progress.answers_missing("(Navigate hall kitchen)")
    progress.answered(2, 7, DispatchAnswer.TAKEN, {})
    assert progress.answers_missing("")


def test_after_a_cancel_the_answer_of_each_action_is_missing() -> None:
    progress = book(NAVIGATE, taken=False)
    progress.stop()
    assert progress.answers_missing("")
    progress.answered(1, 7, DispatchAnswer.FAILED, {"reason": "cancelled", "stopped": "no"})
    assert not progress.answers_missing("")
    assert progress.result(Reply()).unstopped == ("(navigate hall kitchen)",)


def test_a_failure_names_its_action_and_reason() -> None:
    progress = book(NAVIGATE)
    progress.answered(1, 7, DispatchAnswer.FAILED, {"reason": "the way is blocked"})
    result = progress.result(Reply())
    assert (result.action, result.reason) == ("(navigate hall kitchen)", "the way is blocked")
    assert not result.cancelled and not result.unstopped


def test_the_first_failure_is_reported_not_that_of_what_was_stopped_with_it() -> None:
    progress = book(NAVIGATE, WAVE)
    progress.answered(1, 7, DispatchAnswer.FAILED, {"reason": "the way is blocked"})
    progress.answered(2, 7, DispatchAnswer.FAILED, CANCELLED)
    assert progress.result(Reply()).reason == "the way is blocked"
    progress = book(NAVIGATE, WAVE)
    progress.answered(2, 7, DispatchAnswer.FAILED, CANCELLED)
    progress.answered(1, 7, DispatchAnswer.FAILED, {"reason": "the way is blocked"})
    assert progress.result(Reply()).action == "(navigate hall kitchen)"


def test_a_cancel_that_everything_obeys() -> None:
    progress = book(NAVIGATE)
    progress.stop()
    progress.answered(1, 7, DispatchAnswer.FAILED, CANCELLED)
    result = progress.result(Reply(), reason="cancelled by cancel_dispatch")
    assert result.cancelled and not result.unstopped


def test_what_says_that_it_did_not_stop_is_named() -> None:
    progress = book(NAVIGATE, WAVE)
    progress.stop()
    progress.answered(1, 7, DispatchAnswer.FAILED, STUCK)
    progress.answered(2, 7, DispatchAnswer.FAILED, CANCELLED)
    result = progress.result(Reply(), "(navigate hall kitchen)", "cancelled by cancel_dispatch")
    assert result.cancelled
    assert (result.unstopped, result.held_up_by) == (("(navigate hall kitchen)",), STUCK["reason"])


def test_what_did_not_stop_beside_a_failure_is_named_too() -> None:
    progress = book(NAVIGATE, WAVE)
    progress.answered(2, 7, DispatchAnswer.FAILED, {"reason": "no hand"})
    progress.answered(1, 7, DispatchAnswer.FAILED, STUCK)
    result = progress.result(Reply())
    assert not result.cancelled
    assert (result.action, result.unstopped) == ("(wave)", ("(navigate hall kitchen)",))


def test_an_interface_that_took_an_action_and_does_not_answer_a_cancel_is_named() -> None:
    progress = book(NAVIGATE)
    progress.stop()
    assert progress.result(Reply()).unstopped == ("(navigate hall kitchen)",)
    reported = "cancelled; no answer to the cancel from (navigate hall kitchen), (wave)"
    assert progress.result(Reply(), reason=reported).unstopped == ("(navigate hall kitchen)", "(wave)")


def test_an_action_that_no_interface_took_is_not_running() -> None:
    progress = book(NAVIGATE, taken=False)
    progress.stop()
    assert progress.result(Reply()).unstopped == ()


def test_an_interface_that_died_is_a_failure_and_no_cancel() -> None:
    progress = book(NAVIGATE)
    gone = "the action interface of navigate is gone, silent for 5.1 s"
    result = progress.result(Reply(), "(navigate hall kitchen)", gone)
    assert (result.cancelled, result.unstopped, result.reason) == (False, (), gone)


def test_a_dispatcher_that_refuses_says_why() -> None:
    result = book().result(Reply(refused="there is no plan"), reason="an old status")
    assert (result.reason, result.gone) == ("there is no plan", False)


def test_a_dispatcher_that_is_gone_is_reported() -> None:
    result = book(NAVIGATE).result(Reply(gone=f"{PART} /d ended while it carried out the plan"))
    assert result.gone and result.reason.startswith(PART)
    assert not result.cancelled


def test_a_dispatcher_that_hangs_on_a_cancel() -> None:
    progress = book(NAVIGATE)
    progress.stop()
    result = progress.hung("/d", 5.0)
    assert result.timed_out and result.cancelled
    assert result.unstopped == ("(navigate hall kitchen)",)
    assert result.reason.startswith("(navigate hall kitchen) did not stop: the planning system's plan disp")
    idle = book()
    idle.stop()
    assert idle.hung("/d", 5.0).unstopped == (PART,)


def test_a_dispatcher_that_hangs_after_a_failure_counts_as_gone() -> None:
    progress = book(NAVIGATE)
    progress.answered(1, 7, DispatchAnswer.FAILED, {"reason": "its owner is gone"})
    result = progress.hung("/d", 5.0)
    assert result.gone and not result.timed_out
    assert "does not answer" in result.reason


@given(
    st.lists(
        st.tuples(
            st.integers(0, 3),
            st.sampled_from(["dispatch", "stop", *DispatchAnswer]),
            st.sampled_from([{}, STUCK]),
        )
    )
)
def test_whatever_is_heard_a_dispatch_that_was_cancelled_hides_nothing(events: List[Tuple]) -> None:
    """What was taken and never answered as stopped is in the result of a cancel."""
    progress = DispatchProgress()
    open_actions, stuck = set(), set()
    taken = set()
    early = {}  # answers that overtook their action, from the one that took it on
    for number, event, information in events:
        action = Action(number, 1, f"a{number}", ())
        if event == "dispatch":
            progress.dispatched(action)
            taken.discard(number)
            answers = early.pop(number, [])
            taken |= {number} if len(answers) == 1 else set()
            if len(answers) < 2:
                open_actions.add(number)
            else:
                open_actions.discard(number)
                stuck |= {number} if answers[1] == (DispatchAnswer.FAILED, STUCK) else set()
        elif event == "stop":
            progress.stop()
        else:
            progress.answered(number, 1, event, information)
            if number not in open_actions:
                if event is DispatchAnswer.TAKEN:
                    early[number] = [(event, information)]
                elif len(early.get(number, [])) == 1:
                    early[number].append((event, information))
            elif event is DispatchAnswer.TAKEN:
                taken.add(number)
            else:
                open_actions.discard(number)
                if event is DispatchAnswer.FAILED and information:
                    stuck.add(number)
    progress.stop()
    expected = {f"(a{number})" for number in stuck | (open_actions & taken)}
    assert expected <= set(progress.result(Reply()).unstopped)
    assert {f"(a{number})" for number in open_actions} <= {*progress.hung("/d", 1.0).unstopped, PART}


def test_the_result_says_that_another_try_cannot_help() -> None:
    for information, no_retry in (
        ({"reason": "no", "final": "yes"}, "(Prescribe Ann)"),
        ({"reason": "no", "final": "(prescribe *)"}, "(prescribe *)"),
        ({"reason": "no"}, ""),
    ):
        progress = DispatchProgress()
        progress.dispatched(Action(1, 1, "Prescribe", ("Ann",)))
        progress.answered(1, 1, DispatchAnswer.FAILED, information)
        assert progress.result(Reply(), "(prescribe ann)", "no").no_retry == no_retry


def test_the_result_says_what_is_of_the_robot_that_failed() -> None:
    progress = DispatchProgress()
    progress.dispatched(Action(1, 1, "Pick", ("tom", "cup")))
    said = {"reason": "the arm hangs", "of_robot": "(pick tom *)"}
    progress.answered(1, 1, DispatchAnswer.FAILED, said)
    assert progress.result(Reply(), "(pick tom cup)", "no").of_robot == "(pick tom *)"
    assert progress.result(Reply(), "(pick ria cup)", "no").of_robot == ""


def test_what_another_plan_drops_is_stopped_without_a_failure() -> None:
    progress = book(NAVIGATE, WAVE)
    progress.exchange({2, 3})
    assert progress.answered(1, 7, DispatchAnswer.FAILED, CANCELLED)
    assert progress.failed == "" and [*progress.running] == [2]
    progress.answered(2, 7, DispatchAnswer.FAILED, {"reason": "stuck"})
    assert progress.failed == "(wave)" and progress.failed_by_itself


def test_what_is_dropped_and_does_not_stop_is_named() -> None:
    progress = book(NAVIGATE)
    progress.exchange({3})
    progress.answered(1, 7, DispatchAnswer.FAILED, STUCK)
    assert progress.result(Reply()).unstopped == ("(navigate hall kitchen)",)


def test_what_is_dropped_and_does_not_answer_is_named_too() -> None:
    progress = book(NAVIGATE, WAVE)
    progress.exchange({2, 3})
    assert progress.result(Reply()).unstopped == ("(navigate hall kitchen)",)


@pytest.mark.parametrize("cancelled", [False, True])
@pytest.mark.parametrize("answer", [CANCELLED, STUCK, None])
def test_goals_that_hold_are_a_success_once_what_is_dropped_has_stopped(
    answer: Optional[Dict[str, str]], cancelled: bool
) -> None:
    progress = book(NAVIGATE, WAVE)
    progress.exchange({2, 3})
    progress.answered(2, 7, DispatchAnswer.SUCCEEDED, {})
    if cancelled:
        progress.stop()
    if answer is not None:
        progress.answered(1, 7, DispatchAnswer.FAILED, answer)
    assert progress.answers_missing("", achieved=True) is (answer is None)
    result = progress.result(Reply(achieved=True))
    stopped = answer is CANCELLED
    assert (result.goal_achieved, result.cancelled) == (stopped, cancelled)
    assert result.unstopped == (() if stopped else ("(navigate hall kitchen)",))


def test_goals_that_hold_are_no_success_of_a_cancel_without_an_answer() -> None:
    progress = book(NAVIGATE)
    assert not progress.answers_missing("", achieved=True)
    assert progress.result(Reply(achieved=True)) == DispatchResult(True), "its answer is under way"
    progress.stop()
    assert progress.answers_missing("", achieved=True)
    result = progress.result(Reply(achieved=True), reason="cancelled; no answer to the cancel from (wave)")
    assert not result.goal_achieved and result.unstopped == ("(navigate hall kitchen)", "(wave)")


def test_the_steps_count_anew_with_another_plan_unless_it_is_refused() -> None:
    progress = book(NAVIGATE, WAVE)
    progress.answered(1, 7, DispatchAnswer.SUCCEEDED, {})
    progress.exchange({1, 2, 3})
    assert len(progress.succeeded) == 1, "one that goes on, and has succeeded before the exchange, is a step"
    take_back = progress.exchange({3})
    assert len(progress.succeeded) == 0
    take_back()
    progress.answered(2, 7, DispatchAnswer.FAILED, {"reason": "stuck"})
    assert (len(progress.succeeded), progress.failed) == (1, "(wave)")


def test_actions_under_way_are_in_the_order_in_which_they_are_to_end() -> None:
    progress = book(NAVIGATE._replace(ends=130.0), WAVE._replace(ends=103.0))
    assert [action.name for action in progress.under_way] == ["wave", "navigate"]
