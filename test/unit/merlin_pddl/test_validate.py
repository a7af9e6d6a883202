# SPDX-License-Identifier: Apache-2.0
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from merlin_pddl.checks.validate import validate
from merlin_ros.processes.process_tree import descendants
from merlin_test import LONG
from merlin_test.process_signals import gone

pytestmark = pytest.mark.processes

HOME = Path(__file__).resolve().parents[3] / "pddl" / "home"
DOMAIN, PROBLEM = str(HOME / "domain.pddl"), str(HOME / "problem.pddl")


def run(capsys, *arguments):
    code = validate(["--time-limit", *map(str, (LONG, *arguments))])
    return code, capsys.readouterr().out


def test_home_domain_is_valid(capsys):
    code, output = run(capsys, DOMAIN, PROBLEM)
    assert code == 0 and "domain 'home': 2 types, 3 predicates" in output and "warning" not in output


def test_goal_with_a_plan(capsys):
    code, output = run(capsys, DOMAIN, PROBLEM, "(checked kitchen)")
    assert code == 0 and "(navigate anywhere kitchen)" in output and "(ask kitchen)" in output


def test_a_node_that_has_used_kairos_ends_without_a_word():
    pytest.importorskip("kairos")
    node = (
        "import atexit, gc, sys; atexit.register(gc.freeze)\n"  # as nodes do
        "from merlin_pddl.checks.kairos_check import load\n"
        "load().solve(*(open(name).read() for name in sys.argv[1:]))"
    )
    command = [sys.executable, "-c", node, DOMAIN, PROBLEM]
    assert subprocess.run(command, stderr=subprocess.PIPE, check=True, timeout=LONG).stderr == b""


@pytest.mark.parametrize(
    "goal, reason",
    [
        ("(checked kitchn)", "goal:1:10: unknown object 'kitchn' (did you mean 'kitchen'?)"),
        ("(checked kitchen", "goal:1:1: the '(' of '(checked' is never closed"),
        (
            "(and (robot_at kitchen) (robot_at bathroom))",
            "no plan for (robot_at kitchen) (robot_at bathroom)",
        ),
    ],
)
def test_goal_that_cannot_be(capsys, goal, reason):
    code, output = run(capsys, DOMAIN, PROBLEM, goal)
    assert code == 1 and reason in output and "NOT valid" in output


def test_errors_name_file_line_and_column(capsys, tmp_path):
    broken = tmp_path / "broken.pddl"
    broken.write_text(Path(DOMAIN).read_text().replace("(at end (robot_at ?to))", "(at end (robot_t ?to))"))
    code, output = run(capsys, broken)
    assert code == 1 and f"{broken}:26:" in output and output.count("did you mean 'robot_at'") == 1
    code, output = run(capsys, DOMAIN, tmp_path / "missing.pddl")
    assert code == 1 and "missing.pddl: cannot be read: No such file" in output
    code, output = run(capsys, "/dev/zero")
    assert code == 1 and "/dev/zero: is a device, not a file" in output


def test_kairos_checks_a_domain_for_itself_too(capsys, tmp_path):
    pytest.importorskip("kairos")
    domain = tmp_path / "domain.pddl"
    domain.write_text("(define (domain d) (:types place) (:predicates (seen ?p - place)))")
    code, output = run(capsys, domain)
    assert code == 0 and "warning: uses typing but :requirements does not include :typing" in output


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        *[
            [DOMAIN, option, number]
            for option in ("--time-limit", "--max-size")
            for number in ("nan", "-1", "0")
        ],
        [DOMAIN, "--time-limit", "inf"],
    ],
)
def test_wrong_usage(capsys, arguments):
    with pytest.raises(SystemExit) as caught:
        validate(arguments)
    assert caught.value.code == 2 and capsys.readouterr().out == ""


QUANTIFIED = """(define (domain web) (:requirements :adl) (:predicates (next ?a ?b) (never))
  (:action link :parameters (?a ?b) :effect (next ?a ?b))
  (:action unlink :parameters (?a ?b) :precondition (next ?a ?b) :effect (not (next ?a ?b))))"""


def test_the_time_limit_holds_for_a_goal_that_quantifies_over_much(capsys, tmp_path):
    domain, problem = tmp_path / "domain.pddl", tmp_path / "problem.pddl"
    names = [f"?v{number}" for number in range(12)]
    parts = " ".join(f"(or (next {a} {b}) (next {b} {a}))" for a, b in zip(names, names[1:]))
    objects = " ".join(f"o{number}" for number in range(12))
    domain.write_text(QUANTIFIED)
    problem.write_text(
        f"(define (problem p) (:domain web) (:objects {objects}) (:init)"
        f" (:goal (forall ({' '.join(names)}) (and {parts}))))"
    )
    began = time.monotonic()
    code, output = run(capsys, domain, problem, "--time-limit", "1")
    assert code == 1 and ("1 s (--time-limit)" in output or "no plan for" in output)
    assert time.monotonic() - began < 300.0


def test_a_search_that_takes_too_long_names_its_own_option(capsys, tmp_path):
    pytest.importorskip("kairos")
    domain, problem = tmp_path / "domain.pddl", tmp_path / "problem.pddl"
    domain.write_text(
        "(define (domain d) (:functions (n)) (:action add :parameters () :effect (increase (n) 1)))"
    )
    problem.write_text("(define (problem p) (:domain d) (:init (= (n) 0)) (:goal (= (* (n) (n)) 7)))")
    code, output = run(capsys, domain, problem, "--time-limit", "2")
    assert code == 1 and "--time-limit" in output and "--timeout" not in output


def test_a_file_that_is_too_large_is_refused_at_once(capsys, tmp_path):
    problem = tmp_path / "problem.pddl"
    problem.write_text("(define (problem p) (:domain home) (:init " + "(robot_at anywhere)\n" * 2_600_000)
    began = time.monotonic()
    code, output = run(capsys, DOMAIN, problem)
    assert code == 1 and "problem.pddl: has 52.0 MB, and at most 8 are read (--max-size" in output
    assert time.monotonic() - began < 300.0


def test_reading_keeps_the_time_limit_too(capsys, tmp_path):
    problem = tmp_path / "problem.pddl"
    problem.write_text("(define (problem p) (:domain home) (:init " + "(robot_at anywhere)\n" * 350_000)
    began = time.monotonic()
    assert run(capsys, DOMAIN)[0] == 0
    limit = 2.0 * (time.monotonic() - began)  # enough to begin, on a busy machine too; not for all of that
    code, output = run(capsys, DOMAIN, problem, "--time-limit", limit)
    assert code == 1 and f"reading {problem} takes more than {limit:g} s" in output


def test_a_misspelt_supertype_is_named_before_the_errors_that_come_of_it(capsys, tmp_path):
    domain = tmp_path / "domain.pddl"
    domain.write_text(
        "(define (domain d) (:requirements :typing)\n(:types place - object\n"
        "poi - plase room - (either place area))\n(:predicates (at ?p - place))\n"
        "(:action go :parameters (?p - poi) :precondition () :effect (at ?p)))"
    )
    status, out = run(capsys, str(domain))
    first, *errors = out.splitlines()
    assert first == f"{domain}:3:7: warning: the type 'plase' is declared nowhere (did you mean 'place'?)"
    assert status == 1 and errors and "'area'" not in out  # allowed, and like no other name


def test_names_that_other_parsers_do_not_read_are_warned_of(capsys, tmp_path):
    domain, problem = tmp_path / "domain.pddl", tmp_path / "problem.pddl"
    lines = (
        "(define (domain d) (:requirements :typing :numeric-fluents) (:types when)",
        "(:predicates (at ?x) (sometime)) (:functions (duration))",
        "(:action go :parameters (?duration) :effect (at ?duration)))",
    )
    domain.write_text("\n".join(lines))
    problem.write_text("(define (problem p) (:domain d)\n(:objects end) (:init) (:goal (and)))")
    code, output = run(capsys, domain, problem)
    assert code == 0
    for number, name in (1, "when"), (2, "sometime"), (2, "duration"), (3, "?duration"):
        column = lines[number - 1].index(name) + 1
        assert f"{domain}:{number}:{column}: warning: '{name}' is a keyword" in output
    assert f"{problem}:2:11: warning: 'end' is a keyword" in output
    assert f"{problem}:2:24: warning: the goal is empty" in output
    assert "'at'" not in output


@pytest.fixture
def checking(tmp_path):
    """The command while it reads a file that never ends, and the process that reads."""
    pipe = tmp_path / "pipe.pddl"
    os.mkfifo(pipe)
    command = ["rosrun", "merlin_rosplan", "validate", str(pipe), "--time-limit"]

    def start(limit):
        with subprocess.Popen(
            [*command, str(limit)], stderr=subprocess.PIPE, text=True, start_new_session=True
        ) as process, open(pipe, "wb"):  # waits until it is read
            (reader,) = descendants(process.pid)
            yield process, reader

    return start


def test_ctrl_c_ends_it_without_a_word(checking):
    for process, reader in checking(LONG):
        os.killpg(process.pid, signal.SIGINT)
        assert process.communicate(timeout=LONG) == (None, "") and gone(reader)


def test_what_checks_ends_also_when_its_parent_is_killed(checking):
    for process, reader in checking(1.0):
        process.kill()
        assert gone(reader)
