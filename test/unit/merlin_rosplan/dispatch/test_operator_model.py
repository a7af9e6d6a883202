# SPDX-License-Identifier: Apache-2.0
"""What dispatchers look at of an operator, from the domain itself and from ROSPlan's messages."""

import pytest

from merlin_pddl.domain_reader import parse_domain
from merlin_pddl.knowledge import FunctionValue
from merlin_rosplan.dispatch.operator_model import ActionModel, BindingError, PlanTerm
from merlin_rosplan.knowledge.knowledge_checks import UpdateRefused
from merlin_rosplan.knowledge.knowledge_store import KnowledgeStore
from merlin_rosplan.messages.domain_messages import operator_message, read_operator

DOMAIN = parse_domain(
    """(define (domain d) (:requirements :adl :durative-actions :numeric-fluents :derived-predicates)
    (:types place robot) (:constants dock - place)
    (:predicates (at ?r - robot ?p - place) (near ?p ?q - place) (open ?p - place) (busy ?r - robot)
                 (reachable ?p - place))
    (:functions (battery ?r - robot) (steps))
    (:derived (reachable ?p - place) (or (open ?p) (exists (?q - place) (near ?p ?q))))
    (:durative-action drive :parameters (?r - robot ?from ?to - place) :duration (= ?duration 5)
      :condition (and (at start (at ?r ?from)) (at start (not (> 10 (battery ?r))))
                      (at start (not (= ?from ?to))) (over all (not (busy ?r))) (at end (open ?to)))
      :effect (and (at start (not (at ?r ?from))) (at end (at ?r ?to))
                   (at end (decrease (battery ?r) (steps)))  (at end (assign (steps) 1))))
    (:action leave :parameters (?r - robot) :precondition (at ?r dock) :effect (not (at ?r dock)))
    (:durative-action watch :parameters (?r - robot ?p - place) :duration (>= ?duration 1)
      :condition (and (at start (or (open ?p) (busy ?r))) (over all (not (reachable ?p)))
                      (at start (preference calm (open ?p))))
      :effect (and (forall (?q - place) (when (at end (open ?q)) (at end (near ?p ?q))))
                   (increase (battery ?r) (* #t 2)))))"""
)


def model(name):
    return ActionModel.of(DOMAIN.operators[name], DOMAIN.derived)


@pytest.mark.parametrize("name", ["drive", "leave"])
def test_an_operator_that_messages_can_carry_is_the_same_from_both(name):
    carried = read_operator(operator_message(DOMAIN, DOMAIN.operators[name]))
    assert ActionModel.of(carried, {}) == model(name)


def test_literals_and_comparisons_are_sorted_by_time():
    drive = model("drive").ground({"?r": "ann", "?from": "hall", "?to": "dock"})
    assert drive.at_start.positive == (PlanTerm("at", ("ann", "hall")),)
    assert drive.at_start.negative == (PlanTerm("=", ("hall", "dock")),)
    assert [entry.reads for entry in drive.at_start.comparisons] == [(PlanTerm("battery", ("ann",)),)]
    assert drive.at_start.comparisons[0].condition.op == "<="  # the negation is turned round
    assert drive.over_all.negative == (PlanTerm("busy", ("ann",)),)
    assert drive.at_end.positive == (PlanTerm("open", ("dock",)),)
    assert drive.start_effects.delete == (PlanTerm("at", ("ann", "hall")),)
    assert drive.end_effects.add == (PlanTerm("at", ("ann", "dock")),)
    battery, steps = PlanTerm("battery", ("ann",)), PlanTerm("steps")
    assert (drive.end_effects.writes, drive.end_effects.additive) == ((battery, steps), (battery,))
    assert drive.end_effects.reads == (steps,)


def test_a_constant_is_no_variable_of_the_same_name():
    declared = "(define (domain d) (:constants r) (:predicates (p ?x))"
    domain = parse_domain(f"{declared} (:action a :parameters (?r) :effect (and (p r) (p ?r))))")
    operator = domain.operators["a"]
    assert ActionModel.of(operator, {}).ground({"?r": "ann"}).start_effects.add == (
        PlanTerm("p", ("r",)),
        PlanTerm("p", ("ann",)),
    )


def test_what_messages_cannot_carry_is_watched_by_name():
    watch = model("watch").ground({"?r": "ann", "?p": "hall"})
    (either,) = watch.at_start.expressions
    assert (str(either), either.reads) == ("(or (open hall) (busy ann))", {"open", "busy"})
    (derived,) = watch.over_all.expressions  # changes when what it is derived from does
    assert derived.reads == {"reachable", "open", "near"} and not watch.over_all.negative
    assert (watch.end_effects.wild, watch.end_effects.wild_reads) == (
        {"near", "battery"},
        {"open", "#t"},
    )
    assert watch.start_effects.empty and watch.durative


def test_conditions_see_the_planned_duration():
    domain = parse_domain(
        """(define (domain d) (:predicates (plugged)) (:functions (battery))
        (:durative-action wait :parameters () :duration (<= ?duration 9)
          :condition (and (at start (>= (battery) (* 2 ?duration)))
            (over all (or (plugged) (> (battery) ?duration))))))"""
    )
    store = KnowledgeStore(domain)
    with store.transaction() as change:
        change.add(FunctionValue("battery", (), 8.6))
    wait = ActionModel.of(domain.operators["wait"], {})
    for duration, right in [(4.300000190734863, [True, True]), (5.0, [False, True]), (9.0, [False] * 2)]:
        action = wait.ground(wait.bind([], duration))
        found = (*action.at_start.comparisons, *action.over_all.expressions)
        assert store.query([each.condition for each in found]) == right


def test_a_plain_operator_stays_plain():
    assert not model("leave").durative
    assert not read_operator(operator_message(DOMAIN, DOMAIN.operators["leave"])).durative
    assert read_operator(operator_message(DOMAIN, DOMAIN.operators["drive"])).durative


def test_arguments_that_do_not_fit_are_named_with_the_parameters():
    with pytest.raises(BindingError, match=r"drive has 3 parameters \(r from to\), not 1 \(ann\)"):
        model("drive").bind(["ann"])


def test_a_malformed_expression_of_a_message_is_refused():
    message = operator_message(DOMAIN, DOMAIN.operators["drive"])
    message.at_start_comparison[0].LHS.tokens = []
    with pytest.raises(UpdateRefused, match="empty"):
        read_operator(message)
