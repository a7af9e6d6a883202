# SPDX-License-Identifier: Apache-2.0
"""The course of a request: what each end of a stage means for it."""

from typing import List, Tuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from merlin_executor.core.course import Course, StageEnd
from merlin_executor.core.outcome import Outcome
from merlin_executor.core.replanning import REPLAN_WAIT, Failure, Replanning
from merlin_pddl.plan_text import OUTDATED
from merlin_planning.dispatch_progress import DispatchResult

STAGES = ["SETTLE", "ADD_GOALS", "GENERATE_PROBLEM", "PLAN", "PARSE_PLAN", "DISPATCH_PLAN"]


def run(course: Course, *ends: Tuple[str, str, str], gone: bool = False) -> None:
    """Stages and how they ended."""
    for stage, outcome, reason in ends:
        course.enter(stage, 0.0)
        course.ended(StageEnd(stage, outcome, reason, gone))


def failed(action: str, no_retry: str = "", of_robot: str = "") -> DispatchResult:
    """An action of a dispatch has failed."""
    return DispatchResult(False, action=action, no_retry=no_retry, of_robot=of_robot)


@pytest.mark.parametrize(
    ("stage", "outcome", "expected"),
    [
        ("DISPATCH_PLAN", "succeeded", Outcome.SUCCEEDED),
        ("ADD_GOALS", "already_true", Outcome.ALREADY_TRUE),
        ("ADD_GOALS", "aborted", Outcome.INTERNAL),
        ("ADD_GOALS", "refused", Outcome.REFUSED),
        ("SETTLE", "aborted", Outcome.INTERNAL),
        ("PLAN", "unsolvable", Outcome.UNSOLVABLE),
        ("PLAN", "timeout", Outcome.PLANNER_TIMEOUT),
        ("PLAN", "aborted", Outcome.PLANNER_ERROR),
        ("PARSE_PLAN", "aborted", Outcome.INTERNAL),
        ("DISPATCH_PLAN", "failed", Outcome.ACTION_FAILED),
        ("DISPATCH_PLAN", "cancel_timeout", Outcome.CANCEL_TIMEOUT),
        ("DISPATCH_PLAN", "aborted", Outcome.INTERNAL),
        *((stage, "preempted", Outcome.CANCELLED) for stage in [*STAGES, "REPLAN"]),
    ],
)
def test_the_last_stage_decides(stage: str, outcome: str, expected: Outcome) -> None:
    course = Course(3)
    course.begin()
    run(course, (stage, outcome, "why"))
    assert course.verdict()[:2] == (expected, "why")


def test_a_planner_that_is_gone_is_no_planner_error() -> None:
    course = Course(3)
    course.begin()
    run(course, ("PLAN", "aborted", "the planning system's planner interface is gone"), gone=True)
    assert course.verdict().outcome is Outcome.INTERNAL
    assert course.unreachable


def test_a_cancel_while_a_part_is_gone_is_a_cancel() -> None:
    course = Course(3)
    course.begin()
    run(course, ("DISPATCH_PLAN", "preempted", "cancelled"), gone=True)
    assert course.verdict().outcome is Outcome.CANCELLED


def test_a_cancel_that_had_to_give_up_a_call_names_the_part() -> None:
    course = Course(3)
    course.begin()
    run(course, ("ADD_GOALS", "preempted", "the knowledge base does not answer"), gone=True)
    assert course.verdict().trouble == "the knowledge base does not answer"
    assert course.unreachable
    course.begin()
    run(course, ("ADD_GOALS", "preempted", "cancelled"))
    assert course.verdict().trouble == ""


def test_unsolvable_after_a_failure_says_what_made_another_way_necessary() -> None:
    course = Course(3)
    course.begin()
    course.dispatched = failed("(navigate a b)")
    run(course, ("DISPATCH_PLAN", "failed", "the way is blocked"))
    assert course.replan().again
    run(course, ("PLAN", "unsolvable", "no plan"))
    verdict = course.verdict()
    assert verdict.outcome is Outcome.UNSOLVABLE
    assert verdict.reason == "the way is blocked; planned again: no plan"
    assert verdict.action == "(navigate a b)"


def test_a_goal_that_came_true_meanwhile_succeeded() -> None:
    course = Course(3)
    course.begin()
    run(course, ("DISPATCH_PLAN", "failed", "no answer"))
    assert course.replan().again
    run(course, ("ADD_GOALS", "already_true", "the goal holds already"))
    assert course.verdict()[:2] == (Outcome.SUCCEEDED, "the goal holds")


@pytest.mark.parametrize(
    "end",
    [
        StageEnd("PLAN", "unsolvable", "no plan"),
        StageEnd("PLAN", "aborted", "the planner crashed"),
        StageEnd("DISPATCH_PLAN", "cancel_timeout", "x did not stop", gone=True),
        StageEnd("DISPATCH_PLAN", "preempted", "cancelled", gone=True),
    ],
)
def test_what_planning_again_does_not_help_ends(end: StageEnd) -> None:
    course = Course(3)
    course.begin()
    course.ended(end)
    assert not course.replan().again
    assert course.replans == 0


def test_a_part_that_is_gone_is_waited_for_a_bounded_number_of_times() -> None:
    course = Course(2)
    course.begin()
    for expected in (True, True, False):
        run(course, ("GENERATE_PROBLEM", "aborted", "the problem interface is gone"), gone=True)
        assert course.replan().again is expected
    assert course.verdict().outcome is Outcome.INTERNAL


def test_an_interface_that_is_gone_may_be_back_for_each_new_plan() -> None:
    """Whatever the silence is that its dispatcher names: that of a starved one stands still."""
    course = Course(3, same_failures=2)
    course.begin()
    for expected in (True, True, True, False):
        course.dispatched = failed("(say hello)")
        run(course, ("DISPATCH_PLAN", "failed", "the action interface of say is gone, silent for 5.3 s"))
        assert course.replan().again is expected
    assert course.verdict().outcome is Outcome.ACTION_FAILED


def test_stage_times_do_not_change_under_their_reader() -> None:
    course, other = Course(max_replans=1), Course(max_replans=1)
    for number, stage in enumerate(("SETTLE", "PLAN", "")):
        other.enter(stage, float(number))
    for number, stage in enumerate(("ADD_GOALS", "PARSE_PLAN", "DISPATCH_PLAN")):
        course.enter(stage, float(number))
    reader = iter(course.stage_times.items())
    course.enter("", 9.0)
    course.take_in(other)
    assert dict(reader) == {"ADD_GOALS": 1.0, "PARSE_PLAN": 1.0}
    assert course.stage_times.keys() == {"ADD_GOALS", "PARSE_PLAN", "DISPATCH_PLAN", "SETTLE", "PLAN"}


def test_stage_times_add_up_over_runs() -> None:
    course = Course(3)
    for begin in (0.0, 100.0):
        course.begin()
        course.enter("PLAN", begin)
        course.enter("DISPATCH_PLAN", begin + 2.0)
        course.enter("", begin + 5.0)
    assert course.stage_times == {"PLAN": 4.0, "DISPATCH_PLAN": 6.0}
    assert course.stage == ""


def test_an_interrupted_request_has_all_its_new_plans_again() -> None:
    course = Course(1)
    course.begin()
    run(course, ("DISPATCH_PLAN", "failed", "blocked"))
    assert course.replan().again
    course.begin()
    assert not course.may_move and course.dispatched.action == ""
    run(course, ("DISPATCH_PLAN", "failed", "blocked"))
    assert course.replan().again
    assert course.replans == 2


def test_a_request_that_has_not_begun_has_moved_nothing() -> None:
    course = Course(3)
    assert not course.may_move and not course.unreachable and not course.dispatched.timed_out


def test_a_dispatched_plan_can_have_moved_the_base() -> None:
    course = Course(3)
    course.begin()
    course.enter("PLAN", 0.0)
    assert not course.may_move
    course.enter("DISPATCH_PLAN", 1.0)
    course.enter("REMOVE_GOALS", 2.0)
    assert course.may_move


@pytest.mark.parametrize(
    ("outcome", "may_move"), [("succeeded", False), ("preempted", True), ("aborted", True)]
)
def test_a_planning_system_that_was_not_at_rest_can_have_moved_the_base(outcome: str, may_move: bool) -> None:
    course = Course(3)
    course.begin()
    run(course, ("SETTLE", outcome, ""))
    assert course.may_move is may_move


def test_the_same_failure_is_not_tried_a_third_time() -> None:
    policy = Replanning(10)
    failure = Failure("the way is blocked", "(navigate a b)")
    assert policy.failed(failure) == (True, 0.0, "")
    decision = policy.failed(failure)
    assert not decision.again
    assert decision.reason == "the way is blocked (2 times for the same reason)"


def test_a_measured_time_does_not_make_it_another_failure() -> None:
    policy = Replanning(10)
    assert policy.failed(Failure("/arm has been silent for 7.0 s", "(pick cup)")).again
    assert not policy.failed(Failure("/arm has been silent for 7.2 s", "(pick cup)")).again
    assert policy.failed(Failure("table_4.2 is blocked", "(pick cup)")).again
    assert policy.failed(Failure("table_4.3 is blocked", "(pick cup)")).again


def test_a_plan_that_no_longer_fits_is_replaced_at_once_and_a_bounded_number_of_times() -> None:
    course = Course(max_replans=3)
    course.begin()
    for expected in (True, True, True, False):
        run(
            course,
            ("DISPATCH_PLAN", "failed", f"(go b): {OUTDATED}step 2, (go b), cannot be ..."),
        )
        decision = course.replan()
        assert (decision.again, decision.wait) == (expected, 0.0)
    assert course.replans == 3


def test_an_action_that_fails_by_chance_is_tried_as_often_as_allowed_and_without_waits() -> None:
    course = Course(10, same_failures=4, replan_wait=0.0)
    course.begin()
    for expected in (True, True, True, False):
        course.dispatched = failed("(pick cup table)")
        run(course, ("DISPATCH_PLAN", "failed", "the hand slipped"))
        decision = course.replan()
        assert (decision.again, decision.wait) == (expected, 0.0)
    assert decision.reason == "the hand slipped (4 times for the same reason)"


def test_other_failures_are_bounded_and_wait_longer_each_time() -> None:
    policy = Replanning(4)
    decisions = [policy.failed(Failure(f"reason {number}", "(navigate a b)")) for number in range(5)]
    assert [decision.wait for decision in decisions[:4]] == [0.0, *(REPLAN_WAIT * n for n in (1, 2, 4))]
    assert not decisions[4].again
    assert decisions[4].reason == "reason 4 (planned again 4 times)"


def test_without_new_plans_the_reason_stands_alone() -> None:
    assert Replanning(0).failed(Failure("blocked", "(navigate a b)")).reason == "blocked"


@given(
    st.integers(0, 6),
    st.lists(
        st.builds(
            Failure,
            st.sampled_from("xyz"),
            st.sampled_from(["(a)", "(b)", ""]),
            st.booleans(),
            st.sampled_from(["", "", "(a)", "(b)"]),
            st.just(False),
            st.sampled_from(["", "(a *)"]),
        )
    ),
)
def test_every_run_ends(limit: int, failures: List[Failure]) -> None:
    policy = Replanning(limit)
    seen: List[Failure] = []
    for failure in failures:
        decision = policy.failed(failure)
        seen.append(failure)
        assert policy.count <= limit
        if not decision.again:
            assert decision.reason.startswith(failure.reason)
            return
        if failure.no_retry:
            assert len([other for other in seen if other.no_retry == failure.no_retry]) < 2
        else:
            same = [other for other in seen if other[:2] == failure[:2] and not other.no_retry]
            assert failure.gone or len(same) < 2 + bool(failure.of_robot)
    assert len(failures) <= limit


def give_up(course: Course, action: str, no_retry: str = "") -> None:
    """A plan ends because an action was given up."""
    course.dispatched = failed(action, no_retry=no_retry or action)
    run(course, ("DISPATCH_PLAN", "failed", f"{action}: the pharmacist said no"))


def test_what_was_given_up_is_left_out_of_the_next_plan() -> None:
    course = Course(3)
    course.begin()
    assert course.without == []
    give_up(course, "(prescribe ann)")
    assert course.replan() == (True, 0.0, "")
    assert course.without == ["(prescribe ann)"]
    give_up(course, "(drive hall attic)", "(drive * attic)")
    assert course.replan().again
    assert course.without == ["(prescribe ann)", "(drive * attic)"]
    course.begin()  # after an interruption it is as hopeless as before
    assert course.without == ["(prescribe ann)", "(drive * attic)"]
    assert Course(3).without == []


@pytest.mark.parametrize("outcome", ["unsolvable", "no_plan", "timeout", "aborted"])
def test_without_another_plan_the_reason_of_what_was_given_up_stands(outcome: str) -> None:
    course = Course(3)
    course.begin()
    give_up(course, "(prescribe ann)")
    course.replan()
    run(course, ("PLAN", outcome, "the problem has no plan"))
    verdict = course.verdict()
    assert verdict.outcome is Outcome.ACTION_FAILED
    assert verdict.action == "(prescribe ann)"
    assert (
        verdict.reason
        == "(prescribe ann): the pharmacist said no; no plan without it: the problem has no plan"
    )


def test_a_cancel_while_it_is_planned_without_it_is_a_cancel() -> None:
    course = Course(3)
    course.begin()
    give_up(course, "(prescribe ann)")
    course.replan()
    run(course, ("PLAN", "preempted", "cancelled"))
    assert course.verdict().outcome is Outcome.CANCELLED


@pytest.mark.parametrize("limit", [0, 1, 5])
def test_what_was_given_up_is_planned_around_a_bounded_number_of_times(limit: int) -> None:
    course = Course(limit)
    course.begin()
    for number in range(limit):
        give_up(course, f"(prescribe person_{number})")
        assert course.replan().again
    give_up(course, "(prescribe ann)")
    assert not course.replan().again
    assert course.verdict()[:2] == (Outcome.ACTION_FAILED, "(prescribe ann): the pharmacist said no")


def fail(course: Course, action: str, of_robot: str) -> None:
    """An action of one of several robots fails, always for the same reason."""
    course.dispatched = failed(action, of_robot=of_robot)
    run(course, ("DISPATCH_PLAN", "failed", f"{action}: the arm hangs"))


def test_what_one_robot_fails_to_do_twice_is_left_to_the_others() -> None:
    course = Course(3, replan_wait=0.0)
    course.begin()
    fail(course, "(pick tom cup)", "(pick tom *)")
    assert course.replan().again and course.without == []
    fail(course, "(pick tom cup)", "(pick tom *)")
    assert course.replan() == (True, 0.0, "")
    assert course.without == ["(pick tom *)"]
    run(course, ("PLAN", "unsolvable", "the problem has no plan"))
    verdict = course.verdict()
    assert (verdict.outcome, verdict.action) == (Outcome.ACTION_FAILED, "(pick tom cup)")
    assert verdict.reason == ("(pick tom cup): the arm hangs; no plan without it: the problem has no plan")


def test_a_planner_that_leaves_it_to_the_same_robot_ends_the_request() -> None:
    course = Course(9, replan_wait=0.0)
    course.begin()
    for again in (True, True, False):
        fail(course, "(pick tom cup)", "(pick tom *)")
        assert course.replan().again is again
    assert course.without == ["(pick tom *)"]


def test_a_planner_that_plans_it_all_the_same_ends_the_request() -> None:
    course = Course(3)
    course.begin()
    give_up(course, "(prescribe ann)")
    assert course.replan().again
    give_up(course, "(Prescribe Ann)")
    assert not course.replan().again


def test_newcomers_do_not_make_a_failing_action_be_tried_without_end() -> None:
    course, other = Course(3, replan_wait=0.0), Course(3)
    other.begin()
    run(other, ("DISPATCH_PLAN", "failed", "the door of the bath is locked"))
    other.dispatched = failed("", no_retry="(drive * bath)")
    other.replan()
    course.begin()
    again = []
    for number in range(5):
        course.take_in(other)
        course.dispatched = failed("(drive hall kitchen)")
        run(course, ("DISPATCH_PLAN", "failed", f"stuck {number}"))
        again.append(course.replan().again)
    assert again == [True, True, True, False, False]
    assert course.without == ["(drive * bath)"], "what a newcomer has given up, all do without"
