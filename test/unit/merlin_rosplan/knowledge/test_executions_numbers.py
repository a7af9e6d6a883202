# SPDX-License-Identifier: Apache-2.0
"""Numbers of an interrupted execution: what was really done is charged."""

import shutil

import pytest
from execution_store import add, apply, facts, value

from merlin_pddl.domain_reader import parse_domain
from merlin_pddl.knowledge import Fact, FunctionValue, Instance
from merlin_rosplan.knowledge.interruption import passed
from merlin_rosplan.knowledge.knowledge_checks import UpdateRefused
from merlin_rosplan.knowledge.knowledge_store import KnowledgeStore
from merlin_rosplan.storage.state_file import StateFile

COURIER = parse_domain(
    """(define (domain courier) (:types place)
    (:predicates (at ?p - place)) (:functions (battery) (heat) (cost ?p - place))
    (:durative-action drive :parameters (?from ?to - place) :duration (= ?duration 10)
      :effect (and (at start (not (at ?from))) (at start (decrease (battery) 5)) (increase (heat) (* #t 2))
        (at end (at ?to)))))"""
)
GIVE_BACK = "(increase (battery) (* 5 (- 1 (/ #t ?duration))))"


class Clock:
    seconds = 0.0

    def __call__(self):
        return int(self.seconds * 1e9) + 1


@pytest.fixture
def courier():
    clock = Clock()
    store = KnowledgeStore(COURIER, clock=clock)
    add(store, Instance("place", "a"), Instance("place", "b"), Fact("at", ("a",)))
    add(
        store,
        FunctionValue("battery", (), 50.0),
        FunctionValue("heat", (), 0.0),
        FunctionValue("cost", ("b",), 3.0),
    )
    return store, clock


WAY = {"from": "a", "to": "b"}


@pytest.mark.parametrize(
    ("seconds", "battery"), [(0.0, 50.0), (0.3, 49.85), (5.0, 47.5), (10.0, 45.0), (99.0, 45.0)]
)
def test_an_interruption_charges_what_was_really_done(courier, seconds, battery):
    store, clock = courier
    apply(store, "start", "t", "drive", WAY, "/n", [], ["(at b)", GIVE_BACK])
    assert value(store, "battery") == 45
    clock.seconds = seconds
    assert apply(store, "interrupt", "t") == ""
    assert value(store, "battery") == pytest.approx(battery)
    assert value(store, "heat") == pytest.approx(2 * min(seconds, 10.0))
    assert facts(store) == {"(at b)"}
    assert apply(store, "interrupt", "t") == "nothing to interrupt"  # and not twice
    assert value(store, "battery") == pytest.approx(battery)


def test_continuous_effects_count_where_the_rest_is_undone(courier):
    store, clock = courier
    apply(store, "start", "t", "drive", WAY)
    clock.seconds = 2.0
    apply(store, "interrupt", "t")
    assert (value(store, "battery"), value(store, "heat"), facts(store)) == (50, 4, {"(at a)"})
    apply(store, "start", "u", "drive", WAY)
    clock.seconds = 4.0
    apply(store, "rollback", "u")  # it never began
    assert (value(store, "battery"), value(store, "heat")) == (50, 4)


def test_numbers_of_an_interruption_survive_a_crash_of_the_knowledge_base(tmp_path):
    clock = Clock()
    path = tmp_path / "state"
    store = KnowledgeStore(COURIER, clock=clock, journal=StateFile(str(path), COURIER))
    add(store, Instance("place", "a"), Instance("place", "b"), FunctionValue("battery", (), 50.0))
    add(store, FunctionValue("heat", (), 0.0), FunctionValue("cost", ("b",), 3.0))
    apply(store, "start", "t", "drive", WAY, "/n", [], [GIVE_BACK, "(decrease (battery) (cost b))"])
    shutil.copytree(tmp_path, tmp_path / "copy", ignore=shutil.ignore_patterns("copy"))
    back = KnowledgeStore(COURIER, clock=clock, journal=StateFile(str(tmp_path / "copy" / "state"), COURIER))
    clock.seconds = 4.0
    for found in (store, back):
        assert apply(found, "interrupt", "t") == ""
        assert value(found, "battery") == pytest.approx(50 - 5 * 0.4 - 3)
    assert back.executions() == []


def test_an_interruption_ends_although_a_number_is_gone(courier):
    store, _ = courier
    apply(store, "start", "t", "drive", WAY, "/n", [], ["(at b)", "(decrease (battery) (cost b))"])
    with store.transaction() as change:
        change.remove(Instance("place", "b"))
    assert "there is no number: (decrease (battery) (cost b))" in apply(store, "interrupt", "t")
    assert store.executions() == [] and value(store, "battery") == 45


def test_an_interruption_says_which_continuous_effect_it_cannot_apply(courier):
    store, clock = courier
    apply(store, "start", "t", "drive", WAY)
    with store.transaction() as change:
        change.remove(FunctionValue("heat", (), 0.0))
    clock.seconds = 2.0
    assert "heat" in apply(store, "interrupt", "t") and facts(store) == {"(at a)"}


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("(decrease (batery) 1)", "batery"),
        ("(decrease (battery))", "takes a function and a value"),
        ("(decrease (battery) (cost moon))", "unknown object 'moon'"),
        ("(decrease (battery) lots)", "lots"),
    ],
)
def test_numbers_of_an_interruption_are_checked_before_anything_begins(courier, text, reason):
    store, _ = courier
    with pytest.raises(UpdateRefused, match=reason):
        apply(store, "start", "t", "drive", WAY, "/n", [], [text])
    assert value(store, "battery") == 50 and store.executions() == []


@pytest.mark.parametrize(
    ("elapsed", "planned", "expected"),
    [
        (3.0, 10.0, (3.0, 10.0)),
        (39.0, 10.0, (10.0, 10.0)),  # it lasted longer than planned: all of it is done
        (3.0, None, (3.0, 3.0)),
    ],
)
def test_what_has_passed_is_bounded_by_what_was_planned(elapsed, planned, expected):
    numbers = passed(elapsed, planned)
    assert (numbers["#t"], numbers["?duration"]) == expected


@pytest.mark.parametrize("phase", ["end", "interrupt"])
@pytest.mark.parametrize("set_by", [0.0, 3600.0, -3600.0])
def test_a_clock_that_is_set_does_not_count_as_time_that_has_passed(set_by, phase):
    clock, watch = Clock(), Clock()
    clock.seconds = 1e6
    domain = parse_domain(
        """(define (domain d) (:requirements :durative-actions) (:functions (battery) (lasted) (told))
        (:durative-action wait :parameters () :duration (<= ?duration 60)
          :effect (and (decrease (battery) (* #t 0.5)) (at end (assign (lasted) ?duration)))))"""
    )
    store = KnowledgeStore(domain, clock=clock, passed=lambda: watch.seconds)
    add(store, *(FunctionValue(name, (), 100.0) for name in ("battery", "lasted", "told")))
    apply(store, "start", "t", "wait", {}, "/n", [], ["(assign (told) #t)"])
    clock.seconds += 10.0 + set_by
    watch.seconds += 10.0
    if phase == "end":
        apply(store, "end", "t", "wait", {})
    else:
        apply(store, "interrupt", "t")
    assert value(store, "battery") == pytest.approx(95.0)
    assert value(store, "lasted" if phase == "end" else "told") == pytest.approx(10.0)


def test_a_knowledge_base_that_came_back_takes_the_time_since_the_start_from_the_clock(tmp_path):
    clock, watch = Clock(), Clock()

    def opened():
        journal = StateFile(str(tmp_path / "state"), COURIER)
        return KnowledgeStore(COURIER, clock=clock, journal=journal, passed=lambda: watch.seconds)

    watch.seconds = 500.0
    store = opened()
    add(store, Instance("place", "a"), Instance("place", "b"), FunctionValue("battery", (), 50.0))
    add(store, FunctionValue("heat", (), 0.0))
    apply(store, "start", "t", "drive", WAY)
    store.close()
    clock.seconds, watch.seconds = 4.0, 1.0  # a process counts from its own begin
    back = opened()
    apply(back, "end", "t", "drive", WAY)
    back.close()
    assert value(back, "heat") == pytest.approx(8.0)


@pytest.mark.parametrize(
    ("duration", "reason"),
    [
        ("(>= ?duration 5)", r"write \(= \?duration …\), or make it an effect at end$"),
        ("(= ?duration (/ 1 0))", "or it divides by zero$"),
    ],
)
def test_an_effect_at_start_of_a_duration_that_is_not_known_says_what_to_write(duration, reason):
    domain = parse_domain(
        f"""(define (domain d) (:requirements :durative-actions) (:functions (battery))
        (:durative-action charge :parameters () :duration {duration}
          :effect (at start (increase (battery) (* 0.1 ?duration)))))"""
    )
    store = KnowledgeStore(domain)
    add(store, FunctionValue("battery", (), 1.0))
    with pytest.raises(UpdateRefused, match=reason):
        apply(store, "start", "t", "charge", {})
    assert store.executions() == []
