# SPDX-License-Identifier: Apache-2.0
"""What the Executor says and answers of requests that run together; over stages of the test's."""

from typing import Iterator, List

import pytest
from actionlib_msgs.msg import GoalStatus
from fakes.executor_bench import Bench, Goal
from merlin_msgs.msg import ExecutorStatus, RunningAction

from merlin_executor.core.agenda import Refusal
from merlin_executor.core.outcome import Outcome, Verdict
from merlin_test import LONG


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    made = Bench(monkeypatch)
    yield made
    made.executor.shutdown()


def run_together(bench: Bench, *goals: Goal) -> List[Goal]:
    """Requests that wait begin as one."""
    bench.pause(True)
    for goal in goals:
        bench.send(goal)
    bench.pause(False)
    assert bench.machine.begun.acquire(timeout=LONG)
    return list(goals)


def test_requests_that_run_together_have_one_status_and_an_answer_each(bench: Bench) -> None:
    first, second = run_together(bench, Goal("(checked kitchen)"), Goal("(checked hall)", by="Ana"))
    bench.pause(False)  # any event
    status = bench.status()
    assert (status.request, status.goals) == (first.id, ["(checked kitchen)"])
    assert [(each.request, each.goals, each.by) for each in status.together] == [
        (second.id, ["(checked hall)"], "Ana")
    ]
    assert first.reported and second.reported and bench.queue() == []
    assert bench.executor.health().message == "running (checked kitchen), (checked hall)"
    bench.machine.end(Verdict(Outcome.SUCCEEDED, "done"))
    assert [goal.end()[1] for goal in (first, second)] == ["SUCCEEDED"] * 2


def test_the_cancel_of_one_lets_the_other_begin_again(bench: Bench) -> None:
    first, second = run_together(bench, Goal("(checked kitchen)"), Goal("(checked hall)"))
    bench.cancel(first)
    assert first.end()[1:] == ("CANCELLED", "cancelled by its client")
    assert bench.machine.begun.acquire(timeout=LONG)
    bench.machine.end(Verdict(Outcome.SUCCEEDED, "done"))
    assert second.end()[1] == "SUCCEEDED"


@pytest.mark.parametrize("exchanged", [True, False])
def test_the_status_says_cancelling_when_all_stops_and_not_when_one_leaves(
    bench: Bench, exchanged: bool
) -> None:
    bench.machine.revises, bench.machine.cancel = True, lambda: None  # type: ignore[method-assign]
    first, second = run_together(bench, Goal("(checked kitchen)"), Goal("(checked hall)"))
    bench.cancel(first)
    bench.pause(False)  # any event
    assert bench.status().state == ExecutorStatus.RUNNING
    engine = bench.engine()
    engine.revised(engine.revision(), None if exchanged else Refusal())
    if not exchanged:
        assert bench.status().state == ExecutorStatus.CANCELLING
        bench.machine.end(Verdict(Outcome.CANCELLED, "cancelled"))
        assert bench.machine.begun.acquire(timeout=LONG)
    assert first.end()[1] == "CANCELLED"
    bench.machine.end(Verdict(Outcome.SUCCEEDED, "done"))
    assert second.end()[1] == "SUCCEEDED"


def test_the_status_says_cancelling_before_anything_else_happens(bench: Bench) -> None:
    bench.machine.cancel = lambda: None  # type: ignore[method-assign]
    goal = bench.run(Goal("(checked kitchen)"))
    bench.cancel(goal)
    assert bench.status().state == ExecutorStatus.CANCELLING
    bench.machine.end(Verdict(Outcome.CANCELLED, "cancelled"))
    assert goal.end()[1] == "CANCELLED"


def test_cancels_of_all_say_nothing_but_statuses_until_the_end(bench: Bench) -> None:
    bench.machine.revises, bench.machine.cancel = True, lambda: None  # type: ignore[method-assign]
    goals = run_together(bench, Goal("(checked kitchen)"), Goal("(checked hall)"))
    bench.dispatch(RunningAction(name="drive"))
    published, reported = len(bench.statuses), [[*goal.reported] for goal in goals]
    for goal in goals:
        bench.cancel(goal)
    bench.dispatch()
    assert not any(hasattr(message, "requests") for message in bench.statuses[published:]), "none waits"
    assert [goal.reported for goal in goals] == reported
    bench.machine.end(Verdict(Outcome.CANCELLED, "cancelled"))
    assert [goal.end()[1] for goal in goals] == ["CANCELLED"] * 2


def test_the_status_is_not_published_for_one_that_does_not_join(bench: Bench) -> None:
    bench.machine.revises = True
    goals = [bench.run(Goal("(checked kitchen)")), bench.send(Goal("(checked hall)"))]
    engine = bench.engine()
    engine.revised(engine.revision(), Refusal("no time"))
    published = len(bench.statuses)
    engine.look()
    assert bench.queue()[0].waits == "does not join (checked kitchen): no time"
    assert bench.statuses[published:] == [bench.statuses[-1]], "nothing but the queue"
    for goal in goals:
        bench.machine.end(Verdict(Outcome.SUCCEEDED, "done"))
        assert goal.end()[1] == "SUCCEEDED"
        assert goal is goals[1] or bench.machine.begun.acquire(timeout=LONG)


def test_one_whose_goals_hold_is_answered_while_the_other_runs(bench: Bench) -> None:
    first, second = run_together(bench, Goal("(checked kitchen)"), Goal("(checked hall)"))
    bench.engine().achieved(bench.machine.running[:1], Verdict(Outcome.SUCCEEDED, "the goal holds"))
    assert first.end() == (GoalStatus.SUCCEEDED, "SUCCEEDED", "the goal holds")
    status = bench.status()
    assert (status.request, status.together) == (second.id, [])
    assert not second.ended.is_set()
    bench.machine.end(Verdict(Outcome.SUCCEEDED, "done"))
    assert second.end()[1] == "SUCCEEDED"


def test_one_that_forbids_it_runs_alone(bench: Bench) -> None:
    first, alone = run_together(bench, Goal("(checked kitchen)"), Goal("(checked hall)", alone=True))
    assert len(bench.machine.running) == 1
    for goal in (first, alone):
        bench.machine.end(Verdict(Outcome.SUCCEEDED, "done"))
        assert goal.end()[1] == "SUCCEEDED"
        assert goal is alone or bench.machine.begun.acquire(timeout=LONG)
