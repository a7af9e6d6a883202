# SPDX-License-Identifier: Apache-2.0
"""A task without some of its actions: what is left out, and nothing else."""

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from merlin_pddl.analysis.demand import demand
from merlin_pddl.analysis.leave_out import leave_out
from merlin_pddl.domain_reader import parse_domain
from merlin_pddl.evaluation import Evaluator
from merlin_pddl.formula import to_pddl
from merlin_pddl.problem_reader import parse_problem
from merlin_pddl.text_reader import PddlError

FOLDER = Path(__file__).parents[4] / "src" / "merlin" / "pddl"
DOMAIN = """; ask one of them
(define (domain clinic)
  (:types person)
  (:predicates (asked ?p - person) (at ?p - person))
  (:action ask :parameters (?who - person) :effect (asked ?who))
  (:action walk :parameters (?from ?to - person) :precondition (at ?from)
    :effect (and (not (at ?from)) (at ?to))))"""
PROBLEM = """(define (problem day) (:domain clinic) ; (:init
  (:objects Ann Bob - person)
  (:init (at Ann))
  (:goal (asked Ann)))"""


def allowed(action: str, left_out: str, domain_text: str = DOMAIN) -> bool:
    """Whether an action can run in the first state of the task without another."""
    domain_text, problem_text = leave_out(domain_text, PROBLEM, [left_out])
    domain = parse_domain(domain_text)
    problem = parse_problem(problem_text, domain)
    facts = {fact.key for fact in problem.facts}

    class State:
        def holds(self, key):
            return key in facts

    name, *arguments = action.strip("()").split()
    operator = domain.operators[name]
    bindings = {parameter.name: value for parameter, value in zip(operator.parameters, arguments)}
    holds = Evaluator(domain, State()).holds  # type: ignore[arg-type]
    return all(holds(timed.condition, bindings) for timed in operator.conditions)


@pytest.mark.parametrize(
    ("left_out", "action", "stays"),
    [
        ("(ask ann)", "(ask ann)", False),
        ("(ASK Ann)", "(ask ann)", False),
        ("(ask ann)", "(ask bob)", True),
        ("(walk * bob)", "(walk ann bob)", False),
        ("(walk * bob)", "(walk ann ann)", True),
        ("(walk bob *)", "(walk ann bob)", True),
        ("(ask *)", "(ask bob)", False),
    ],
)
def test_only_what_is_left_out_cannot_run(left_out: str, action: str, stays: bool) -> None:
    assert allowed(action, left_out) is stays


@pytest.mark.parametrize("taken", ["(left-out-ask ?p - person)", "(left-out-ask) (left-out-ask-1)"])
def test_names_of_the_domain_are_left_alone(taken: str) -> None:
    domain = DOMAIN.replace("(:predicates", f"(:predicates {taken}")
    assert not allowed("(ask ann)", "(ask ann)", domain) and allowed("(ask bob)", "(ask ann)", domain)


def test_what_is_left_out_twice_counts_twice() -> None:
    domain, _ = leave_out(DOMAIN, PROBLEM, ["(ask ann)"])
    assert not allowed("(ask bob)", "(ask bob)", domain)


def test_what_is_demanded_has_a_mark_that_the_domain_does_not_know() -> None:
    domain = DOMAIN.replace("(:predicates", "(:predicates (was-done-ask ?p - person)")
    text, goals = demand(domain, {"ann": ("person",), "bob": ("person",)}, ["(ask ann)", "(ask bob)"])
    effects = parse_domain(text).operators["ask"].effects
    marks = {effect.atom.name for effect in effects if effect.atom is not None} - {"asked"}
    assert len(marks) == 1 and not marks & set(parse_domain(domain).predicates)
    assert [to_pddl(goal) for goal in goals] == [
        f"({mark} {name})" for mark in marks for name in ("ann", "bob")
    ]


def test_the_objects_of_a_problem_keep_their_spelling() -> None:
    assert "(:objects Ann Bob - person)" in leave_out(DOMAIN, PROBLEM, ["(ask ann)"])[1]


@pytest.mark.parametrize("begin", ["", "\ufeff"])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r", " "])
def test_the_lines_of_a_problem_may_end_in_any_way(begin: str, end: str) -> None:
    lines = PROBLEM.replace(" ; (:init", "").split("\n")
    domain, problem = leave_out(DOMAIN, begin + end.join(lines), ["(ask ann)"])
    facts = [fact.key for fact in parse_problem(problem, parse_domain(domain)).facts]
    assert sorted(facts) == [("at", "ann"), ("left-out-ask", "ann")]


def test_a_problem_without_facts_gets_one() -> None:
    bare = PROBLEM.replace("(:init (at Ann))", "") + "\n; that is all :)\n"
    domain, problem = leave_out(DOMAIN, bare, ["(ask ann)"])
    assert [fact.key for fact in parse_problem(problem, parse_domain(domain)).facts] == [
        ("left-out-ask", "ann")
    ]


@pytest.mark.parametrize(
    "action", ["(fly ann)", "(ask)", "(ask ann bob)", "ask ann", "(ask ann", "(ask (ann))", "(ask cleo)"]
)
def test_what_is_not_an_action_is_refused(action: str) -> None:
    with pytest.raises(PddlError):
        leave_out(DOMAIN, PROBLEM, [action])


@settings(max_examples=30, deadline=None)
@given(st.sampled_from(["home", "restaurant"]), st.data())
def test_the_applications_stay_readable(application: str, data: st.DataObject) -> None:
    domain_text = (FOLDER / application / "domain.pddl").read_text()
    problem_text = (FOLDER / application / "problem.pddl").read_text()
    before = parse_domain(domain_text)
    operator = before.operators[data.draw(st.sampled_from(sorted(before.operators)))]
    action = f"({' '.join((operator.name, *('*' for _ in operator.parameters)))})"
    left, problem = leave_out(domain_text, problem_text, [action])
    after = parse_domain(left)
    parse_problem(problem, after, constraints=True)
    assert len(after.operators[operator.name].conditions) == len(operator.conditions) + 1
    assert after.operators[operator.name].effects == operator.effects
    others = set(before.operators) - {operator.name}
    assert all(after.operators[name] == before.operators[name] for name in others)
