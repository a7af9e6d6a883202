# SPDX-License-Identifier: Apache-2.0
import pytest

from merlin_pddl.domain_reader import parse_domain
from merlin_pddl.knowledge import Fact, FunctionValue, Instance
from merlin_rosplan.knowledge.executions import REMEMBERED, Executions
from merlin_rosplan.knowledge.knowledge_checks import UpdateRefused
from merlin_rosplan.knowledge.knowledge_store import KnowledgeStore

DOMAIN = parse_domain(
    """(define (domain d)
    (:types place robot) (:constants base - place)
    (:predicates (at ?r - robot ?p - place) (clean ?p - place) (dirty ?p - place) (hurried ?r - robot))
    (:functions (battery ?r - robot) (distance ?a ?b - place) (trips) (total-cost))
    (:action sweep :parameters (?r - robot)
      :effect (and (forall (?p - place) (when (dirty ?p) (and (clean ?p) (not (dirty ?p)))))
                   (decrease (battery ?r) 2) (increase (total-cost) 1)))
    (:action swap :parameters (?p - place)
      :effect (and (when (clean ?p) (and (not (clean ?p)) (dirty ?p)))
                   (when (dirty ?p) (and (not (dirty ?p)) (clean ?p)))))
    (:durative-action drive :parameters (?r - robot ?from ?to - place)
      :duration (= ?duration (distance ?from ?to))
      :condition (at start (at ?r ?from))
      :effect (and (at start (not (at ?r ?from))) (at start (increase (trips) 1)) (at end (at ?r ?to))
                   (at end (decrease (battery ?r) ?duration))
                   (when (at start (hurried ?r)) (at end (dirty ?to)))))
    (:durative-action charge :parameters (?r - robot)
      :duration (<= ?duration 100)
      :effect (increase (battery ?r) (* #t 0.5)))
    (:durative-action fill :parameters (?r - robot ?p - place)
      :duration (<= ?duration 100)
      :condition (and (at end (clean ?p)) (at end (>= (battery ?r) 54)) (preference soft (at end (dirty ?p))))
      :effect (and (increase (battery ?r) (* #t 0.5)) (at end (not (clean ?p))) (at end (dirty ?p))
                   (at end (assign (trips) (battery ?r))))))"""
)
DRIVE = {"r": "r1", "from": "base", "to": "hall"}


class Clock:
    now = 0

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def store(clock):
    found = KnowledgeStore(DOMAIN, clock=clock)
    with found.transaction() as change:
        for item in (
            Instance("place", "hall"),
            Instance("robot", "r1"),
            Fact("at", ("r1", "base")),
            FunctionValue("battery", ("r1",), 50.0),
            FunctionValue("trips", (), 0.0),
            FunctionValue("distance", ("base", "hall"), 7.0),
        ):
            change.add(item)
    return found


def apply(store, phase, operator="drive", parameters=None, token="t"):
    with store.transaction() as change:
        more = (parameters or DRIVE,) if phase in ("start", "end") else ()
        return getattr(Executions(change), phase)(token, operator, *more)


def facts(store):
    return {fact.text() for fact in store.facts()}


def value(store, name):
    return store.values(name)[0].value


def test_start_then_end(store):
    apply(store, "start")
    assert facts(store) == set() and value(store, "trips") == 1
    apply(store, "end")
    assert facts(store) == {"(at r1 hall)"} and value(store, "battery") == 43


def test_rollback_restores_what_start_changed(store):
    apply(store, "start")
    assert apply(store, "rollback") == ""
    assert facts(store) == {"(at r1 base)"} and value(store, "trips") == 0
    assert apply(store, "rollback") == "nothing to restore"


def test_rollback_leaves_what_others_did(store):
    apply(store, "start")
    with store.transaction() as change:
        change.add(Fact("at", ("r1", "hall")))
        change.add(FunctionValue("trips", (), 5.0, op="increase"))
    apply(store, "rollback")
    assert facts(store) == {"(at r1 hall)", "(at r1 base)"} and value(store, "trips") == 5


def test_messages_that_come_twice_change_nothing(store):
    assert apply(store, "start") == ""
    assert apply(store, "start") == "started already"
    assert value(store, "trips") == 1
    apply(store, "end")
    assert apply(store, "end") == "ended already"
    assert value(store, "battery") == 43
    with pytest.raises(UpdateRefused, match="has ended"):
        apply(store, "start")


def test_end_effect_that_depends_on_the_start(store):
    with store.transaction() as change:
        change.add(Fact("hurried", ("r1",)))
    apply(store, "start")
    with store.transaction() as change:
        change.remove(Fact("hurried", ("r1",)))
    apply(store, "end")
    assert "(dirty hall)" in facts(store)


def test_continuous_effect_follows_the_time_that_passed(store, clock):
    apply(store, "start", "charge", {"r": "r1"})
    clock.now = 8_000_000_000
    apply(store, "end", "charge", {"r": "r1"})
    assert value(store, "battery") == 54


FILL = {"r": "r1", "p": "hall"}


def test_an_end_without_its_conditions_is_refused_although_its_effects_change_them(store, clock):
    apply(store, "start", "fill", FILL)
    clock.now = 8_000_000_000
    version = store.version
    with pytest.raises(UpdateRefused, match=r"at its end \(clean hall\) does not hold$"):
        apply(store, "end", "fill", FILL)
    assert store.version == version and [found.operator for found in store.executions()] == ["fill"]
    with store.transaction() as change:
        change.add(Fact("clean", ("hall",)))
    apply(store, "end", "fill", FILL)
    assert "(dirty hall)" in facts(store) and not store.executions()


def test_at_its_end_continuous_effects_have_come_true(store, clock):
    with store.transaction() as change:
        change.add(Fact("clean", ("hall",)))
    apply(store, "start", "fill", FILL)
    clock.now = 7_000_000_000
    with pytest.raises(UpdateRefused, match=r"\(>= \(battery r1\) 54\) does not hold$"):
        apply(store, "end", "fill", FILL)
    assert value(store, "battery") == 50
    clock.now = 8_000_000_000
    apply(store, "end", "fill", FILL)
    assert value(store, "battery") == 54 and value(store, "trips") == 54


def test_plain_operator_waits_for_its_end(store):
    with store.transaction() as change:
        change.add(Fact("dirty", ("hall",)))
        change.add(Fact("dirty", ("base",)))
    apply(store, "start", "sweep", {"r": "r1"})
    assert "(dirty hall)" in facts(store)
    apply(store, "end", "sweep", {"r": "r1"})
    assert facts(store) == {"(at r1 base)", "(clean hall)", "(clean base)"} and value(store, "battery") == 48


def test_effects_see_the_state_before(store):
    with store.transaction() as change:
        change.add(Fact("dirty", ("hall",)))
    apply(store, "end", "swap", {"p": "hall"}, "one")
    assert "(clean hall)" in facts(store) and "(dirty hall)" not in facts(store)


def test_sensed_predicates_are_left_alone(store):
    with store.transaction() as change:
        change.note(change.state.sensed, "at", {})
    apply(store, "start")
    apply(store, "end")
    assert facts(store) == {"(at r1 base)"} and value(store, "battery") == 43


@pytest.mark.parametrize(
    "operator, parameters, reason",
    [
        ("drve", DRIVE, "did you mean 'drive'"),
        ("drive", {"r": "r1", "from": "base"}, "parameter 'to' of 'drive' is missing"),
        ("drive", {"r": "r1", "from": "base", "to": "moon"}, "unknown object 'moon'"),
    ],
)
def test_bad_requests_change_nothing(store, operator, parameters, reason):
    version = store.version
    with pytest.raises(UpdateRefused, match=reason):
        apply(store, "start", operator, parameters)
    assert store.version == version


def test_effect_without_a_number_is_refused_as_a_whole(store):
    apply(store, "start")
    with store.transaction() as change:
        change.remove(FunctionValue("battery", ("",), 0.0))
    with pytest.raises(UpdateRefused, match="has no value that could decrease"):
        apply(store, "end")
    assert facts(store) == set()


def test_ended_executions_do_not_pile_up(store):
    for number in range(REMEMBERED + 20):
        apply(store, "end", "swap", {"p": "hall"}, f"token {number}")
    with store.transaction() as change:
        assert len(change.state.executions.all()) == REMEMBERED
