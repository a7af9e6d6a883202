# SPDX-License-Identifier: Apache-2.0
"""Requests with deadlines join a run in mid-drive: what :mod:`test_plan_revision` shows for others."""

import pytest
from fakes.revision_bench import Bench, Robot, by, end
from merlin_msgs.msg import GoalDeadline

from merlin_planning.planning_client import Planned


def test_one_with_a_deadline_joins_and_is_done_first(bench: Bench, robot: Robot) -> None:
    first = bench.driving("(checked kitchen)")
    second = bench.send("(checked bath)", deadline=by(16))
    bench.members(first, second)
    assert robot.deadlines == [GoalDeadline(["(checked bath)"], 11.0)], "behind the drive of 5 s"
    assert (first.expected_end, second.expected_end) == (26.0, 16.0) and second.outlook.late == ""
    bench.carry_on(first, second)
    assert [end(each)[1] for each in (first, second)] == ["SUCCEEDED"] * 2
    assert robot.began[:3] == ["(drive hall kitchen)", "(drive kitchen bath)", "(check bath)"]
    assert robot.cancelled == []


def test_one_with_a_deadline_is_joined_and_stays_in_time(bench: Bench, robot: Robot) -> None:
    first = bench.driving("(checked kitchen)", deadline=by(12))
    second, third = bench.send("(checked bath)", deadline=by(25)), bench.send("(checked attic)")
    bench.members(first, second, third)
    assert [due.within for due in robot.deadlines] == [7.0, 20.0]
    assert [each.expected_end for each in (first, second, third)] == [11.0, 21.0, 31.0]
    bench.carry_on(first, second, third)
    assert [end(each)[1] for each in (first, second, third)] == ["SUCCEEDED"] * 3


def test_what_a_new_plan_begins_with_and_has_begun_before_counts_for_its_end(
    bench: Bench, robot: Robot
) -> None:
    def go_on() -> None:
        robot.on_planned = lambda: None
        assert robot.end_action()  # the drive, sooner than planned; the check begins

    first = bench.driving("(checked kitchen)")
    robot.on_planned = go_on
    second = bench.send("(checked bath)")
    bench.members(first, second)
    assert second.runs(robot.running) is False
    assert robot.asked == 2 and second.expected_end == 16.0, "three actions from now"
    bench.carry_on(first, second)
    assert robot.began == ["(drive hall kitchen)", "(check kitchen)", "(drive kitchen bath)", "(check bath)"]
    assert robot.cancelled == []


@pytest.mark.parametrize("answer", [Planned.LATE, Planned.TIMEOUT])
def test_one_that_would_make_another_one_late_waits_and_says_why(
    bench: Bench, robot: Robot, answer: Planned
) -> None:
    robot.late = answer
    first = bench.driving("(checked kitchen)", deadline=by(12))
    second = bench.send("(checked bath)", deadline=by(13))
    why = "does not join (checked kitchen): cannot all be in time"
    robot.wait(lambda: [each.waits for _, each in bench.engine.outlooks()] == [why])
    assert robot.asked == (2 if answer is Planned.LATE else 3), "a proof is not asked for twice"
    third = bench.send("(checked attic)")
    if answer is Planned.LATE:
        bench.members(first, third)
    bench.carry_on(first, second, third)
    assert [end(each)[1] for each in (first, second, third)] == ["SUCCEEDED"] * 3
    assert robot.cancelled == []


def test_one_that_is_due_before_the_end_of_what_runs_does_not_join(bench: Bench, robot: Robot) -> None:
    first = bench.driving("(checked kitchen)")
    robot.end_action()  # its check takes 5 s from now
    second = bench.send("(checked kitchen)", deadline=by(4))
    why = "does not join (checked kitchen): its deadline is before the end of what runs"
    robot.wait(lambda: [each.waits for _, each in bench.engine.outlooks()] == [why])
    assert robot.asked == 1, "no planner is asked"
    third = bench.send("(checked bath)")
    bench.members(first, third)
    bench.carry_on(first, second, third)
    assert robot.cancelled == []


def test_one_whose_goals_hold_is_in_time_whatever_runs(bench: Bench, robot: Robot) -> None:
    first = bench.driving("(checked kitchen)")
    robot.facts.add("(checked hall)")
    second = bench.send("(checked hall)", deadline=by(4))
    assert end(second)[1] == "SUCCEEDED" and bench.engine.agenda.together == [first]
    bench.carry_on(first)


def test_what_is_late_already_keeps_no_newcomer_out(bench: Bench, robot: Robot) -> None:
    first = bench.driving("(and (checked kitchen) (checked attic))", deadline=by(12))
    assert first.outlook.late
    second = bench.send("(checked bath)", deadline=by(60))
    bench.members(first, second)
    assert [due.goals for due in robot.deadlines] == [["(checked bath)"]]
    bench.carry_on(first, second)


def test_the_deadlines_of_the_others_hold_when_one_leaves(bench: Bench, robot: Robot) -> None:
    first = bench.driving("(checked kitchen)")
    second, third = (
        bench.send("(checked bath)", deadline=by(30)),
        bench.send("(checked attic)", deadline=by(40)),
    )
    bench.members(first, second, third)
    bench.cancel(third)
    assert end(third)[1] == "CANCELLED"
    assert [(due.goals, due.within) for due in robot.deadlines] == [(["(checked bath)"], 25.0)]
    bench.carry_on(first, second)
    assert robot.cancelled == []
