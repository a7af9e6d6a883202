# SPDX-License-Identifier: Apache-2.0
"""Requests join and leave a run in mid-drive: Executor's engine and machine over a robot of the test's."""

import itertools
import random
import threading
from types import SimpleNamespace
from typing import Any, Callable, List

import pytest
from diagnostic_msgs.msg import KeyValue
from fakes.revision_bench import Bench, Robot, by, end, text
from merlin_msgs.msg import PlannerStatus, RunningAction
from rosplan_dispatch_msgs.msg import ActionDispatch

from merlin_executor.node import plan_revision
from merlin_executor.node.plan_revision import PlanRevision
from merlin_sm.states import planning
from merlin_test import LONG


def test_a_newcomer_joins_in_mid_drive_and_the_drive_goes_on(bench: Bench, robot: Robot) -> None:
    first, second = bench.joined()
    assert robot.cancelled == [] and robot.began == ["(drive hall kitchen)"]
    assert [text(step) for step in second.plan][0] == "(drive hall kitchen)"
    assert robot.end_action() and robot.end_action()
    assert end(first)[1] == "SUCCEEDED"
    bench.carry_on(second)
    assert end(second)[1] == "SUCCEEDED"
    assert robot.began == ["(drive hall kitchen)", "(check kitchen)", "(drive kitchen bath)", "(check bath)"]
    assert robot.cancelled == [] and robot.owners[-1] == second.goal.id


def test_no_newcomer_is_planned_before_the_dispatcher_has_the_plan_before(bench: Bench, robot: Robot) -> None:
    robot.slow_to_begin = True
    first = bench.send("(checked kitchen)")
    robot.wait(lambda: robot.owners)
    second = bench.send("(checked bath)")
    robot.wait(lambda: robot.awaited or robot.asked == 2)
    assert robot.asked == 1
    with robot.changed:
        robot.slow_to_begin = False
        robot.changed.notify_all()
    robot.wait(lambda: robot.began)
    robot.on_change()
    bench.members(first, second)
    bench.carry_on(first, second)
    assert [end(each)[1] for each in (first, second)] == ["SUCCEEDED"] * 2


@pytest.mark.parametrize("leave_limit", [0.1])
@pytest.mark.parametrize("leaves", [0, 1])
def test_a_cancel_before_the_dispatcher_has_the_plan_has_an_end(
    bench: Bench, robot: Robot, leaves: int
) -> None:
    bench.engine.decide(lambda agenda: agenda.pause(True))
    both = [bench.send("(checked kitchen)"), bench.send("(checked bath)")]
    robot.slow_to_begin = True
    bench.engine.decide(lambda agenda: agenda.pause(False))
    robot.wait(lambda: robot.owners)
    bench.cancel(both[leaves])
    assert end(both[leaves])[1] == "CANCELLED"
    with robot.changed:
        robot.slow_to_begin = False
        robot.changed.notify_all()
    bench.carry_on(*both)
    assert end(both[1 - leaves])[1] == "SUCCEEDED"


def test_the_new_plan_begins_behind_all_that_runs(bench: Bench, robot: Robot) -> None:
    first = bench.driving("(checked kitchen)")  # 5 s from now
    with robot.changed:  # of a second robot
        first.plan.append(ActionDispatch(action_id=1000, name="wave", duration=90.0))
        robot.under_way.append(RunningAction(action_id=1000, name="wave"))
    second = bench.send("(checked bath)")
    bench.members(first, second)
    assert robot.after == ["(drive hall kitchen)", "(wave)"]
    with robot.changed:
        del robot.under_way[1]
    bench.carry_on(first, second)


def test_the_drive_of_the_other_one_goes_on_when_one_is_cancelled(bench: Bench, robot: Robot) -> None:
    first, second = bench.joined()
    bench.cancel(second)
    assert end(second)[1:] == ("CANCELLED", "cancelled by its client")
    assert robot.cancelled == [] and robot.stored == ["(checked kitchen)"]
    bench.carry_on(first)
    assert end(first)[1] == "SUCCEEDED" and "(drive kitchen bath)" not in robot.began


@pytest.mark.parametrize("state", [PlannerStatus.CANCELLED, PlannerStatus.TIMEOUT, PlannerStatus.INVALID])
@pytest.mark.parametrize("times", [1, 2])
def test_what_the_others_need_is_asked_once_more_when_the_planner_does_not_say(
    bench: Bench, robot: Robot, state: int, times: int
) -> None:
    first, second = bench.joined()
    robot.unknown = [state] * times
    bench.cancel(second)
    assert end(second)[1:] == ("CANCELLED", "cancelled by its client") and robot.unknown == []
    bench.carry_on(first)
    assert end(first)[1] == "SUCCEEDED"
    assert robot.cancelled == ["(drive hall kitchen)"] * (times - 1)


def test_a_drive_that_only_the_cancelled_one_needs_is_stopped(bench: Bench, robot: Robot) -> None:
    first, second = bench.joined()
    bench.cancel(first)
    assert end(first)[1] == "CANCELLED" and robot.cancelled == ["(drive hall kitchen)"]
    bench.carry_on(second)
    assert end(second)[1] == "SUCCEEDED"
    assert robot.began == ["(drive hall kitchen)", "(drive anywhere bath)", "(check bath)"]


def test_a_newcomer_that_has_no_plan_waits_and_ends_by_itself(bench: Bench, robot: Robot) -> None:
    robot.impossible = "(checked attic)"
    first = bench.driving("(checked kitchen)")
    second = bench.send("(checked attic)")
    robot.wait(lambda: robot.asked == 3 and robot.stored == ["(checked kitchen)"])
    assert bench.engine.agenda.together == [first] and robot.cancelled == []
    bench.carry_on(first)
    assert end(first)[1] == "SUCCEEDED"
    assert end(second)[1] == "UNSOLVABLE"


@pytest.mark.parametrize("refusals", [1, 2])
def test_a_refusal_is_tried_once_more(bench: Bench, robot: Robot, refusals: int) -> None:
    answers = ["the dispatch has moved on"] * refusals
    robot.on_exchange = lambda: answers.pop() if answers else ""
    first = bench.driving("(checked kitchen)")
    second = bench.send("(checked bath)")
    robot.wait(lambda: not answers)
    if refusals == 1:
        bench.members(first, second)
    bench.carry_on(first, second)
    assert answers == [] and robot.cancelled == []
    assert [end(each)[1] for each in (first, second)] == ["SUCCEEDED"] * 2


@pytest.mark.parametrize("ends", [2, 3])
def test_what_has_been_done_while_a_newcomer_was_planned_is_not_done_again(
    bench: Bench, robot: Robot, ends: int
) -> None:
    def go_on() -> None:
        robot.on_planned = lambda: None
        assert all(robot.end_action() for _ in range(ends))

    first = bench.driving("(and (checked kitchen) (checked attic))")
    robot.on_planned = go_on
    second = bench.send("(checked bath)")
    bench.members(first, second)
    bench.carry_on(first, second)
    assert [end(each)[1] for each in (first, second)] == ["SUCCEEDED"] * 2
    assert robot.cancelled == [] and len(robot.began) == len(set(robot.began)) == 6


def test_what_began_while_a_newcomer_was_planned_and_comes_later_in_the_new_plan_is_done_once(
    bench: Bench, robot: Robot
) -> None:
    def go_on() -> None:
        robot.on_planned = lambda: None
        plan = robot.plans[-1]  # of (check kitchen), (drive kitchen attic), …
        plan += [plan.pop(0)]
        assert robot.end_action()

    first = bench.driving("(and (checked kitchen) (checked attic))")
    robot.on_planned = go_on
    second = bench.send("(checked bath)")
    bench.members(first, second)
    bench.carry_on(first, second)
    assert [end(each)[1] for each in (first, second)] == ["SUCCEEDED"] * 2
    assert robot.cancelled == [] and len(robot.began) == len(set(robot.began)) == 6


def test_a_newcomer_taken_back_while_it_is_planned_leaves_nothing(bench: Bench, robot: Robot) -> None:
    first = bench.driving("(checked kitchen)")
    asked, go_on = threading.Event(), threading.Event()

    def exchange() -> str:
        asked.set()
        assert go_on.wait(LONG)
        return ""

    robot.on_exchange = exchange
    second = bench.send("(checked bath)")
    assert asked.wait(LONG)
    bench.cancel(second)
    assert end(second)[1] == "CANCELLED"
    go_on.set()
    robot.wait(lambda: robot.stored == ["(checked kitchen)"] and len(robot.plan_of_run) == 1)
    bench.carry_on(first)
    assert "(drive kitchen bath)" not in robot.began and robot.cancelled == []


@pytest.mark.parametrize("hanging", ["update", "generate_problem", "plan"])
def test_what_hangs_keeps_neither_the_run_nor_its_cancel(bench: Bench, robot: Robot, hanging: str) -> None:
    first = bench.driving("(checked kitchen)")
    robot.hanging = hanging
    second = bench.send("(checked bath)")
    assert robot.hangs.wait(LONG)
    bench.cancel(first)
    robot.wait(lambda: not robot.active)
    robot.answer()
    assert end(first)[1] == "CANCELLED" and robot.cancelled == ["(drive hall kitchen)"]
    bench.carry_on(second)
    assert end(second)[1] == "SUCCEEDED"


@pytest.mark.parametrize("leave_limit", [0.1])
@pytest.mark.parametrize("hanging", ["preview", "update", "plan"])
def test_one_that_leaves_stops_the_run_when_there_is_no_other_plan_in_time(
    bench: Bench, robot: Robot, hanging: str
) -> None:
    first, second = bench.joined()
    robot.hanging = hanging
    bench.cancel(second)
    robot.wait(lambda: robot.cancelled == ["(drive hall kitchen)"])
    robot.answer()
    assert end(second)[1] == "CANCELLED"
    bench.carry_on(first)
    assert end(first)[1] == "SUCCEEDED"


def test_one_that_leaves_asks_for_no_plan_without_a_master(
    bench: Bench, robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = bench.joined()
    robot.hanging = "preview"
    monkeypatch.setattr(plan_revision, "master_answers", lambda *_: False)
    bench.cancel(second)
    assert end(second)[1] == "CANCELLED" and not robot.hangs.is_set()
    assert robot.cancelled == ["(drive hall kitchen)"]
    bench.carry_on(first)
    assert end(first)[1] == "SUCCEEDED"


def test_one_that_leaves_gives_a_slow_master_half_of_its_limit(
    bench: Bench, robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = bench.joined()
    monkeypatch.setattr(plan_revision, "master_answers", lambda timeout: LONG / 3 < timeout < LONG)
    bench.cancel(second)
    assert end(second)[1] == "CANCELLED"
    assert robot.cancelled == []
    bench.carry_on(first)
    assert end(first)[1] == "SUCCEEDED"


@pytest.mark.parametrize("leaves", [0, 1])
def test_a_cancel_does_not_wait_for_a_plan_with_a_newcomer_which_is_tried_again(
    bench: Bench, robot: Robot, monkeypatch: pytest.MonkeyPatch, leaves: int
) -> None:
    monkeypatch.setattr(plan_revision, "JOIN_LIMIT", 10 * LONG)
    both = [bench.driving("(checked kitchen)"), bench.send("(checked bath)")]
    bench.members(*both)
    robot.hanging = "plan"
    third = bench.send("(checked attic)")
    assert robot.hangs.wait(LONG)
    robot.hanging = ""
    left = both[1 - leaves]
    bench.cancel(both[leaves])
    assert robot.owners[-1] == left.goal.id, "the client of the other one may end now"
    assert end(both[leaves])[1] == "CANCELLED"
    bench.members(left, third)
    assert robot.cancelled == ["(drive hall kitchen)"] * (1 - leaves), "only the first one needs it"
    bench.carry_on(left, third)
    assert [end(each)[1] for each in (left, third)] == ["SUCCEEDED"] * 2


@pytest.mark.parametrize("leave_limit", [0.1])
def test_what_hangs_for_a_newcomer_does_not_keep_a_leave_from_its_limit(
    bench: Bench, robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module, name in ((planning, "CALL_GRACE"), (plan_revision, "JOIN_LIMIT")):
        monkeypatch.setattr(module, name, 10 * LONG)
    first, second = bench.joined()
    robot.hanging = "generate_problem"
    third = bench.send("(checked attic)")
    assert robot.hangs.wait(LONG)
    bench.cancel(second)
    robot.wait(lambda: robot.cancelled == ["(drive hall kitchen)"])
    robot.answer()
    assert end(second)[1] == "CANCELLED"
    bench.carry_on(first, third)
    assert [end(each)[1] for each in (first, third)] == ["SUCCEEDED"] * 2


def test_the_limit_of_a_leave_counts_from_its_cancel(
    bench: Bench, robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    now, limits, call_later = [0.0], [], plan_revision.call_later
    monkeypatch.setattr(plan_revision, "monotonic", lambda: now[0])
    for module, name in ((planning, "CALL_GRACE"), (plan_revision, "JOIN_LIMIT")):
        monkeypatch.setattr(module, name, 10 * LONG)
    first, second = bench.joined()
    robot.hanging = "generate_problem"
    third = bench.send("(checked attic)")
    assert robot.hangs.wait(LONG)
    monkeypatch.setattr(plan_revision, "call_later", lambda s, call: limits.append(s) or call_later(s, call))
    bench.cancel(second)
    now[0] = 0.75 * LONG  # before the look for a plan with the newcomer has ended
    robot.answer()
    assert end(second)[1] == "CANCELLED"
    assert 0.25 * LONG in limits
    bench.carry_on(first, third)


def test_an_error_of_its_own_stops_the_run(
    bench: Bench, robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = bench.joined()
    monkeypatch.setattr(PlanRevision, "run", lambda *_: 1 / 0)
    bench.cancel(second)
    robot.wait(lambda: robot.cancelled == ["(drive hall kitchen)"])
    assert end(second)[1] == "CANCELLED"
    bench.carry_on(first)
    assert end(first)[1] == "SUCCEEDED"


def test_a_cancel_of_all_waits_for_no_preview(
    bench: Bench, robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(planning, "CALL_GRACE", 10 * LONG)
    first, second = bench.joined()
    robot.hanging = "preview"
    bench.cancel(second)
    assert robot.hangs.wait(LONG)
    bench.cancel(first)
    assert end(first)[1] == end(second)[1] == "CANCELLED"


def test_where_all_leave_at_once_no_plan_is_looked_for(
    bench: Bench, robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(plan_revision, "GATHER", LONG)
    first, second = bench.joined()
    robot.hanging = "preview"
    for request in (first, second):
        bench.cancel(request)
    assert end(first)[1] == end(second)[1] == "CANCELLED"
    assert robot.cancelled == ["(drive hall kitchen)"] and not robot.hangs.is_set()


def test_who_leaves_is_answered_when_what_ran_for_it_has_stopped(bench: Bench, robot: Robot) -> None:
    first, second = bench.joined()
    robot.slow_to_stop = True
    with robot.changed:  # a second robot works for the other one
        robot.under_way.append(
            RunningAction(action_id=1000, name="check", parameters=[KeyValue("room", "bath")])
        )
    bench.cancel(second)
    robot.wait(lambda: robot.leaving)
    assert robot.cancelled == ["(check bath)"] and not second.goal.ends  # type: ignore[attr-defined]
    robot.stop_leaving()
    assert end(second)[1] == "CANCELLED"
    bench.carry_on(first)
    assert end(first)[1] == "SUCCEEDED"


def test_the_limit_of_a_leave_is_one_for_its_plan_and_not_for_what_stops_slowly(
    bench: Bench, robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = bench.joined()
    robot.slow_to_stop = True
    with robot.changed:
        robot.under_way.append(
            RunningAction(action_id=1000, name="check", parameters=[KeyValue("room", "bath")])
        )
    limits: List[Any] = []
    call_later = plan_revision.call_later

    def later(seconds: float, call: Callable[[], object]) -> Any:
        if seconds <= plan_revision.GATHER:
            return call_later(seconds, call)
        open_ = [call]
        limits.append(open_)
        return SimpleNamespace(cancel=open_.clear)

    monkeypatch.setattr(plan_revision, "call_later", later)
    bench.cancel(second)
    robot.wait(lambda: robot.end_awaited)
    assert limits
    for call in itertools.chain(*limits):  # the limit passes
        call()
    assert not second.goal.ends  # type: ignore[attr-defined]
    robot.stop_leaving()
    assert end(second)[1] == "CANCELLED"
    bench.carry_on(first)
    assert end(first)[1] == "SUCCEEDED" and robot.cancelled == ["(check bath)"]


def test_who_leaves_is_not_cancelled_when_what_ran_for_it_does_not_stop(bench: Bench, robot: Robot) -> None:
    first, second = bench.joined()
    robot.slow_to_stop = True
    with robot.changed:
        robot.under_way.append(
            RunningAction(action_id=1000, name="check", parameters=[KeyValue("room", "bath")])
        )
    bench.cancel(second)
    robot.wait(lambda: robot.leaving)
    with robot.changed:
        robot.unstopped = ["(check bath)"]
    robot.stop_leaving()
    assert end(second)[1] == "CANCEL_TIMEOUT" and "(check bath)" in end(second)[2]
    bench.carry_on(first)
    assert end(first)[1] == "SUCCEEDED"


@pytest.mark.parametrize("moves_on", [False, True])
def test_one_that_leaves_is_cancelled_when_the_base_does_not_move_for_it(
    bench: Bench, robot: Robot, moves_on: bool
) -> None:
    first, second = bench.joined()
    with robot.changed:  # a second robot works for the other one
        robot.under_way.append(
            RunningAction(action_id=1000, name="check", parameters=[KeyValue("room", "bath")])
        )
    robot.moves_on = moves_on
    bench.cancel(second)
    outcome, reason = end(second)[1:]
    assert outcome == ("CANCEL_TIMEOUT" if moves_on else "CANCELLED")
    assert ("the base still moves" in reason) is moves_on
    assert ("(drive hall kitchen)" in robot.cancelled) is moves_on
    robot.moves_on = False
    bench.carry_on(first)
    assert end(first)[1] == "SUCCEEDED"


def test_the_plan_that_ends_while_a_newcomer_is_planned_is_a_success(bench: Bench, robot: Robot) -> None:
    first = bench.driving("(checked kitchen)")
    robot.hanging = "plan"
    second = bench.send("(checked bath)")
    assert robot.hangs.wait(LONG)
    robot.end_action()
    robot.end_action()
    assert end(first)[1:] == ("SUCCEEDED", "") and first.course.replans == 0
    robot.answer()
    bench.carry_on(second)
    assert end(second)[1] == "SUCCEEDED"


def test_a_plan_that_has_not_reached_its_goals_is_not_blamed_on_a_newcomer(
    bench: Bench, robot: Robot
) -> None:
    first = bench.driving("(and (checked kitchen) (checked attic))")
    robot.hanging = "plan"
    second = bench.send("(checked bath)")
    assert robot.hangs.wait(LONG)
    assert all(robot.end_action() for _ in range(3))
    robot.facts.discard("(checked kitchen)")
    robot.hanging = ""
    assert robot.end_action()
    robot.wait(lambda: first.course.replans)
    assert first.course.replan_reason == "these goals do not hold: (checked kitchen)"
    bench.carry_on(first, second)
    assert [end(each)[1] for each in (first, second)] == ["SUCCEEDED"] * 2


def test_a_dispatcher_that_cannot_exchange_lets_newcomers_wait(bench: Bench, robot: Robot) -> None:
    robot.can_exchange = False
    first = bench.driving("(checked kitchen)")
    second = bench.send("(checked bath)")
    assert bench.engine.waiting == [second] and robot.stored == ["(checked kitchen)"]
    bench.carry_on(first, second)
    assert [end(each)[1] for each in (first, second)] == ["SUCCEEDED"] * 2


def test_a_goal_that_the_knowledge_base_refuses_does_not_end_the_others(bench: Bench, robot: Robot) -> None:
    robot.refused = "(checked bath)"
    requests = [bench.driving("(checked kitchen)"), *map(bench.send, ("(checked bath)", "(checked attic)"))]
    bench.carry_on(*requests)
    assert [end(each)[1] for each in requests] == ["SUCCEEDED", "REFUSED", "SUCCEEDED"]
    assert end(requests[1])[2].endswith("its object is unknown")


@pytest.mark.parametrize("seed", range(8))
def test_any_order_of_arrivals_and_cancels(bench: Bench, robot: Robot, seed: int) -> None:
    choice = random.Random(seed)
    rooms = [f"room{number}" for number in range(20)]
    robot.impossible = "(checked room0)"
    robot.on_exchange = lambda: "it has moved on" if choice.random() < 0.2 else ""
    requests = []
    for _ in range(25):
        goals = [f"(checked {room})" for room in choice.sample(rooms, choice.choice([1, 1, 2]))]
        times = {"deadline": by(choice.choice([5, 30, 60, 200]))} if choice.random() < 0.4 else {}
        requests.append(bench.send(f"(and {' '.join(goals)})", priority=choice.choice([0, 0, 0, 1]), **times))
        for _ in range(choice.randrange(4)):
            if not robot.end_action():
                with robot.changed:
                    robot.changed.wait(0.01)
        if choice.random() < 0.4:
            bench.cancel(choice.choice(requests))
    bench.carry_on(*requests)
    for request in requests:
        impossible = "(checked room0)" in request.texts
        assert end(request)[1] in ("SUCCEEDED", "ALREADY_TRUE", "CANCELLED", *["UNSOLVABLE"] * impossible)
