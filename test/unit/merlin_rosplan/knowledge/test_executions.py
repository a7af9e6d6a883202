# SPDX-License-Identifier: Apache-2.0
"""The journal of executions, phase by phase."""

import pytest
from execution_store import ANYWHERE, DOMAIN, DRIVE, add, apply, facts, value

from merlin_pddl.domain_reader import parse_domain
from merlin_pddl.knowledge import Fact, FunctionValue, Instance
from merlin_rosplan.knowledge.executions import REMEMBERED
from merlin_rosplan.knowledge.knowledge_checks import UpdateRefused
from merlin_rosplan.knowledge.knowledge_store import KnowledgeStore


@pytest.fixture
def store():
    found = KnowledgeStore(DOMAIN, clock=lambda: 5)
    add(found, Fact("at", ("base",)), FunctionValue("trips", (), 0.0), FunctionValue("room", (), 9.0))
    return found


def test_open_executions_are_listed_with_their_owner(store):
    apply(store, "start", "1/1", "DRIVE", {"to": "HALL", "from": "base"}, "/bridges", ["(busy)"], ANYWHERE)
    apply(store, "start", "1/2", "ask", {"p": "hall"}, "/other")
    first, second = store.executions()
    assert (first.token, first.operator, first.owner, first.began) == ("1/1", "drive", "/bridges", 5)
    assert first.parameters == (("from", "base"), ("to", "hall"))
    assert second.parameters == (("p", "hall"),)
    assert store.executions("bridges") == [first]
    apply(store, "end", "1/1", "drive", DRIVE)
    assert store.executions() == [second]


def test_while_running_ends_with_the_execution_whatever_its_phase(store):
    for number, phase in enumerate(("end", "rollback", "interrupt")):
        token = str(number)
        apply(store, "start", token, "ask", {"p": "hall"}, "/n", ["(busy)", "(not (at base))"])
        assert facts(store) - {"(asked hall)"} == {"(busy)"}
        apply(store, phase, token, "ask", *([{"p": "hall"}] if phase == "end" else []))
        assert facts(store) - {"(asked hall)"} == {"(at base)"}


def test_only_what_the_start_added_is_taken_back(store):
    add(store, Fact("busy", ()))
    apply(store, "start", "t", "ask", {"p": "hall"}, "/n", ["(busy)", "(not (ready hall))"])
    apply(store, "end", "t", "ask", {"p": "hall"})
    assert facts(store) == {"(at base)", "(busy)", "(asked hall)"}


def test_what_two_need_holds_until_the_second_has_ended(store):
    apply(store, "start", "1", "ask", {"p": "hall"}, "/n", ["(busy)"])
    apply(store, "start", "2", "ask", {"p": "base"}, "/n", ["(busy)"])
    apply(store, "end", "1", "ask", {"p": "hall"})
    assert "(busy)" in facts(store)
    apply(store, "interrupt", "2")
    assert "(busy)" not in facts(store)


def test_interrupted_where_the_action_declares_what_holds_then(store):
    apply(store, "start", "t", "drive", DRIVE, "/n", ["(busy)"], ["(at anywhere)", "(not (busy))"])
    assert facts(store) == {"(busy)"} and value(store, "trips") == 2
    assert apply(store, "interrupt", "t", "drive") == ""
    assert facts(store) == {"(at anywhere)"} and value(store, "trips") == 2
    assert apply(store, "interrupt", "t", "drive") == "nothing to interrupt"
    assert apply(store, "rollback", "t", "drive") == "nothing to restore"
    assert facts(store) == {"(at anywhere)"}


def test_interrupted_where_it_declares_nothing(store):
    apply(store, "start", "t", "drive", DRIVE, "/n", ["(busy)"])
    apply(store, "interrupt", "t")
    assert facts(store) == {"(at base)"} and value(store, "trips") == 0


def test_values_that_others_changed_meanwhile(store):
    apply(store, "start", "d", "drive", DRIVE)
    apply(store, "start", "l", "load", {"p": "hall"})
    add(store, FunctionValue("trips", (), 10.0, op="increase"), FunctionValue("room", (), 1.0, op="increase"))
    assert apply(store, "interrupt", "d") == ""
    assert value(store, "trips") == 10  # a difference is taken back from whatever the value is now
    assert apply(store, "interrupt", "l") == "changed by others since, not restored: room"
    assert value(store, "room") == 5  # an assignment only when it still stands


def test_unknown_tokens_change_nothing(store):
    for phase in ("rollback", "interrupt"):
        assert "nothing to" in apply(store, phase, "never seen", "no such operator")
        assert "nothing to" in apply(store, phase, "", "drive")
    assert store.version == 1 and store.executions() == []


def test_a_start_that_comes_behind_its_rollback_is_refused(store):
    """Its client had no answer in time, and the two come over different connections."""
    assert apply(store, "rollback", "late", "DRIVE") == "nothing to restore"
    with pytest.raises(UpdateRefused, match="has ended"):
        apply(store, "start", "late", "drive", DRIVE, "/n", ["(busy)"], ANYWHERE)
    assert facts(store) == {"(at base)"} and store.executions() == []
    for number in range(REMEMBERED):
        apply(store, "rollback", str(number), "drive")
    apply(store, "start", "late", "drive", DRIVE)  # only so many are remembered


def test_interrupt_although_objects_are_gone():
    domain = parse_domain(
        """(define (domain d) (:types place) (:predicates (at ?p - place) (seen ?p - place))
        (:durative-action go :parameters (?p - place) :duration (= ?duration 1)
          :effect (and (at start (not (seen ?p))) (at end (at ?p)))))"""
    )
    store = KnowledgeStore(domain)
    add(store, Instance("place", "a"), Instance("place", "b"), Fact("seen", ("a",)))
    apply(store, "start", "t", "go", {"p": "a"}, "/n", ["(at b)"], ["(seen a)", "(seen b)"])
    apply(store, "start", "u", "go", {"p": "a"})
    with store.transaction() as change:
        change.remove(Instance("place", "a"))
    assert apply(store, "interrupt", "t", "go") == "not applied, because an object is gone: (seen a)"
    apply(store, "rollback", "u", "go")
    assert facts(store) == {"(seen b)"} and store.executions() == []


@pytest.mark.parametrize(
    "literal, reason",
    [
        ("(at moon)", "unknown object 'moon'"),
        ("(att base)", "did you mean 'at'"),
        ("(at ?from)", "expected a name"),
        ("(at base", "never closed"),
        ("(not)", "expected a literal"),
        ("(not (not (busy)))", "expected a literal"),
        ("(= (trips) 1)", "expected a literal"),
        ("(at base hall)", "takes 1 argument"),
        ("busy", "expected '\\('"),
    ],
)
@pytest.mark.parametrize("place", ["while_running", "if_interrupted"])
def test_literals_are_checked_before_anything_begins(store, literal, reason, place):
    with pytest.raises(UpdateRefused, match=reason):
        apply(store, "start", "t", "drive", DRIVE, **{place: [literal]})
    assert facts(store) == {"(at base)"} and store.executions() == []


def test_literals_need_a_token(store):
    with pytest.raises(UpdateRefused, match="needs a token"):
        apply(store, "start", "", "drive", DRIVE, "/n", ["(busy)"])
    apply(store, "start", "", "drive", DRIVE, "/n")
    assert facts(store) == set() and store.executions() == []


@pytest.mark.parametrize("phase", ["start", "end"])
def test_token_of_other_objects_is_refused(store, phase):
    apply(store, "start", "t", "drive", DRIVE)
    began = facts(store)
    label, *_ = [key for key in DRIVE if DRIVE[key] == "hall"]
    with pytest.raises(UpdateRefused, match=r"the token 't' belongs to \(drive .*hall\)"):
        apply(store, phase, "t", "drive", {**DRIVE, label: "base"})
    assert facts(store) == began and len(store.executions()) == 1
    apply(store, "end", "t", "drive", {key: value.upper() for key, value in DRIVE.items()})
    assert store.executions() == []


def test_token_of_another_operator_is_refused(store):
    apply(store, "start", "t", "drive", DRIVE)
    for phase in ("rollback", "interrupt"):
        with pytest.raises(UpdateRefused, match="belongs to the operator 'drive'"):
            apply(store, phase, "t", "ask")
