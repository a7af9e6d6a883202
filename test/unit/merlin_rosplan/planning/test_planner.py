# SPDX-License-Identifier: Apache-2.0
"""Planning with kairos and with external commands, real processes included."""

import os
import signal
import stat
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from merlin_pddl.checks import kairos_check
from merlin_pddl.checks.validate import validate
from merlin_pddl.plan_text import parse_plan
from merlin_rosplan.planning.planner import PlannerSettings
from merlin_rosplan.planning.planner_command import PlannerCommandError, parse_command
from merlin_rosplan.planning.planner_process import PlannerProcess
from merlin_rosplan.planning.planning_outcome import PlannerState
from merlin_rosplan.supervision.supervised_planning import Planning
from merlin_test import LONG
from merlin_test.process_signals import gone

DOMAIN = Path(__file__).parents[4] / "pddl" / "home" / "domain.pddl"
PROBLEM = (DOMAIN.parent / "problem.pddl").read_text()
PLAN = "0.000: (navigate anywhere kitchen)  [28.200]\n28.200: (ask kitchen)  [5.000]\n"

#: Of which one is long enough for a script to begin, on a machine of any speed; s.
LIMITS = (0.3, 2.0, 8.0, 30.0)

needs_kairos = pytest.mark.skipif(not kairos_check.available(), reason="kairos needs Python 3.10")


@pytest.fixture
def problem(tmp_path):
    def write(goal):
        path = tmp_path / "problem.pddl"
        path.write_text(PROBLEM.replace("(:goal (in_service))", f"(:goal (and {goal}))"))
        return str(path)

    return write


@pytest.fixture
def script(tmp_path):
    def write(body, name="planner"):
        path = tmp_path / name
        path.write_text("#!/bin/sh\n" + body)
        path.chmod(path.stat().st_mode | stat.S_IXUSR)
        return str(path)

    return write


def plan(problem_path, command="", data_path=None, **settings):
    return Planning(PlannerSettings(command=command, **settings), str(DOMAIN), problem_path, data_path).run()


@needs_kairos
def test_kairos_plans(problem, tmp_path):
    # The search ends long before: it has seen all. A machine that stands still for less loses no plan.
    outcome = plan(problem("(checked kitchen)"), data_path=str(tmp_path), anytime=60.0)
    assert outcome.state == PlannerState.SOLVED and outcome.planner == "kairos"
    assert [str(step) for step in parse_plan(outcome.plan)] == [
        "(navigate anywhere kitchen)",
        "(ask kitchen)",
    ]
    assert (tmp_path / "plan.pddl").read_text() == outcome.plan


@needs_kairos
def test_goals_that_hold_give_an_empty_plan(problem):
    outcome = plan(problem("(robot_at anywhere)"))
    assert outcome.solved and outcome.plan == ""


@needs_kairos
def test_unsolvable_says_why(problem):
    outcome = plan(problem("(robot_at kitchen) (robot_at bathroom)"))
    assert outcome.state == PlannerState.UNSOLVABLE and len(outcome.reason) > 20


# The level has to be between 3.3 and 3.5 while it rises: kairos looks at it in steps of time.
WINDOW = """(define (domain window)
  (:requirements :durative-actions :fluents :continuous-effects :duration-inequalities)
  (:predicates (closed) (done)) (:functions (level))
  (:durative-action fill :parameters () :duration (and (>= ?duration 0.1) (<= ?duration 50))
    :condition (and (at start (closed)) (over all (<= (level) 10)))
    :effect (and (at start (not (closed))) (at end (closed)) (increase (level) (* #t 1))))
  (:durative-action sample :parameters () :duration (= ?duration 2)
    :condition (and (at start (>= (level) 3.3)) (at start (<= (level) 3.5)))
    :effect (at end (done))))"""
WINDOW_PROBLEM = """(define (problem p) (:domain window) (:init (closed) (= (level) 0)) (:goal (done)))"""


@needs_kairos
def test_unsolvable_needs_a_proof(tmp_path):
    domain, problem = tmp_path / "domain.pddl", tmp_path / "problem.pddl"
    domain.write_text(WINDOW)
    problem.write_text(WINDOW_PROBLEM)
    steps = parse_plan("0.0: (fill) [3.4]\n3.45: (sample) [2.0]\n")
    assert kairos_check.PlanValidator(WINDOW, WINDOW_PROBLEM).fault(steps) is None
    outcome = Planning(PlannerSettings(), str(domain), str(problem)).run()
    assert outcome.state == PlannerState.NO_PLAN
    assert "not a proof" in outcome.reason and "steps of time" in outcome.reason


@needs_kairos
@pytest.mark.parametrize(
    "goal, place",
    [
        ("(checkd kitchen)", "problem.pddl:"),
        ("(checked kitchn)", "problem.pddl:"),
        ("(checked", "problem.pddl:"),
    ],
)
def test_bad_pddl_says_where(problem, goal, place):
    outcome = plan(problem(goal))
    assert outcome.state == PlannerState.INVALID and place in outcome.reason


@pytest.mark.everywhere
def test_a_file_that_is_missing_is_named(tmp_path):
    outcome = plan(str(tmp_path / "nowhere.pddl"))
    assert outcome.state == PlannerState.INVALID and "nowhere.pddl" in outcome.reason


def test_a_path_that_is_none_is_refused():
    outcome = plan("problem\0.pddl")
    assert outcome.state == PlannerState.INVALID and "null byte" in outcome.reason


@needs_kairos
def test_a_planning_enters_nothing_into_the_table_of_names(problem, monkeypatch):
    """The table of interned names never shrinks: planning after planning it had grown by half a megabyte."""
    path, entered, intern = problem("(checked kitchen)"), [], sys.intern
    assert plan(path).solved
    monkeypatch.setattr(sys, "intern", lambda name: entered.append(name) or intern(name))
    assert plan(path).solved
    assert entered == []


@pytest.mark.everywhere
def test_an_external_planner_gets_both_files(problem, script, tmp_path):
    folder = tmp_path / "a folder with PROBLEM in its name"
    folder.mkdir()
    command = script(
        f'test "$1" = {DOMAIN} || exit 9\ngrep -q "checked kitchen" "$2" || exit 8\nprintf "{PLAN}"\n'
    )
    path = folder / "problem.pddl"
    path.write_text(Path(problem("(checked kitchen)")).read_text())
    outcome = plan(str(path), f"timeout 10 {command} DOMAIN PROBLEM")
    assert outcome.state == PlannerState.SOLVED, outcome.reason
    assert outcome.plan == PLAN and outcome.planner == "planner"


@pytest.mark.parametrize("program", ["'my planner/show'", '"my planner/show"', "my\\ planner/show"])
def test_a_command_with_quotes_finds_files_in_folders_with_blanks(tmp_path, monkeypatch, script, program):
    (tmp_path / "my planner").mkdir()
    script('printf "%s+" "$@"\n', "my planner/show")
    monkeypatch.chdir(tmp_path)
    command = parse_command(f"timeout 10 {program} \"DOMAIN\" 'PROBLEM' -o x")
    words = command.arguments(Path("/a b/domain.pddl"), Path("/a b/problem.pddl"), tmp_path)
    said = subprocess.run(words, cwd="/", stdout=subprocess.PIPE, text=True, check=True, timeout=LONG).stdout
    assert said == "/a b/domain.pddl+/a b/problem.pddl+-o+x+"


def test_a_plan_file_beside_the_planner_is_found(problem, script):
    command = script(
        "printf '(navigate anywhere kitchen)\\n(ask kitchen)\\n; cost = 2 (unit cost)\\n' > sas_plan\n",
        "fast-downward",
    )
    outcome = plan(problem("(checked kitchen)"), f"{command} DOMAIN PROBLEM")
    # durative actions without durations are not a plan, which shows that it was read
    assert outcome.state in (PlannerState.INVALID, PlannerState.SOLVED)
    assert "without a plan" not in outcome.reason


@needs_kairos
def test_a_plan_that_does_not_solve_the_problem_is_refused(problem, script):
    command = script("printf '0.0: (ask kitchen) [5.0]\\n'\n")
    outcome = plan(problem("(checked kitchen)"), f"{command} DOMAIN PROBLEM")
    assert outcome.state == PlannerState.INVALID and "not valid" in outcome.reason and not outcome.plan


@needs_kairos
def test_of_several_plans_the_best_valid_one_counts(problem, script):
    command = script(f"printf '{PLAN}'\necho\nprintf '0.0: (navigate anywhere kit'\n")
    outcome = plan(problem("(checked kitchen)"), f"{command} DOMAIN PROBLEM")
    assert outcome.state == PlannerState.SOLVED and outcome.plan == PLAN


@pytest.mark.everywhere
@pytest.mark.parametrize(
    "body, state, part",
    [
        ("kill -SEGV $$\n", PlannerState.CRASHED, "signal 11"),
        ("echo no idea >&2; exit 3\n", PlannerState.CRASHED, "code 3: no idea"),
        ("exit 0\n", PlannerState.CRASHED, "without a plan"),
        ("echo ';; Problem unsolvable!'\n", PlannerState.UNSOLVABLE, "unsolvable"),
        ("echo 'The problem has been deemed unsolvable'\n", PlannerState.UNSOLVABLE, "unsolvable"),
        ("echo 'No plan found in 8 happenings'\n", PlannerState.NO_PLAN, "8 happenings"),
        ("echo \"syntax error in line 5, 'PREDICATEZ'\"; exit 1\n", PlannerState.INVALID, "line 5"),
    ],
)
def test_how_an_external_planner_fails_is_reported(problem, script, body, state, part):
    outcome = plan(problem("(checked kitchen)"), script(body) + " DOMAIN PROBLEM")
    assert outcome.state == state and part in outcome.reason


@pytest.mark.everywhere
def test_the_time_limit_kills_the_planner_and_what_it_started(problem, script, tmp_path):
    pids = tmp_path / "pids"
    command = script(f"sleep 60 & echo $! > {pids}; echo $$ >> {pids}; sleep 60; true\n")
    for limit in LIMITS:
        pids.unlink(missing_ok=True)
        outcome = plan(problem("(checked kitchen)"), f"{command} DOMAIN PROBLEM", time_limit=limit)
        assert outcome.state == PlannerState.TIMEOUT and outcome.seconds < LONG
        if len(pids.read_text().split() if pids.exists() else []) == 2:
            break
    assert all(gone(int(pid)) for pid in pids.read_text().split())


@needs_kairos
def test_kairos_names_no_option_that_is_not_ours(tmp_path):
    domain, problem = tmp_path / "domain.pddl", tmp_path / "problem.pddl"
    domain.write_text(
        "(define (domain d) (:functions (n)) (:action add :parameters () :effect (increase (n) 1)))"
    )
    problem.write_text("(define (problem p) (:domain d) (:init (= (n) 0)) (:goal (= (* (n) (n)) 7)))")
    outcome = Planning(PlannerSettings(time_limit=0.5), str(domain), str(problem), None).run()
    assert (outcome.state, outcome.reason) == (PlannerState.TIMEOUT, "kairos found no plan within 0.5 s")


@needs_kairos
def test_a_number_without_a_value_for_which_kairos_rejects_its_plans_is_named(tmp_path, capsys):
    domain, problem = tmp_path / "domain.pddl", tmp_path / "problem.pddl"
    domain.write_text(
        "(define (domain d) (:types robot) (:predicates (low ?r - robot) (called))"
        "(:functions (charge ?r - robot)) (:derived (low ?r - robot) (< (charge ?r) 20))"
        "(:action call :parameters (?r - robot) :precondition (low ?r) :effect (called)))"
    )
    problem.write_text(
        "(define (problem p) (:domain d) (:objects r1 r2 - robot) (:init (= (charge r1) 5)) (:goal (called)))"
    )
    outcome = Planning(PlannerSettings(), str(domain), str(problem), None).run()
    assert outcome.state == PlannerState.CRASHED and "(charge r2) is undefined" in outcome.reason
    assert validate([str(domain), str(problem)]) == 1
    assert "(charge r2) is undefined" in capsys.readouterr().out


def test_timeout_in_the_command_is_the_time_limit(problem, script):
    outcome = plan(
        problem("(checked kitchen)"), f"timeout 0.3 {script('sleep 60')} DOMAIN PROBLEM", time_limit=60.0
    )
    assert outcome.state == PlannerState.TIMEOUT and "0.3 s" in outcome.reason


def test_an_anytime_planner_that_is_stopped_leaves_its_plan(problem, script, tmp_path):
    printed = tmp_path / "printed"
    command = script(f"printf '{PLAN}'; echo; touch {printed}; sleep 600\n")
    for limit in LIMITS:
        outcome = plan(problem("(checked kitchen)"), f"timeout {limit} {command} DOMAIN PROBLEM")
        if printed.exists():
            break
    assert outcome.state == PlannerState.SOLVED


@pytest.mark.parametrize("trap", ["", "trap '' TERM INT HUP\n"])
def test_cancel_kills_a_running_planner(problem, script, tmp_path, trap):
    started = tmp_path / "started"
    os.mkfifo(started)
    command = script(f"{trap}echo $$ > {started}\nwhile true; do sleep 60; done\n")
    planning = Planning(
        PlannerSettings(command=f"{command} DOMAIN PROBLEM"), str(DOMAIN), problem("(checked kitchen)")
    )
    outcomes = []
    thread = threading.Thread(target=lambda: outcomes.append(planning.run()), daemon=True)
    thread.start()
    pid = int(started.read_text())
    planning.cancel()
    thread.join(LONG)
    assert outcomes[0].state == PlannerState.CANCELLED
    assert gone(pid)


def test_a_planning_cancelled_before_it_begins_starts_no_planner(problem, script, tmp_path):
    planning = Planning(
        PlannerSettings(command=script(f"touch {tmp_path}/ran\n") + " DOMAIN PROBLEM"),
        str(DOMAIN),
        problem("(checked kitchen)"),
    )
    planning.cancel()
    assert planning.run().state == PlannerState.CANCELLED
    assert not (tmp_path / "ran").exists()


@pytest.mark.everywhere
@needs_kairos
def test_a_missing_program_falls_back_to_kairos_with_a_warning(problem):
    planning = Planning(
        PlannerSettings(command="timeout 10 /nowhere/bin/popf -n DOMAIN PROBLEM"),
        str(DOMAIN),
        problem("(checked kitchen)"),
    )
    outcome = planning.run()
    assert outcome.solved and outcome.planner == "kairos" and "/nowhere/bin/popf" in planning.warning


def test_a_missing_program_is_an_error_without_fallback(problem):
    outcome = plan(problem("(checked kitchen)"), "/nowhere/bin/popf DOMAIN PROBLEM", fallback=False)
    assert outcome.state == PlannerState.CRASHED and "/nowhere/bin/popf is not installed" in outcome.reason


@pytest.mark.parametrize(
    "text, program, limit",
    [
        ("timeout 10 /opt/popf -n DOMAIN PROBLEM", "/opt/popf", 10.0),
        ("timeout -k 5 2m nice -n 5 lpg -o DOMAIN -f PROBLEM", "lpg", 120.0),
        ("LD_LIBRARY_PATH=/x env A=b popf DOMAIN PROBLEM", "popf", None),
        ("'my planner' DOMAIN PROBLEM", "my planner", None),
    ],
)
def test_the_program_of_a_command(text, program, limit):
    command = parse_command(text)
    assert (command.program, command.limit) == (program, limit)


def test_a_planner_has_a_short_name(problem, script, monkeypatch, tmp_path):
    script(f"printf '{PLAN}'\n", "lpg")
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    outcome = plan(problem("(checked kitchen)"), "lpg")
    assert outcome.solved and outcome.planner == "lpg"


def test_a_script_is_named_and_not_its_interpreter():
    assert parse_command("python3 -u /opt/fd/fast-downward.py DOMAIN PROBLEM").name == "fast-downward.py"


@pytest.mark.parametrize("text", ["timeout 10", "popf 'DOMAIN PROBLEM", "timeout 5 nice"])
def test_a_command_that_makes_no_sense_is_refused(text):
    with pytest.raises(PlannerCommandError):
        parse_command(text)


def test_only_whole_words_are_placeholders(tmp_path):
    shell = parse_command("/opt/DOMAIN_tools/plan --x=DOMAIN PROBLEM").arguments(
        Path("/a/PROBLEM/d.pddl"), Path("/b c/p.pddl"), tmp_path
    )
    assert shell[-1] == "/opt/DOMAIN_tools/plan --x=/a/PROBLEM/d.pddl '/b c/p.pddl'"


def test_lpg_writes_into_the_folder_of_the_planning(tmp_path):
    shell = parse_command("lpg -o DOMAIN -f PROBLEM -out plan -n 1").arguments(
        Path("/d"), Path("/p"), tmp_path
    )
    assert shell[-1] == f"lpg -o /d -f /p -out {tmp_path}/lpgplan -n 1"


def run(command, folder, process=None):
    process = process or PlannerProcess()
    process.start(command, folder)
    return process.wait()


def test_a_grandchild_that_keeps_the_output_open_does_not_keep_us(tmp_path):
    began = time.monotonic()
    result = run(["/bin/sh", "-c", "sleep 60 & echo done"], tmp_path)
    assert result.stdout == "done\n" and result.returncode == 0 and time.monotonic() - began < LONG


def test_cancel_from_many_threads_at_any_moment(tmp_path):
    for index in range(20):
        folder = tmp_path / str(index)
        folder.mkdir()
        process = PlannerProcess()
        command = [sys.executable, "-c", "import time; time.sleep(60)"]
        threads = [threading.Thread(target=process.stop) for _ in range(3)]
        runner = threading.Thread(target=run, args=(command, folder, process), daemon=True)
        for thread in [runner, *threads] if index % 2 else [*threads, runner]:
            thread.start()
        runner.join(LONG)
        assert not runner.is_alive()


@pytest.mark.everywhere
def test_returncode_of_a_signal(tmp_path):
    result = run(["/bin/sh", "-c", "kill -TERM $$"], tmp_path)
    assert result.returncode == -signal.SIGTERM
