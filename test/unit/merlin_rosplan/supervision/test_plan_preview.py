# SPDX-License-Identifier: Apache-2.0
"""Plans that are only shown: for other goals than those of the knowledge base, from its state."""

import contextlib
import os
import shutil
import stat
import tempfile
import threading
import time
from pathlib import Path

import pytest

from merlin_pddl.domain_reader import read_domain
from merlin_pddl.problem_reader import parse_problem, read_problem
from merlin_ros.processes.process_tree import descendants
from merlin_rosplan.planning.planner import PlannerSettings
from merlin_rosplan.planning.planning_outcome import PlannerState
from merlin_rosplan.supervision.plan_preview import (
    BUSY,
    LATER_ERRORS,
    Previews,
    Wanted,
    steps_of,
    write_later_problem,
)
from merlin_rosplan.supervision.planner_host import PlannerHosts
from merlin_rosplan.supervision.supervised_planning import Planning
from merlin_test import LONG

HOME = Path(__file__).resolve().parents[4] / "pddl" / "home"
DOMAIN = str(HOME / "domain.pddl")


@pytest.fixture
def previews():
    made = Previews(LONG)  # a process of the planner begins late on a busy machine
    yield made
    made.shutdown()


def world():
    domain = read_domain(DOMAIN)
    return domain, read_problem(HOME / "problem.pddl", domain)


def look(previews, goal, *without, command="", include=(), anytime=0.02, **settings):
    settings = PlannerSettings(command=command, anytime=anytime, **settings)
    wanted = Wanted([goal] if goal else [], without, include)
    return previews.plan(world(), DOMAIN, wanted, settings)[0]


def test_a_plan_has_its_steps_and_times(previews):
    steps = steps_of(look(previews, "(checked kitchen)").plan)  # on a slow machine perhaps not the shortest
    assert str(steps[0]).startswith("(navigate anywhere ") and str(steps[-1]) == "(ask kitchen)"
    assert steps[0].time == pytest.approx(0.0, abs=0.01)
    assert steps[1].time >= steps[0].duration > 1.0


@pytest.fixture
def temporary(tmp_path, monkeypatch):
    """The folder of temporary files, of this process and its children."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    return tmp_path


def test_plans_are_found_after_the_folder_of_temporary_files_was_emptied(temporary):
    made = Previews(LONG, niceness=1)  # with a process of its own
    try:
        for _ in range(2):
            outcome = look(made, "(checked kitchen)")
            assert outcome.solved, outcome.reason
            for folder in temporary.iterdir():
                shutil.rmtree(folder, ignore_errors=True)
    finally:
        made.shutdown()


def test_what_waits_for_a_planning_does_without_its_folder(temporary):
    hosts = PlannerHosts()
    hosts.warm_up()
    ends = time.monotonic() + LONG
    while not list(temporary.glob("planner-*")) and time.monotonic() < ends:
        time.sleep(0.01)
    (folder,) = temporary.glob("planner-*")
    while folder.exists():  # it plans there, to be faster later
        shutil.rmtree(folder, ignore_errors=True)
    outcome = Planning(PlannerSettings(), DOMAIN, str(HOME / "problem.pddl"), hosts=hosts).run()
    hosts.take().close()
    assert outcome.solved, outcome.reason


def test_without_a_folder_for_temporary_files_it_is_said_why_there_is_no_plan(monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", "/nowhere")
    outcome = look(Previews(LONG), "(checked kitchen)")
    assert outcome.state == PlannerState.INVALID and "/nowhere" in outcome.reason


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
    settings = PlannerSettings(anytime=0.02)
    plain = previews.plan(world(), DOMAIN, Wanted(["(checked kitchen)"]), settings)[1]
    marked = previews.plan(world(), DOMAIN, Wanted(["(checked kitchen)"], [], ["(ask kitchen)"]), settings)[1]
    assert plain == marked and "(checked kitchen)" in plain and "(robot_at anywhere)" in plain


def test_what_the_robot_plans_itself_goes_first():
    niceness = os.getpriority(os.PRIO_PROCESS, 0) + 1
    made = Previews(LONG, niceness=niceness)
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


@pytest.mark.parametrize(("limit", "of_planner"), [(0.3, 0.0), (0.3, 60.0), (60.0, 0.3)])
def test_a_reader_waits_for_the_shorter_limit(limit, of_planner, tmp_path):
    script = tmp_path / "planner"
    script.write_text("#!/bin/sh\nsleep 1000\n")
    script.chmod(stat.S_IRWXU)
    previews = Previews(limit)
    outcome = look(previews, "(checked kitchen)", command=f"{script} DOMAIN PROBLEM", time_limit=of_planner)
    previews.shutdown()
    assert outcome.state == PlannerState.TIMEOUT and "0.3 s" in outcome.reason


def test_goals_with_deadlines_are_reached_in_time_or_it_is_said_by_how_much_not(previews):
    # The first plan that is found need not be the shortest.
    soon = look(previews, "", anytime=0.5, dues=((("(checked kitchen)",), 600.0),))
    assert soon.solved and 5.0 < soon.reached[0] <= 600.0
    assert [str(step) for step in steps_of(soon.plan)][-1] == "(ask kitchen)"
    late = look(previews, "", dues=((("(checked kitchen)",), 4.0),))
    assert late.state == PlannerState.UNSOLVABLE and not late.plan
    assert late.reached == (pytest.approx(soon.reached[0], abs=0.1),)
    seconds = f"{late.reached[0]:.1f}"
    assert late.reason == (
        f"cannot be in time: (checked kitchen) needs {seconds} s, its deadline is in 4.0 s"
    )


def test_goals_with_deadlines_that_cannot_be_reached_at_all_are_not_called_late(previews):
    never = look(previews, "", dues=((("(robot_at kitchen)", "(robot_at bathroom)"), 600.0),))
    assert never.state == PlannerState.UNSOLVABLE and never.reached == ()
    assert "in time" not in never.reason and "collect" not in never.reason and "done" not in never.reason


def test_a_search_that_ends_without_a_plan_in_time_proves_nothing(previews, tmp_path):
    script = tmp_path / "planner"
    script.write_text("#!/bin/sh\necho No plan found\n")
    script.chmod(stat.S_IRWXU)
    dues = ((("(checked kitchen)",), 4.0),)
    outcome = look(previews, "", command=f"{script} DOMAIN PROBLEM", dues=dues)
    assert (outcome.state, outcome.reached) == (PlannerState.NO_PLAN, ())


@pytest.mark.parametrize("within", [float("nan"), 1e12])
def test_a_deadline_that_is_no_time_is_refused(previews, within):
    outcome = look(previews, "", dues=((("(checked kitchen)",), within),))
    assert outcome.state == PlannerState.INVALID and "deadline of (checked kitchen)" in outcome.reason


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


def test_a_problem_begins_where_what_runs_ends():
    drive = "(navigate anywhere kitchen)"
    domain = read_domain(DOMAIN)
    later = parse_problem(write_later_problem(DOMAIN, str(HOME / "problem.pddl"), [drive]), domain)
    now = read_problem(HOME / "problem.pddl", domain)
    facts = {fact.text() for fact in later.facts}
    assert "(robot_at kitchen)" in facts and later.goals == now.goals and later.metric == now.metric


@pytest.mark.parametrize("after", ["(fly kitchen)", "(navigate kitchen)", ""])
def test_what_cannot_be_planned_after_says_why(after):
    with pytest.raises(LATER_ERRORS, match="unknown operator|parameters"):
        write_later_problem(DOMAIN, str(HOME / "problem.pddl"), [after])


def test_a_plan_that_is_no_longer_wanted_is_not_looked_for(previews, tmp_path):
    script = tmp_path / "planner"
    script.write_text("#!/bin/sh\nsleep 1000\n")
    script.chmod(stat.S_IRWXU)

    @contextlib.contextmanager
    def gone_soon(cancel):
        leaving = threading.Thread(target=cancel)
        leaving.start()
        yield
        leaving.join()

    settings = PlannerSettings(command=f"{script} DOMAIN PROBLEM")
    wanted = Wanted(["(checked kitchen)"])
    outcome, _ = Previews(LONG, while_wanted=gone_soon).plan(world(), DOMAIN, wanted, settings)
    assert outcome.state == PlannerState.CANCELLED
