# SPDX-License-Identifier: Apache-2.0
"""What plans on a Python that kairos does not know, what checks its plans, and what the node says of it."""

import os
from pathlib import Path
from typing import Any

import pytest

from merlin_pddl.checks import installed_planners, kairos_check
from merlin_pddl.plan_text import parse_plan
from merlin_rosplan.planning import planner_engines
from merlin_rosplan.planning.planner_command import PlannerCommandError
from merlin_rosplan.planning.planner_engines import engines
from merlin_rosplan.planning.planner_settings import PlannerSettings
from merlin_rosplan.planning.planning_outcome import PlannerState
from merlin_rosplan.supervision.planner_job import PlannerJob, work

NODE = """
import sys
sys.modules["kairos"] = None
sys.argv = ["planner_interface"]
from merlin_rosplan.nodes.planning_system import run_kind
run_kind("planner_interface")
"""


@pytest.fixture
def old_python(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A Python that kairos does not know; no planner is installed there."""
    monkeypatch.setenv("PATH", "/nowhere")
    monkeypatch.setenv("ROS_PACKAGE_PATH", f"/nowhere:{tmp_path}/src")
    monkeypatch.delenv("MERLIN_PLANNERS", raising=False)
    monkeypatch.setattr(planner_engines, "available", lambda: False)
    monkeypatch.setattr(installed_planners.importlib.util, "find_spec", lambda name: None)
    monkeypatch.setattr(kairos_check, "load", lambda: None)
    return tmp_path


def program(path: Path) -> str:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.touch(mode=0o755)
    return str(path)


@pytest.mark.parametrize("folder", ["", "ROSPlan"])
def test_popf_of_rosplan_plans_and_what_it_does_not_read_is_said(old_python: Path, folder: str) -> None:
    popf = program(old_python / "src" / folder / "rosplan_planning_system" / "common" / "bin" / "popf")
    chosen = engines("", fallback=True)
    assert chosen.commands == [f"{popf} DOMAIN PROBLEM"] and chosen.name == "popf"
    assert "kairos is not installed; popf plans instead, and reads no negative" in chosen.warning
    with pytest.raises(PlannerCommandError, match="kairos needs Python 3.10"):
        engines("", fallback=False)


def test_lpg_of_a_wheel_plans(old_python: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lpg = program(old_python / "lib" / "python3.8" / "site-packages" / "up_lpg" / "lpg")
    monkeypatch.setenv("MERLIN_PLANNERS", str(old_python))
    assert engines("", fallback=True).commands[0].startswith(f"{lpg} -o DOMAIN")


def test_without_any_planner_the_error_says_what_to_install(old_python: Path) -> None:
    with pytest.raises(PlannerCommandError, match="install popf or lpg, or set ~planner_command"):
        engines("", fallback=True)


DOMAIN = """(define (domain lift) (:requirements :typing :durative-actions :fluents) (:types place thing)
  (:predicates (at ?t - thing ?p - place) (free)) (:functions (way ?a ?b - place) (fee ?a ?b - place) (used))
  (:durative-action carry :parameters (?t - thing ?a ?b - place) :duration (= ?duration (way ?a ?b))
    :condition (and (at start (at ?t ?a)) (at start (free)))
    :effect (and (at start (not (at ?t ?a))) (at start (not (free))) (at end (free)) (at end (at ?t ?b))
      (at end (increase (used) (fee ?a ?b)))))
  (:durative-action look :parameters () :duration (= ?duration 1) :condition (at start (free)) :effect ()))"""
PROBLEM = """(define (problem p) (:domain lift) (:objects a b c - place cup - thing)
  (:init (at cup a) (free) (= (used) 0) (= (way a b) 4) (= (way a c) 2) (= (way c b) 3) (= (way b c) 3)
    (= (fee a b) 9) (= (fee a c) 1) (= (fee c b) 1) (= (fee b c) 1))
  (:goal (at cup b)) (:metric minimize (used)))"""
CHEAP = "0.000: (carry cup a c) [2.000]\\n2.001: (carry cup c b) [3.000]"
QUICK = "0.000: (carry cup a b) [4.000]"


def planned(folder: Path, *plans: str, domain: str = DOMAIN, problem: str = PROBLEM) -> Any:
    """How a planning ends whose engines print these plans."""
    names = folder / "domain.pddl", folder / "problem.pddl"
    for name, text in zip(names, (domain, problem)):
        name.write_text(text)
    engines = [f"/usr/bin/printf '{plan}\\n' DOMAIN PROBLEM" for plan in plans]
    files = map(str, names)
    settings = PlannerSettings(anytime=20.0, memory_limit=0.0, output_limit=0.0)
    job = PlannerJob(*files, engines, "two", "", settings, 60.0)
    (folder / "work").mkdir()
    return work(job.message(), folder / "work")


@pytest.mark.parametrize(
    "plan, why",
    [
        (QUICK, ""),
        (CHEAP, ""),
        ("", "(at cup b) does not hold"),
        ("0.000: (carry cup c b) [3.000]", "(at cup c) does not hold, which (carry cup c b) needs"),
        ("0.000: (carry cup a b) [9.000]", "(= ?duration (way a b)) does not hold"),
        ("0.000: (carry cup a d) [4.000]", "the problem has no place 'd'"),
        ("0.000: (carry a a b) [4.000]", "the problem has no thing 'a'"),
        ("0.000: (lift cup) [9.000]", "is no action of 'lift'"),
        # Three decimals: it ends at 1.9996 and is printed as 2.000.
        ("0.000: (carry cup a c) [2.000]\\n2.000: (carry cup c b) [3.000]", ""),
        ("0.000: (carry cup a c) [2.000]\\n1.998: (carry cup c b) [3.000]", "does not hold"),
        (f"{QUICK}\\n4.001: (carry cup b c) [3.000]", "(at cup b) does not hold"),
        (f"0.000: (look) [1.000]\\n{QUICK}", "changes (free) at the moment at which the other needs"),
    ],
)
def test_plans_are_carried_out_on_paper(old_python: Path, plan: str, why: str) -> None:
    fault = kairos_check.PlanValidator(DOMAIN, PROBLEM).fault(parse_plan(plan.replace("\\n", "\n")))
    assert (fault or "") == why if not why else why in (fault or "")


@pytest.mark.parametrize(
    "old, new, plan, why",
    [
        ("(= (fee a b) 9)", "", QUICK, "(+ (used) (fee a b)) has no value, which (carry cup a b) needs"),
        ("(= (used) 0)", "", QUICK, "(+ (used) (fee a b)) has no value, which (carry cup a b) needs"),
        ("(free)", "(free) (at 0 (free))", QUICK, "what is timed and (carry cup a b) changes (free) at"),
        ("(free)", "(free) (at 3 (not (at cup b)))", QUICK, ""),
    ],
)
def test_numbers_without_a_value_and_what_is_timed_count(
    old_python: Path, old: str, new: str, plan: str, why: str
) -> None:
    fault = kairos_check.PlanValidator(DOMAIN, PROBLEM.replace(old, new)).fault(parse_plan(plan))
    assert (fault or "") == why if not why else why in (fault or "")


def test_an_end_may_wait_for_what_is_timed(old_python: Path) -> None:
    domain = DOMAIN.replace(
        ":condition (at start (free)) :effect ()", ":condition (at end (free)) :effect ()"
    )
    problem = PROBLEM.replace("(free)", "(at 2 (free))").replace("(at cup b)", "(at cup a)")
    assert kairos_check.PlanValidator(domain, problem).fault(parse_plan("1.001: (look) [1.000]")) is None


def test_an_action_of_no_duration_has_an_end(old_python: Path) -> None:
    domain = DOMAIN.replace(
        "duration 1) :condition (at start (free)) :effect ()", "duration 0) :effect (at end (free))"
    )
    problem = PROBLEM.replace("(free)", "").replace("(at cup b)", "(free)")
    assert kairos_check.PlanValidator(domain, problem).fault(parse_plan("0.000: (look) [0.000]")) is None


def test_a_plan_with_a_fault_is_not_passed_on(old_python: Path) -> None:
    outcome = planned(old_python, "0.000: (carry cup a c) [2.000]")
    assert outcome["state"] == PlannerState.INVALID
    assert "returned a plan that is not valid: (at cup b) does not hold" in outcome["reason"]


def test_of_two_plans_the_one_with_the_better_metric_wins(old_python: Path) -> None:
    assert "(carry cup c b)" in planned(old_python, QUICK, CHEAP)["plan"]


def test_bad_input_is_named_with_its_place(old_python: Path) -> None:
    outcome = planned(old_python, QUICK, problem=PROBLEM.replace("(:goal (at cup b))", "(:goal (at cap b))"))
    assert outcome["state"] == PlannerState.INVALID
    assert f"{old_python / 'problem.pddl'}:4:" in outcome["reason"] and "'cap'" in outcome["reason"]


@pytest.mark.processes
def test_the_node_says_at_its_start_what_plans(master: Any, tmp_path: Path) -> None:
    program(tmp_path / "bin" / "popf")
    master.env["PATH"] = os.pathsep.join([str(tmp_path / "bin"), os.environ["PATH"]])
    node = master.node(NODE)
    node.expect("plans are carried out on paper; trajectory constraints, preferences, processes and events")
    node.expect("kairos is not installed; popf plans instead")


@pytest.mark.processes
def test_the_node_says_at_its_start_that_nothing_plans(master: Any) -> None:
    master.env["PATH"] = os.defpath
    master.node(NODE).expect("there is no planner: kairos needs Python 3.10")
