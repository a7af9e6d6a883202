# SPDX-License-Identifier: Apache-2.0
"""Requests that survive: the next life of the Executor takes up each that was not answered, and no other."""

import json
import os
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Iterator, List

import pytest
import rospy
from actionlib_msgs.msg import GoalStatus
from diagnostic_msgs.msg import KeyValue
from fakes.executor_bench import Bench, Goal, Knowledge

from merlin_executor.core.outcome import Outcome, Verdict
from merlin_executor.node import executor as executor_module
from merlin_executor.node.survivors import Survivors
from merlin_executor.resending import was_lost
from merlin_ros.service_proxy import ServiceUnavailable
from merlin_test import LONG


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(rospy.Time, "now", lambda: rospy.Time(7))
    for level in ("logwarn", "logerr"):
        monkeypatch.setattr(rospy, level, lambda *_: None)
    return tmp_path / "kept" / "goals"


@pytest.fixture
def lives(file: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """Makes one Executor after the other over the same file; each but the last was killed."""
    made: List[Bench] = []

    def live() -> Bench:
        made.append(Bench(monkeypatch, str(file)))
        return made[-1]

    yield live
    for bench in made:
        bench.executor.shutdown()


def lasting(*texts: str, **fields: Any) -> Goal:
    return Goal(*texts, survives=True, **fields)


def left(file: Path) -> List[str]:
    return [message.goal.goals[0] for message, _ in Survivors(str(file)).left()]


def test_what_was_noted_is_found_with_all_that_it_says(file: Path) -> None:
    goal = lasting("(checked kitchen)", priority=3, deadline=rospy.Time(50), value=2.5)
    assert not Survivors(str(file)).keep(goal)  # type: ignore[arg-type]
    later = Survivors(str(file))
    ((message, sender),) = later.left()
    assert message.goal == goal.goal and (message.goal_id.id, sender) == (goal.id, "/client")
    assert later.keep(goal)  # type: ignore[arg-type]
    later.drop(goal.id)
    assert left(file) == []


def test_the_end_of_the_last_one_is_on_the_disk(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    survivors, synced = Survivors(str(file)), []
    goal = lasting("(checked kitchen)")
    survivors.keep(goal)  # type: ignore[arg-type]
    fsync = os.fsync
    monkeypatch.setattr(os, "fsync", lambda number: (synced.append(number), fsync(number)))
    survivors.drop(goal.id)
    assert synced and left(file) == []


@pytest.mark.parametrize("note", ["nonsense", "[]", '["x", "y", "z"]', "3"])
def test_a_note_that_makes_no_sense_costs_no_other_one(file: Path, note: str) -> None:
    Survivors(str(file)).keep(lasting("(checked kitchen)"))  # type: ignore[arg-type]
    notes = Path(f"{file}.requests")
    notes.write_text(json.dumps([note, *json.loads(notes.read_text())]))
    assert left(file) == ["(checked kitchen)"]


def test_a_note_of_another_version_is_not_taken_up(file: Path) -> None:
    Survivors(str(file)).keep(lasting("(checked kitchen)"))  # type: ignore[arg-type]
    notes = Path(f"{file}.requests")
    (note,) = json.loads(notes.read_text())
    notes.write_text(json.dumps([json.dumps(["0123", *json.loads(note)[1:]])]))
    assert left(file) == []


def test_the_next_life_runs_what_was_not_answered(lives: Any, file: Path) -> None:
    first = lives()
    first.run(lasting("(checked kitchen)", priority=1))
    first.send(lasting("(checked hall)"))
    first.send(Goal("(not (checked hall))"))
    second = lives()
    assert [message.goal.goals for message, _ in second.left] == [["(checked kitchen)"], ["(checked hall)"]]
    running = second.run(lasting("(checked kitchen)", priority=1))
    waiting = second.send(lasting("(checked hall)"))
    assert [request.survives for request in second.queue()] == [True]
    second.machine.end(Verdict(Outcome.SUCCEEDED, "done"))
    assert running.end()[1] == "SUCCEEDED" and left(file) == ["(checked hall)"]
    second.cancel(waiting)
    assert waiting.end()[1] == "CANCELLED" and left(file) == []


def test_an_executor_that_goes_down_in_order_leaves_them_to_the_next(lives: Any, file: Path) -> None:
    bench = lives()
    bench.run(lasting("(checked kitchen)"))
    waiting = bench.send(lasting("(checked hall)"))
    bench.executor.shutdown()
    assert waiting.end()[2] == "the executor shuts down"
    assert left(file) == ["(checked kitchen)", "(checked hall)"]


@pytest.mark.parametrize("outcome", [Outcome.CANCEL_TIMEOUT, Outcome.INTERNAL, Outcome.ACTION_FAILED])
def test_what_does_not_end_in_order_meanwhile_is_left_too(lives: Any, file: Path, outcome: Outcome) -> None:
    bench = lives()
    goal = bench.run(lasting("(checked kitchen)"))
    bench.machine.stopped = Verdict(outcome, "(drive) did not stop")
    bench.executor.shutdown()
    assert goal.end()[1:] == (outcome.name, "the executor shuts down; (drive) did not stop")
    assert left(file) == ["(checked kitchen)"]


def test_one_that_is_achieved_while_the_executor_goes_down_has_ended(lives: Any, file: Path) -> None:
    bench = lives()
    goal = bench.run(lasting("(checked kitchen)"))
    bench.machine.stopped = Verdict(Outcome.SUCCEEDED, "done")
    bench.executor.shutdown()
    assert goal.end()[1] == "SUCCEEDED" and left(file) == []


def test_one_whose_deadline_passed_between_two_lives_is_late(lives: Any) -> None:
    lives().run(lasting("(checked kitchen)", deadline=rospy.Time(60)))
    second = lives()
    second.now = 100.0
    goal = second.send(lasting("(checked kitchen)", deadline=rospy.Time(60)))
    second.on_hold()  # the alarm of its deadline
    assert goal.end()[1] == "LATE"


def test_the_client_of_one_that_survives_does_not_matter(lives: Any) -> None:
    bench = lives()
    goal = bench.run(lasting("(checked kitchen)", on_client_lost=1))
    assert bench.callbacks["owner"](goal, bench.lost, "its client is gone") is False
    assert not goal.ended.is_set()
    bench.machine.end(Verdict(Outcome.SUCCEEDED, "done"))
    assert goal.end()[1] == "SUCCEEDED"


def test_one_that_cannot_be_noted_is_refused(lives: Any, file: Path) -> None:
    bench = lives()
    Path(f"{file}.requests.new").mkdir()
    assert "could not be noted" in bench.send(lasting("(checked kitchen)")).end()[2]


def test_an_id_that_nothing_has_any_more_is_said_to_have_ended(lives: Any) -> None:
    assert "it has ended" in lives().send(lasting()).end()[2]


@pytest.fixture
def world(monkeypatch: pytest.MonkeyPatch) -> Any:
    """What every knowledge base says from now on; it can be changed while an Executor runs."""
    said = SimpleNamespace(error=None, objects=["kitchen", "hall"], asked=threading.Semaphore(0))

    def predicates(knowledge: Knowledge) -> Any:
        said.asked.release()
        if said.error is not None:
            raise said.error
        return {"checked": SimpleNamespace(typed_parameters=[KeyValue(key="p", value="poi")])}

    monkeypatch.setattr(Knowledge, "predicates", predicates)
    monkeypatch.setattr(Knowledge, "instances", lambda *_: said.objects)
    monkeypatch.setattr(executor_module, "CHECK_AGAIN", 0.01)
    return said


def test_a_knowledge_base_that_is_slow_at_the_restart_costs_no_request(
    lives: Any, file: Path, world: Any
) -> None:
    first = lives()
    first.run(lasting("(checked kitchen)"))
    first.send(lasting("(checked hall)"))
    second = lives()
    world.error = ServiceUnavailable("it is being started")
    goals = [second.send(lasting("(checked kitchen)")), second.send(lasting("(checked hall)"))]
    for _ in range(4):
        assert world.asked.acquire(timeout=LONG)
    assert not any(goal.ends for goal in goals) and left(file) == ["(checked kitchen)", "(checked hall)"]
    world.error = None
    assert second.machine.begun.acquire(timeout=LONG)
    second.machine.end(Verdict(Outcome.SUCCEEDED, "done"))
    assert goals[0].end()[1] == "SUCCEEDED"


def test_while_it_is_silent_one_request_is_checked_and_no_other(lives: Any, world: Any) -> None:
    first, texts = lives(), ["(checked kitchen)", "(checked hall)", "(not (checked hall))"]
    for text in texts:
        first.send(lasting(text))
    second = lives()
    world.error = ServiceUnavailable("it hangs")
    executor_module.CHECK_AGAIN = LONG
    while world.asked.acquire(blocking=False):
        pass
    for text in texts:
        second.send(lasting(text))
    assert world.asked.acquire(blocking=False) and not world.asked.acquire(blocking=False)


def test_the_objects_of_a_request_may_be_added_after_the_start(lives: Any, file: Path, world: Any) -> None:
    lives().run(lasting("(checked kitchen)"))
    second = lives()
    world.objects = []
    goal = second.send(lasting("(checked kitchen)"))
    assert not goal.ends and left(file) == ["(checked kitchen)"]
    (shown,) = second.queue()
    assert shown.waits == "(checked kitchen): there is no object 'kitchen'"
    world.objects = ["kitchen"]
    assert second.machine.begun.acquire(timeout=LONG)
    second.machine.end(Verdict(Outcome.SUCCEEDED, "done"))
    assert goal.end()[1] == "SUCCEEDED" and second.queue() == []


def test_an_executor_that_goes_down_checks_none_again(lives: Any, file: Path, world: Any) -> None:
    first = lives()
    first.run(lasting("(checked kitchen)"))
    second = lives()
    world.error = ServiceUnavailable("it is being started")
    goal = second.send(lasting("(checked kitchen)"))
    second.executor.shutdown()
    while world.asked.acquire(timeout=20 * executor_module.CHECK_AGAIN):
        pass
    world.error = None
    assert not second.machine.begun.acquire(timeout=20 * executor_module.CHECK_AGAIN)
    assert not goal.ends and left(file) == ["(checked kitchen)"]


def test_objects_that_never_come_are_named(
    lives: Any, file: Path, world: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    lives().run(lasting("(checked kitchen)"))
    monkeypatch.setattr(executor_module, "LOAD_WAIT", 0.0)
    second = lives()
    world.objects = []
    goal = second.send(lasting("(checked kitchen)"))
    assert goal.end()[1:] == ("REFUSED", "(checked kitchen): there is no object 'kitchen'")
    assert left(file) == []


def test_one_that_waits_for_the_knowledge_base_can_be_cancelled(lives: Any, file: Path, world: Any) -> None:
    first = lives()
    first.run(lasting("(checked kitchen)"))
    first.send(lasting("(checked hall)"))
    second = lives()
    world.error = ServiceUnavailable("it hangs")
    executor_module.CHECK_AGAIN = LONG
    goals = [second.send(lasting("(checked kitchen)")), second.send(lasting("(checked hall)"))]
    assert [(each.request, each.goals, each.survives) for each in second.queue()] == [
        (goal.id, goal.goal.goals, True) for goal in goals
    ]
    assert {each.waits for each in second.queue()} == {
        "the goals could not be checked: the planning system's knowledge base: it hangs"
    }
    second.cancel(goals[0])
    assert goals[0].end()[1] == "CANCELLED" and left(file) == ["(checked hall)"]
    assert [each.request for each in second.queue()] == [goals[1].id]


def test_who_follows_one_while_the_executor_goes_down_costs_it_nothing(lives: Any, file: Path) -> None:
    bench = lives()
    goal = bench.run(lasting("(checked kitchen)"))
    bench.executor.shutdown()
    follower = lasting()
    follower.id = goal.id
    status, _, reason = bench.send(follower).end()
    assert was_lost(status, "", reason), "it is sent to the next life"
    assert left(file) == ["(checked kitchen)"]


def test_a_cancel_of_an_id_that_nothing_has_is_not_said_to_have_worked(lives: Any) -> None:
    goal = lasting()
    goal.cancel_requested = True  # the cancel overtakes the goal that looks for it
    status, outcome, reason = lives().send(goal).end()
    assert (status, outcome) == (GoalStatus.REJECTED, "REFUSED") and "no request of this id" in reason


@pytest.mark.parametrize("value", [-1.0, float("nan"), float("inf")])
def test_a_value_that_is_none_is_refused(lives: Any, value: float) -> None:
    status, outcome, reason = lives().send(Goal("(checked kitchen)", value=value)).end()
    assert outcome == "REFUSED" and "above 0" in reason


def test_a_client_without_a_value_is_worth_one(lives: Any) -> None:
    bench = lives()
    bench.run(Goal("(checked kitchen)"))
    bench.send(Goal("(checked hall)"))
    assert [request.value for request in bench.queue()] == [1.0]
