# SPDX-License-Identifier: Apache-2.0
"""The Executor answers every request once, whatever its stages do; over stages of the test's."""

import io
import math
from typing import Any, Iterator, List

import pytest
import rospy
from actionlib_msgs.msg import GoalStatus
from fakes.executor_bench import Bench, Goal
from merlin_msgs.msg import ExecuteGoal, ExecutorStatus, RunningAction
from rosplan_dispatch_msgs.msg import ActionDispatch
from rosplan_knowledge_msgs.msg import ExprBase, KnowledgeItem

from merlin_executor.core.outcome import Outcome, Verdict, outcome_name
from merlin_executor.node import executor as executor_module
from merlin_ros.actions.lease import LeaseState
from merlin_ros.health import OK, WARN
from merlin_ros.service_proxy import ServiceUnavailable
from merlin_test import LONG


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    made = Bench(monkeypatch)
    yield made
    made.executor.shutdown()


def test_a_pause_lets_the_running_request_go_on_and_keeps_the_next_one_waiting(bench: Bench) -> None:
    first = bench.run(Goal("(checked kitchen)"))
    bench.pause(True)
    second = bench.send(Goal("(checked hall)"))
    bench.machine.end(Verdict(Outcome.SUCCEEDED, "done"))
    assert first.end()[1] == "SUCCEEDED"
    assert not bench.machine.begun.acquire(blocking=False) and bench.statuses
    bench.pause(False)
    assert bench.machine.begun.acquire(timeout=LONG)
    bench.machine.end(Verdict(Outcome.SUCCEEDED, "done"))
    assert second.end()[1] == "SUCCEEDED"


def test_an_urgent_request_waits_until_the_machine_leaves_its_state(bench: Bench) -> None:
    first = bench.run(Goal("(checked kitchen)"))
    bench.dispatch(RunningAction(name="deliver", uninterruptible=True))
    urgent = bench.send(Goal("(checked hall)", priority=1))
    assert [request.waits for request in bench.queue()] == ["waits until (deliver) can be interrupted"]
    assert urgent.reported == [bench.queue()[0].waits]
    assert bench.status().urgent_waits == urgent.reported[0]
    bench.dispatch(RunningAction(name="deliver"))
    assert bench.machine.begun.acquire(timeout=LONG)  # the urgent one
    bench.dispatch()
    bench.machine.end(Verdict(Outcome.SUCCEEDED, "done"))
    assert urgent.end()[1] == "SUCCEEDED"
    assert bench.machine.begun.acquire(timeout=LONG)
    bench.machine.end(Verdict(Outcome.SUCCEEDED, "done"))
    assert first.end()[1] == "SUCCEEDED"


def test_a_request_that_is_never_interrupted_ends_first(bench: Bench) -> None:
    first = bench.run(Goal("(checked kitchen)", on_interrupt=ExecuteGoal.NEVER))
    urgent = bench.send(Goal("(checked hall)", priority=1))
    assert urgent.reported == ["waits until (checked kitchen) has ended"]
    bench.cancel(first)
    assert first.end()[1] == "CANCELLED"
    assert bench.machine.begun.acquire(timeout=LONG)
    assert bench.queue() == [] and urgent.reported[-1] == ""


def test_a_request_is_run_and_answered(bench: Bench) -> None:
    goal = bench.run(Goal("(checked kitchen)"))
    bench.machine.end(Verdict(Outcome.SUCCEEDED, "done"))
    assert goal.end() == (GoalStatus.SUCCEEDED, "SUCCEEDED", "done")
    assert bench.executor.health().message == "idle"


@pytest.mark.parametrize("outcome", list(Outcome))
def test_only_software_makes_it_ill(bench: Bench, outcome: Outcome) -> None:
    assert bench.executor.health() == (OK, "idle", {"waiting requests": 0, "last request": ""})
    goal = bench.run(Goal("(checked kitchen)"))
    bench.machine.end(Verdict(outcome, "because"))
    goal.end()
    health = bench.executor.health()
    assert (health.level == WARN) == ("because" in health.message) == outcome.of_software
    assert health.values["last request"] == "(checked kitchen): because"


@pytest.mark.parametrize(
    ("goal", "why"),
    [
        (Goal("(and " * 1000 + "(checked kitchen)" + ")" * 1000), "nested deeper than 100"),
        (Goal("(checked kitchen)" + " " * 70_000), "characters; they may have 65536"),
        (Goal(*["(checked kitchen)"] * 1001), "1001 goals; it may have 1000"),
        (Goal("(and " + "(checked kitchen)" * 1001 + ")"), "1001 goals; it may have 1000"),
        (Goal("(checked moon)"), "no object 'moon'"),
        (Goal(), "no goals"),
    ],
)
def test_what_is_too_large_or_makes_no_sense_is_refused_with_the_reason(
    bench: Bench, goal: Goal, why: str
) -> None:
    status, outcome, reason = bench.send(goal).end()
    assert (status, outcome) == (GoalStatus.REJECTED, "REFUSED")
    assert why in reason and len(reason) < 500


def test_an_item_that_no_parser_has_seen_is_refused_too(bench: Bench) -> None:
    deep = KnowledgeItem(knowledge_type=KnowledgeItem.INEQUALITY)
    deep.ineq.LHS.tokens = [ExprBase(expr_type=ExprBase.OPERATOR, op=ExprBase.ADD)] * 5000
    assert "5000 tokens" in bench.send(Goal(items=[deep])).end()[2]


@pytest.mark.parametrize(
    "error", [RecursionError("too deep"), MemoryError(), SystemExit(3), KeyError("x"), KeyboardInterrupt()]
)
def test_whatever_is_raised_while_a_request_is_read_it_is_answered(
    bench: Bench, error: BaseException
) -> None:
    bench.knowledge.error = error
    status, outcome, reason = bench.send(Goal("(checked kitchen)")).end()
    assert (status, outcome) == (GoalStatus.REJECTED, "REFUSED")
    assert type(error).__name__ in reason


def test_a_knowledge_base_that_is_gone_is_named(bench: Bench) -> None:
    bench.knowledge.error = ServiceUnavailable("service /kb/x does not answer: its node does not run")
    assert "its node does not run" in bench.send(Goal("(checked kitchen)")).end()[2]


@pytest.mark.parametrize("error", [RuntimeError("odd"), SystemExit(1), RecursionError(), MemoryError("full")])
def test_whatever_a_run_raises_its_client_is_answered_and_the_next_request_runs(
    bench: Bench, error: BaseException
) -> None:
    goal = bench.run(Goal("(checked kitchen)"))
    bench.machine.end(error)
    status, outcome, reason = goal.end()
    assert (status, outcome) == (GoalStatus.ABORTED, "INTERNAL")
    assert type(error).__name__ in reason
    assert bench.machine.goals_removed == 1
    following = bench.run(Goal("(checked hall)"))
    bench.machine.end(Verdict(Outcome.ALREADY_TRUE))
    assert following.end()[1] == "ALREADY_TRUE"


def test_a_cancel_reaches_the_running_request_only(bench: Bench) -> None:
    running, waiting = bench.run(Goal("(checked kitchen)")), bench.send(Goal("(checked hall)"))
    bench.cancel(waiting)
    assert waiting.end()[1:] == ("CANCELLED", "cancelled before it began")
    assert not running.ended.is_set()
    bench.cancel(running)
    assert running.end() == (GoalStatus.PREEMPTED, "CANCELLED", "cancelled by its client")


def test_a_cancel_that_something_does_not_obey_is_reported(bench: Bench) -> None:
    bench.machine.unstoppable = True
    goal = bench.run(Goal("(checked kitchen)"))
    bench.cancel(goal)
    assert goal.end() == (GoalStatus.ABORTED, "CANCEL_TIMEOUT", "(drive) did not stop")
    assert "did not stop" in bench.executor.health().message


def test_an_interrupted_request_that_does_not_stop_ends_so_and_the_urgent_one_runs(bench: Bench) -> None:
    bench.machine.unstoppable = True
    goal = bench.run(Goal("(checked kitchen)"))
    urgent = bench.run(Goal("(checked hall)", priority=3))
    assert goal.end()[1] == "CANCEL_TIMEOUT"
    bench.machine.end(Verdict(Outcome.SUCCEEDED))
    assert urgent.end()[1] == "SUCCEEDED"


def test_an_interrupted_request_resumes(bench: Bench) -> None:
    goal = bench.run(Goal("(checked kitchen)"))
    urgent = bench.run(Goal("(checked hall)", priority=3))
    bench.machine.end(Verdict(Outcome.SUCCEEDED))
    assert urgent.end()[1] == "SUCCEEDED"
    assert bench.machine.begun.acquire(timeout=LONG)
    bench.machine.end(Verdict(Outcome.SUCCEEDED))
    assert goal.end()[1] == "SUCCEEDED"


@pytest.mark.parametrize("goes_on", [True, False])
def test_a_client_that_dies_takes_its_request_along_unless_that_goes_on(bench: Bench, goes_on: bool) -> None:
    lost = ExecuteGoal.GO_ON if goes_on else ExecuteGoal.CANCEL
    goal = bench.run(Goal("(checked kitchen)", on_client_lost=lost))
    owner = bench.callbacks["owner"]
    assert owner(goal, LeaseState.SUSPENDED, "its client /x is silent") is not goes_on
    assert owner(goal, LeaseState.LOST, "its client /x is gone") is not goes_on
    if goes_on:
        bench.machine.end(Verdict(Outcome.SUCCEEDED))
        assert goal.end()[1] == "SUCCEEDED"
    else:
        assert goal.end()[1:] == ("CANCELLED", "cancelled: its client /x is gone")


def test_a_request_whose_client_dies_while_it_is_checked_is_not_cancelled_before_it_was_read(
    bench: Bench,
) -> None:
    goal = Goal("(checked kitchen)", on_client_lost=ExecuteGoal.GO_ON)
    reported: List[Any] = []
    owner = bench.callbacks["owner"]
    bench.knowledge.on_check = lambda: reported.append(owner(goal, LeaseState.LOST, "its client /x is gone"))
    bench.run(goal)
    assert reported == [False]  # the server leaves it alone
    assert owner(goal, LeaseState.LOST, "its client /x is gone") is False
    bench.machine.end(Verdict(Outcome.SUCCEEDED))
    assert goal.end()[1] == "SUCCEEDED"


def test_a_comparison_that_no_knowledge_base_takes_is_refused(bench: Bench) -> None:
    for text in ("(>= (battery) 1e999)", "(<= (battery) (- 1e999))"):
        assert bench.send(Goal(text)).end()[1] == "REFUSED"
    empty = KnowledgeItem(knowledge_type=KnowledgeItem.INEQUALITY)
    assert bench.send(Goal(items=[empty])).end()[1] == "REFUSED"
    goal = bench.run(Goal("(>= (battery) 20.5)"))
    bench.machine.end(Verdict(Outcome.SUCCEEDED))
    assert goal.end()[1] == "SUCCEEDED"


@pytest.mark.parametrize("field", ["on_interrupt", "on_client_lost"])
def test_a_choice_that_the_message_does_not_know_is_refused(bench: Bench, field: str) -> None:
    status, outcome, reason = bench.send(Goal("(checked hall)", **{field: 9})).end()
    assert (status, outcome) == (GoalStatus.REJECTED, "REFUSED")
    assert reason.startswith(f"{field} of the request is 9; it has to be one of")


def test_a_name_without_end_is_refused_in_few_words(bench: Bench) -> None:
    endless = KnowledgeItem(knowledge_type=KnowledgeItem.FACT, attribute_name="x" * 1_000_000)
    outcome, reason = bench.send(Goal(items=[endless])).end()[1:]
    assert outcome == "REFUSED" and len(reason) < 3000


def test_what_cannot_be_read_and_was_taken_back_meanwhile_is_cancelled(bench: Bench) -> None:
    goal = Goal("(checked")
    goal.cancel_requested = True
    status, outcome, reason = bench.send(goal).end()
    assert (status, outcome) == (GoalStatus.PREEMPTED, "CANCELLED")
    assert reason.startswith("cancelled before it began; ")


def test_the_end_of_the_executor_answers_all(bench: Bench) -> None:
    running, waiting = bench.run(Goal("(checked kitchen)")), bench.send(Goal("(checked hall)"))
    bench.executor.shutdown()
    for goal in (running, waiting):
        assert goal.end()[1:] == ("CANCELLED", "the executor shuts down")
    assert bench.send(Goal("(checked hall)")).end()[1] == "REFUSED"


@pytest.mark.parametrize("part", ["Request", "decide"])
def test_a_client_that_is_gone_while_its_request_is_read_does_not_end_one_that_goes_on(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, part: str
) -> None:
    goal = Goal("(checked kitchen)", on_client_lost=ExecuteGoal.GO_ON)
    reported: List[Any] = []
    of: Any = executor_module if part == "Request" else executor_module.Engine
    once = getattr(of, part)

    def gone_before(*arguments: Any) -> Any:
        monkeypatch.setattr(of, part, once)
        reported.append(bench.callbacks["owner"](goal, LeaseState.LOST, "its client /x is gone"))
        return once(*arguments)

    monkeypatch.setattr(of, part, gone_before)
    bench.run(goal)
    assert reported == [False]  # the server asks again when it has the request
    bench.machine.end(Verdict(Outcome.SUCCEEDED))
    assert goal.end()[0] == GoalStatus.SUCCEEDED


def test_what_the_action_server_ends_itself_did_not_succeed(bench: Bench) -> None:
    for status, outcome in ((GoalStatus.RECALLED, "CANCELLED"), (GoalStatus.ABORTED, "INTERNAL")):
        result = bench.callbacks["own result"](GoalStatus(status=status, text="why"))
        assert (outcome_name(result.outcome), result.reason) == (outcome, "why")


def test_while_a_base_is_held_requests_wait_and_the_status_says_for_what(bench: Bench) -> None:
    bench.guard.hold = "the base is held by Ana since 14:03:07"
    bench.on_hold()
    goal = bench.send(Goal("(checked kitchen)"))
    bench.pause(False)  # somebody resumes
    assert not bench.machine.running
    bench.guard.hold = ""
    bench.on_hold()
    assert bench.machine.begun.acquire(timeout=LONG)
    waits = [each.waits for each in bench.statuses if isinstance(each, ExecutorStatus)]
    assert "the base is held by Ana since 14:03:07" in waits and waits[-1] == ""
    bench.machine.end(Verdict(Outcome.SUCCEEDED))
    assert goal.end()[1] == "SUCCEEDED"


def test_a_request_that_waits_ends_at_its_deadline_and_is_reported_before(bench: Bench) -> None:
    first = bench.run(Goal("(checked kitchen)"))
    action = ActionDispatch(name="drive", dispatch_time=0.0, duration=60.0)
    bench.machine.running[0].take_plan([action])  # it is expected to end at 61
    times = {"not_before": rospy.Time(2), "deadline": rospy.Time(31)}
    second = bench.send(Goal("(checked hall)", **times))
    late = "(checked kitchen) is expected to run until 61.0 s, and the deadline of this one is 31.0 s"
    assert second.reported == [late]
    queued = bench.queue()[0]
    assert (queued.not_before, queued.deadline, queued.expected_begin, queued.late) == (
        rospy.Time(2),
        rospy.Time(31),
        rospy.Time(61),
        late,
    )
    bench.now = 31.0
    bench.pause(False)  # any event, and the alarm
    missed = "late: its goals do not hold by its deadline 31.0 s"
    assert second.end() == (GoalStatus.REJECTED, "LATE", missed)
    bench.machine.end(Verdict(Outcome.SUCCEEDED))
    assert first.end()[1] == "SUCCEEDED" and bench.queue() == []


def test_a_request_that_runs_is_reported_and_stopped_at_its_deadline(bench: Bench) -> None:
    goal = bench.run(Goal("(checked kitchen)", deadline=rospy.Time(31)))
    action = ActionDispatch(name="drive", dispatch_time=0.0, duration=60.0)
    bench.machine.running[0].take_plan([action])
    bench.pause(False)
    status = bench.status()
    assert (status.deadline, status.expected_end) == (rospy.Time(31), rospy.Time(61))
    late = "its plan is expected to end at 61.0 s, after its deadline 31.0 s"
    assert status.late == late and goal.reported[-1] == late
    bench.now = 31.0
    bench.pause(False)
    missed = "late: its goals do not hold by its deadline 31.0 s"
    assert goal.end() == (GoalStatus.ABORTED, "LATE", missed)


def test_a_request_that_runs_is_never_expected_to_have_ended(bench: Bench) -> None:
    bench.run(Goal("(checked kitchen)"))
    bench.machine.running[0].take_plan([ActionDispatch(name="drive", duration=60.0)])
    for bench.now, end in ((2.0, 61), (90.0, 90)):
        bench.pause(False)
        assert bench.status().expected_end == rospy.Time(end)


@pytest.mark.parametrize("duration", [1e10, 1e30, math.inf])
def test_a_plan_that_never_ends_is_reported(bench: Bench, duration: float) -> None:
    bench.now = 1.8e9
    bench.run(Goal("(checked kitchen)", deadline=rospy.Time(1_800_000_031)))
    bench.machine.running[0].take_plan([ActionDispatch(name="wait", duration=duration)])
    bench.pause(False)
    status = bench.status()
    assert status.expected_end == rospy.Time(2**32 - 1) and "after its deadline" in status.late
    status.serialize(io.BytesIO())


def test_a_request_begins_when_its_time_has_come_without_another_event(bench: Bench) -> None:
    goal = bench.send(Goal("(checked kitchen)", not_before=rospy.Time(1, 50_000_000)))
    assert not bench.machine.begun.acquire(blocking=False)
    bench.now = 1.05
    assert bench.machine.begun.acquire(timeout=LONG)
    bench.machine.end(Verdict(Outcome.SUCCEEDED, "done"))
    assert goal.end()[1] == "SUCCEEDED"


def test_a_deadline_that_has_passed_is_refused(bench: Bench) -> None:
    bench.now = 40.0
    why = "its deadline 31.0 s passed 9 s ago"
    goal = bench.send(Goal("(checked kitchen)", deadline=rospy.Time(31)))
    assert goal.end() == (GoalStatus.REJECTED, "REFUSED", why)
