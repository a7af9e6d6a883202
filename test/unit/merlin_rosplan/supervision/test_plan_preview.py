# SPDX-License-Identifier: Apache-2.0
"""Plans that are only shown: for other goals than those of the knowledge base, from its state."""

import contextlib
import os
import stat
import threading
from pathlib import Path

import pytest

from merlin_pddl.domain_reader import read_domain
from merlin_pddl.problem_reader import read_problem
from merlin_ros.processes.process_tree import descendants
from merlin_rosplan.planning.planner import PlannerSettings
from merlin_rosplan.planning.planning_outcome import PlannerState
from merlin_rosplan.supervision.plan_preview import BUSY, PREVIEW_LIMIT, Previews, Wanted, steps_of

HOME = Path(__file__).resolve().parents[4] / "pddl" / "home"
DOMAIN = str(HOME / "domain.pddl")
LONG = 60.0


@pytest.fixture
def previews():
    made = Previews(PlannerSettings(anytime=0.02))
    yield made
    made.shutdown()


def world():
    domain = read_domain(DOMAIN)
    return domain, read_problem(HOME / "problem.pddl", domain)


def look(previews, goal, *without, command="", include=()):
    return previews.plan(world(), DOMAIN, command, Wanted([goal], without, include))[0]


def test_a_plan_has_its_steps_and_times(previews):
    steps = steps_of(look(previews, "(checked kitchen)").plan)  # on a slow machine perhaps not the shortest
    assert str(steps[0]).startswith("(navigate anywhere ") and str(steps[-1]) == "(ask kitchen)"
    assert steps[0].time == pytest.approx(0.0, abs=0.01)
    assert steps[1].time >= steps[0].duration > 1.0


def test_another_plan_does_without_a_step_of_the_first(previews):
    left_out = "(navigate anywhere kitchen)"
    other = [str(step) for step in steps_of(look(previews, "(robot_at kitchen)", left_out).plan)]
    assert len(other) > 1 and left_out not in other and other[-1].endswith("kitchen)")
    none = look(previews, "(robot_at kitchen)", "(navigate * kitchen)")
    assert none.state == PlannerState.UNSOLVABLE and none.reason


def test_a_plan_has_an_action_that_it_would_not_need(previews):
    wanted = "(navigate bathroom kitchen)"
    outcome = look(previews, "(robot_at kitchen)", include=[wanted])
    assert outcome.solved, outcome.reason
    assert wanted in [str(step) for step in steps_of(outcome.plan)]


@pytest.mark.parametrize(
    "action, said",
    [
        ("(fly kitchen)", "no action 'fly'"),
        ("(ask)", "takes 1 objects, not 0"),
        ("(ask moon)", "no object 'moon'"),
        ("(ask anywhere)", "'anywhere' is no poi"),
        ("ask kitchen", ""),
    ],
)
def test_an_action_that_does_not_exist_says_why(previews, action, said):
    outcome = look(previews, "(robot_at kitchen)", include=[action])
    assert outcome.state == PlannerState.INVALID and said in outcome.reason


def test_the_problem_is_given_back_as_it_was_planned(previews):
    plain = previews.plan(world(), DOMAIN, "", Wanted(["(checked kitchen)"]))[1]
    marked = previews.plan(world(), DOMAIN, "", Wanted(["(checked kitchen)"], [], ["(ask kitchen)"]))[1]
    assert plain == marked and "(checked kitchen)" in plain and "(robot_at anywhere)" in plain


def test_what_the_robot_plans_itself_goes_first():
    niceness = os.getpriority(os.PRIO_PROCESS, 0) + 1
    made = Previews(PlannerSettings(anytime=0.02), niceness=niceness)
    try:
        assert look(made, "(checked kitchen)").solved
        assert niceness in map(niceness_of, descendants(os.getpid()))
    finally:
        made.shutdown()


def niceness_of(pid):
    with contextlib.suppress(ProcessLookupError):
        return os.getpriority(os.PRIO_PROCESS, pid)


def test_a_goal_that_holds_has_an_empty_plan(previews):
    outcome = look(previews, "(in_service)")
    assert outcome.solved and steps_of(outcome.plan) == []


@pytest.mark.parametrize("goal", ["(checked moon)", "(chekd kitchen)", "(checked"])
def test_a_goal_of_another_domain_says_why(previews, goal):
    outcome = look(previews, goal)
    assert outcome.state == PlannerState.INVALID and outcome.reason


def test_a_reader_waits_at_most_ten_seconds():
    assert Previews(PlannerSettings(time_limit=0.0))._settings.time_limit == PREVIEW_LIMIT
    assert Previews(PlannerSettings(time_limit=2.0))._settings.time_limit == 2.0


def test_one_at_a_time_and_the_end_of_the_node_ends_it(previews, tmp_path):
    started, script = tmp_path / "started", tmp_path / "planner"
    os.mkfifo(started)
    script.write_text(f"#!/bin/sh\necho x > {started}\nsleep 1000\n")
    script.chmod(stat.S_IRWXU)
    outcomes = []
    command = f"timeout 600 {script} DOMAIN PROBLEM"
    thread = threading.Thread(
        target=lambda: outcomes.append(look(previews, "(checked kitchen)", command=command))
    )
    thread.start()
    started.read_text()
    second = look(previews, "(checked kitchen)")
    assert (second.state, second.reason) == (PlannerState.CANCELLED, BUSY)
    previews.shutdown()
    thread.join(LONG)
    assert [outcome.state for outcome in outcomes] == [PlannerState.CANCELLED]
