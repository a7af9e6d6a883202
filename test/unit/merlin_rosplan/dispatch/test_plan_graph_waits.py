# SPDX-License-Identifier: Apache-2.0
"""What the start of an action waits for: earlier ends, unless a deadline leaves no time, and timed values."""

from typing import Dict, List, Tuple, Union

import pytest

from merlin_pddl.domain_reader import parse_domain
from merlin_pddl.formula import Comparison, Fluent, Number
from merlin_pddl.plan_text import PlanStep
from merlin_rosplan.dispatch.operator_model import (
    ActionModel,
    Conditions,
    Inequality,
    PlanTerm,
    TimedEffects,
)
from merlin_rosplan.dispatch.plan_graph import Edge, TimedLiteral, TimedValue
from merlin_rosplan.dispatch.plan_graph_builder import build_graph

BREAD, SOUP, MENU, CHARGE = map(PlanTerm, ("bread", "soup", "menu", "charge"))
BAKE = ActionModel("bake", (), end_effects=TimedEffects(add=(BREAD,)))
COOK = ActionModel(
    "cook",
    (),
    at_end=Conditions(positive=(BREAD,)),
    end_effects=TimedEffects(add=(SOUP,), writes=(CHARGE,)),
)
SERVE = ActionModel("serve", (), at_end=Conditions(positive=(SOUP,)), end_effects=TimedEffects(add=(MENU,)))
CHARGED = Conditions(comparisons=(Inequality(Comparison(">=", Fluent("charge"), Number(3.0))),))
Timed = Union[TimedLiteral, TimedValue]


def edges(actions: List[ActionModel], times: List[Tuple[float, float]], *timed: Timed) -> Dict:
    """The edges of a plan by their nodes: 1 and 2 are start and end of the first action, and so on.

    :param times: start and duration of each action.
    """
    steps = [PlanStep(start, action.name, (), lasts) for action, (start, lasts) in zip(actions, times)]
    found: List[Edge] = build_graph(steps, actions, timed).edges
    return {(edge.source, edge.sink): edge for edge in found}


@pytest.mark.parametrize("timed", [TimedLiteral(9.0, SOUP, negative=True), TimedValue(9.0, CHARGE, 0.0)])
def test_an_action_whose_end_has_a_deadline_does_not_wait_beyond_it(timed: Timed) -> None:
    plan = [BAKE, COOK], [(0.0, 5.0), (1.0, 6.0)]
    assert (2, 3) in edges(*plan), "cook begins when the bread is there"
    found = edges(*plan, timed)  # that would end after 11 s
    assert (2, 3) not in found and found[1, 3].lower == 1.0, "it begins as planned"


def test_what_waits_itself_counts_for_those_that_wait_for_it() -> None:
    plan = [BAKE, COOK, SERVE], [(0.0, 5.0), (1.0, 6.0), (2.0, 6.0)]
    assert {(2, 3), (4, 5)} <= set(edges(*plan))
    found = edges(*plan, TimedLiteral(15.0, MENU, negative=True))  # cook ends after 11 s, serve after 17 s
    assert (2, 3) in found and (4, 5) not in found and found[3, 5].lower == 1.0


@pytest.mark.parametrize(("when", "node"), [("at_start", 1), ("over_all", 1), ("at_end", 2)])
def test_a_condition_on_a_number_waits_for_the_timed_value(when: str, node: int) -> None:
    work = ActionModel("work", (), **{when: CHARGED})
    assert edges([work], [(10.0, 5.0)], TimedValue(8.0, CHARGE, 5.0))[0, node].lower == 8.0


def test_a_timed_value_that_an_action_has_changed_since_is_not_waited_for() -> None:
    work = ActionModel("work", (), at_start=CHARGED)
    found = edges([COOK, work], [(0.0, 9.0), (10.0, 5.0)], TimedValue(8.0, CHARGE, 5.0))
    assert (2, 3) in found and (0, 3) not in found


def house(constraint: str, *lines: Tuple[float, str, float]) -> Dict:
    """The edges of a plan whose order only a constraint of the domain needs."""
    domain = parse_domain(
        f"""(define (domain d) (:requirements :typing :durative-actions :constraints :derived-predicates)
        (:types robot place) (:constants r1 r2 r3 - robot)
        (:predicates (in ?r - robot ?p - place) (clean ?p - place) (done ?p - place) (busy ?p - place))
        (:functions (dust))
        (:derived (busy ?p - place) (exists (?r - robot) (in ?r ?p)))
        (:constraints {constraint})
        (:durative-action pass :parameters (?r - robot ?p - place) :duration (= ?duration 10)
          :effect (and (at start (in ?r ?p)) (at end (not (in ?r ?p)))))
        (:durative-action sweep :parameters (?p - place) :duration (= ?duration 10)
          :effect (and (at end (clean ?p)) (increase (dust) (* #t 1))))
        (:durative-action serve :parameters (?p - place) :duration (= ?duration 5)
          :effect (at end (done ?p))))"""
    )
    models = []
    for _, text, _ in lines:
        name, *objects = text.split()
        model = ActionModel.of(domain.operators[name], domain.derived, domain.constraints)
        models.append(model.ground(model.bind(objects)))
    steps = [PlanStep(time, text.split()[0], tuple(text.split()[1:]), lasts) for time, text, lasts in lines]
    return {(edge.source, edge.sink): edge for edge in build_graph(steps, models).edges}


ALONE = "(forall (?p - place) (always (not (and (in r1 ?p) (in r2 ?p)))))"
BEFORE = "(forall (?p - place) (sometime-before (done ?p) (clean ?p)))"


@pytest.mark.parametrize(
    ("constraint", "first", "second", "waits"),
    [
        (ALONE, "pass r1 door", "pass r2 door", True),
        (ALONE, "pass r1 door", "pass r2 gate", False),
        (ALONE, "pass r1 door", "pass r3 door", False),
        ("(always (not (and (in r1 door) (in r2 gate))))", "pass r1 door", "pass r2 gate", True),
        ("(always (not (forall (?p - place) (in r1 ?p))))", "pass r1 door", "pass r1 gate", True),
        ("(at-most-once (exists (?p - place) (busy ?p)))", "pass r1 door", "pass r2 gate", True),
        (BEFORE, "sweep hall", "serve hall", True),
        (BEFORE, "sweep hall", "serve bar", False),
        ("(always (imply (done bar) (<= (dust) 20)))", "sweep hall", "serve bar", True),
        ("(at end (and (clean hall) (done hall)))", "sweep hall", "serve hall", False),
    ],
)
def test_an_order_that_only_a_constraint_needs_is_kept(
    constraint: str, first: str, second: str, waits: bool
) -> None:
    found = house(constraint, (0.0, first, 10.0), (10.001, second, 10.0))
    assert ((2, 3) in found) == waits
    assert found[1, 2].strict is False


def test_an_end_that_a_constraint_puts_behind_another_waits_for_it() -> None:
    found = house(BEFORE, (0.0, "sweep hall", 10.0), (6.0, "serve hall", 5.0))
    assert found[2, 4].strict and (2, 3) in found


def test_what_a_constraint_holds_open_is_closed_last() -> None:
    found = house(
        "(always (imply (in r2 door) (in r1 door)))", (0.0, "pass r1 door", 20.0), (1.0, "pass r2 door", 10.0)
    )
    assert (1, 3) in found and found[4, 2].strict
