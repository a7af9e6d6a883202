# SPDX-License-Identifier: Apache-2.0
"""Which engines a command names, and two of them at a time."""

import stat
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

from merlin_pddl.checks import installed_planners, kairos_check
from merlin_rosplan.planning.planner import Attempt, PlannerSettings, Task
from merlin_rosplan.planning.planner_command import PlannerCommandError
from merlin_rosplan.planning.planner_engines import engines
from merlin_rosplan.planning.planner_race import PlannerRace
from merlin_rosplan.planning.planning_outcome import PlannerState
from merlin_rosplan.supervision.supervised_planning import Planning
from merlin_test import LONG

needs_kairos = pytest.mark.skipif(not kairos_check.available(), reason="kairos needs Python 3.10")
DOMAIN = """(define (domain costs) (:requirements :typing :action-costs) (:types place)
  (:predicates (at ?p - place)) (:functions (total-cost) - number (way ?a ?b - place) - number)
  (:action go :parameters (?a ?b - place) :precondition (at ?a)
    :effect (and (not (at ?a)) (at ?b) (increase (total-cost) (way ?a ?b)))))"""
PROBLEM = """(define (problem p) (:domain costs) (:objects a b c - place)
  (:init (at a) (= (total-cost) 0) (= (way a b) 50) (= (way a c) 10) (= (way c b) 10) (= (way a a) 1)
    (= (way b a) 1) (= (way b b) 1) (= (way b c) 1) (= (way c a) 1) (= (way c c) 1))
  (:goal (at b)) (:metric SENSE (total-cost)))"""
SHORT, CHEAP = "(go a b)", "(go a c)\\n(go c b)"


@pytest.fixture
def planner(tmp_path):
    def write(name, body):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text("#!/bin/sh\n" + body)
        path.chmod(path.stat().st_mode | stat.S_IXUSR)
        return f"{path} DOMAIN PROBLEM"

    return write


@pytest.fixture
def plan(tmp_path):
    def run(command, sense="minimize", data_path=None, **settings):
        domain, problem = tmp_path / "domain.pddl", tmp_path / "problem.pddl"
        domain.write_text(DOMAIN)
        problem.write_text(PROBLEM.replace("SENSE", sense))
        asked = PlannerSettings(command=command, **settings)
        return Planning(asked, str(domain), str(problem), data_path).run()

    return run


def prints(plan):
    return f"printf '{plan}\\n; cost = 1 (unit cost)\\n' > sas_plan\n"


@needs_kairos
@pytest.mark.parametrize("sense, better", [("minimize", "cheap"), ("maximize", "short")])
def test_of_two_engines_the_better_valid_plan_wins(plan, planner, sense, better):
    short, cheap = planner("short", prints(SHORT)), planner("cheap", prints(CHEAP))
    for command in (f"{short} + {cheap}", f"{cheap} + {short}"):
        outcome = plan(command, sense, anytime=LONG)
        assert outcome.solved and outcome.planner == better, outcome


@needs_kairos
def test_a_plan_that_is_not_valid_loses_against_a_valid_one(plan, planner):
    wrong = planner("wrong", prints("(go c b)"))
    outcome = plan(f"{wrong} + {planner('short', prints(SHORT))}", anytime=LONG)
    assert outcome.solved and outcome.planner == "short"


@needs_kairos
@pytest.mark.parametrize("slow", ["never", "other/short"])  # two presets may run the same script
def test_the_slower_engine_gets_its_time_and_no_more(plan, planner, slow):
    never = planner(slow, "sleep 600\n")
    outcome = plan(f"{never} + {planner('short', prints(SHORT))}", anytime=0.3, time_limit=2 * LONG)
    assert outcome.solved and outcome.planner == "short" and outcome.seconds < LONG


@needs_kairos
@pytest.mark.parametrize("slow", ["never", "other/proof"])
def test_a_proof_of_one_engine_ends_the_other(plan, planner, slow):
    never, proof = (
        planner(slow, "sleep 600\n"),
        planner("proof", "echo Task is provably unsolvable.; exit 11"),
    )
    outcome = plan(f"{never} + {proof}", time_limit=2 * LONG)
    assert outcome.state == PlannerState.UNSOLVABLE and outcome.seconds < LONG


def test_what_each_of_two_engines_printed_is_kept(plan, planner, tmp_path):
    kept = tmp_path / "kept"
    kept.mkdir()
    plan(f"{planner('one', 'echo first')} + {planner('two', 'echo second')}", data_path=str(kept))
    assert sorted(log.read_text() for log in kept.rglob("planner.log")) == ["first\n", "second\n"]


def test_of_two_engines_without_a_plan_both_reasons_are_reported(plan, planner):
    outcome = plan(f"{planner('one', 'exit 3')} + {planner('two', 'echo No plan found in 8 happenings')}")
    assert outcome.state == PlannerState.NO_PLAN
    assert "one ended with code 3" in outcome.reason and "8 happenings" in outcome.reason


@needs_kairos
def test_kairos_beside_another_engine(plan, planner):
    outcome = plan(f"kairos + {planner('short', prints(SHORT))}", anytime=LONG)
    assert outcome.solved and outcome.planner == "kairos" and "go c b" in outcome.plan


@needs_kairos
def test_an_engine_that_is_not_installed_is_left_out_with_a_warning(tmp_path):
    chosen = engines("kairos + /nowhere/popf DOMAIN PROBLEM", fallback=True)
    assert chosen.commands == ["kairos"] and "/nowhere/popf is not installed; kairos plans" in chosen.warning
    with pytest.raises(PlannerCommandError, match="not installed"):
        engines("kairos + /nowhere/popf DOMAIN PROBLEM", fallback=False)


def test_a_command_that_prints_a_stored_plan_needs_no_problem(plan, tmp_path):
    """As under ROSPlan, where suites do so; what does not fit the problem is refused as any wrong plan is."""
    stored = tmp_path / "stored"
    stored.write_text(f"; cost = 1 (unit cost)\n{SHORT}\n")
    assert plan(f"cat {stored}").solved
    assert "lacks the placeholder PROBLEM" in engines(f"cat {stored}", fallback=False).warning
    assert engines(f"cat {stored} PROBLEM", fallback=False).warning is None


def test_more_than_two_engines_are_refused():
    with pytest.raises(PlannerCommandError, match="at most 2"):
        engines("kairos+lpg+symk", fallback=True)


def test_a_plus_sign_in_a_command_joins_nothing(planner):
    command = planner("c++", "") + " --mode=a+b"
    assert engines(command, fallback=True).commands == [command]


class Fake:
    """An engine that raises."""

    def __init__(self, name, error):
        self.name = name
        self._error = error

    def begin(self, task):
        pass

    def plan(self, task):
        if self._error is None:
            return Attempt(self.name, PlannerState.NO_PLAN, "nothing")
        raise self._error

    def stop(self):
        pass


@pytest.mark.parametrize(
    "error, part",
    [
        (MemoryError(), "~memory_limit"),
        (OSError("gone"), "cannot be started"),
        (TypeError("odd"), "TypeError: odd"),
        (SystemExit(2), "SystemExit: 2"),
    ],
)
def test_an_engine_that_fails_is_reported(tmp_path, error, part):
    for rivals in ([], [Fake("good", None)]):
        folder = tmp_path / str(len(rivals))
        folder.mkdir()
        task = Task(Path("d"), Path("p"), "", "", folder, PlannerSettings())
        attempt = PlannerRace([Fake("bad", error), *rivals], task).run().attempt
        assert part in attempt.reason
        assert attempt.state == (PlannerState.NO_PLAN if rivals else PlannerState.CRASHED)


@pytest.mark.parametrize(
    "name, package, path, runner",
    [
        ("symk", "up_symk", "symk/fast-downward.py", "python"),
        ("fast-downward", "up_fast_downward", "downward/fast-downward.py", "python"),
        ("enhsp", "up_enhsp", "ENHSP/enhsp.jar", "java"),
        ("lpg", "up_lpg", "lpg", ""),
        ("up:tamer", "unified_planning", "cmd/up.py", "python"),
    ],
)
def test_planners_may_have_an_environment_of_their_own(tmp_path, monkeypatch, name, package, path, runner):
    file = tmp_path / "lib" / "python3.11" / "site-packages" / package / path
    file.parent.mkdir(parents=True)
    file.touch()
    monkeypatch.setenv("PATH", "/nowhere")
    monkeypatch.setenv("MERLIN_PLANNERS", str(tmp_path))
    monkeypatch.setattr(installed_planners.importlib.util, "find_spec", lambda name: None)
    words = installed_planners.expand(name).split()
    assert words[0] == {"python": f"{tmp_path}/bin/python", "java": "java", "": str(file)}[runner]
    assert "DOMAIN" in words and "PROBLEM" in words and installed_planners.is_preset(name)


def test_a_planner_may_be_a_package_of_this_python(tmp_path, monkeypatch):
    file = tmp_path / "up_symk" / "symk" / "fast-downward.py"
    file.parent.mkdir(parents=True)
    (tmp_path / "up_symk" / "__init__.py").touch()
    monkeypatch.setenv("PATH", "/nowhere")
    monkeypatch.delenv("MERLIN_PLANNERS", raising=False)
    monkeypatch.syspath_prepend(tmp_path)
    assert installed_planners.expand("symk").startswith("symk ")
    file.touch()
    assert installed_planners.expand("symk").startswith(f"{sys.executable} {file} DOMAIN")


def test_a_planner_that_is_nowhere_keeps_its_name(monkeypatch):
    monkeypatch.setenv("PATH", "/nowhere")
    monkeypatch.delenv("MERLIN_PLANNERS", raising=False)
    monkeypatch.setattr(installed_planners.importlib.util, "find_spec", lambda name: None)
    for name in ("symk", "fast-downward", "lpg", "enhsp", "popf"):
        assert installed_planners.expand(name).startswith(name)
    assert installed_planners.expand("up:tamer").startswith("up ")
    assert sys.executable not in installed_planners.expand("up:tamer")


def test_node_and_launch_file_have_one_default_for_better_plans():
    launch = Path(__file__).parents[4] / "launch" / "include" / "planning_system.launch"
    (argument,) = (arg for arg in ElementTree.parse(launch).iter("arg") if arg.get("name") == "anytime")
    assert float(argument.get("default")) == PlannerSettings().anytime


@needs_kairos
def test_the_default_finds_the_better_plan(plan):
    # The first plan of the search is usually (go a b), which costs 50; the best one costs 20.
    assert "go c b" in plan("").plan
