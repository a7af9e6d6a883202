# SPDX-License-Identifier: Apache-2.0
"""Results of sensing functions as facts."""

import numpy as np
import pytest

from merlin_rosplan.knowledge.sensed_facts import SensedFacts, SensingError, facts_of, parameter_choices


def test_wildcards_stand_for_all_instances():
    objects = {"person": ["ann", "bob"], "room": ["hall", "den"]}
    assert parameter_choices(["ann", "*"], ["person", "room"], objects.__getitem__) == [
        ["ann"],
        ["hall", "den"],
    ]
    assert parameter_choices([], ["person"], objects.__getitem__) == [["ann", "bob"]]
    assert parameter_choices([["a", "b"]], ["person"], objects.__getitem__) == [["a", "b"]]


def test_the_number_of_params_must_fit():
    with pytest.raises(SensingError, match="3 entries, the predicate 2"):
        parameter_choices(["a", "b", "c"], ["person", "room"], lambda _: [])


def test_one_value_counts_for_every_combination():
    facts = facts_of("at", False, [["ann"], ["hall", "den"]])
    assert facts == {("at", ("ann", "hall")): False, ("at", ("ann", "den")): False}


def test_a_list_names_its_objects():
    assert facts_of("at", [("ann:hall", True), ("ann:den", False)], [[], []]) == {
        ("at", ("ann", "hall")): True,
        ("at", ("ann", "den")): False,
    }
    assert facts_of("battery", [("ann", 3)], [["ann"]]) == {("battery", ("ann",)): 3}
    assert facts_of("powered", [("", True)], []) == {("powered", ()): True}


def test_bools_and_numbers_of_numpy_count():
    (value,) = facts_of("powered", np.float64(3.0) > 2.0, []).values()
    assert value is True
    assert facts_of("battery", [("ann", np.int64(3)), ("bob", np.float32(0.5))], [[]]) == {
        ("battery", ("ann",)): 3,
        ("battery", ("bob",)): 0.5,
    }


@pytest.mark.parametrize("value", [float("nan"), float("-inf"), np.float32("nan"), np.float64("inf")])
def test_what_is_not_finite_is_left_out(value):
    assert facts_of("battery", value, [["ann", "bob"]]) == {}
    assert facts_of("battery", [("ann", value), ("bob", 3)], [[]]) == {("battery", ("bob",)): 3}


def test_what_is_left_out_is_reported_once_for_a_result():
    reported = []
    values = [("ann", float("nan")), ("bob", float("inf")), ("carl", 10**400), ("dora", True)]
    assert len(facts_of("battery", values, [[]], reported.append)) == 2
    facts_of("battery", [("bob", 1.0)], [[]], reported.append)
    assert reported == ["what is not a finite number is left out"]


@pytest.mark.parametrize(
    "result",
    [np.zeros(2), np.array(["a"]), "yes", {1: 1}, [("a", True)], [("a:b", "yes")], ["a:b"], object(), np.add],
)
def test_results_that_make_no_sense_are_refused(result):
    with pytest.raises(SensingError):
        facts_of("at", result, [["ann"], ["hall"]])


def test_only_news_is_reported():
    sensed = SensedFacts()
    assert sensed.sense({("powered", ()): True})
    assert sensed.take_news() == {("powered", ()): True}
    assert not sensed.sense({("powered", ()): True})
    assert sensed.sense({("powered", ()): False})
    assert sensed.take_news() == {("powered", ()): False}
    assert sensed.take_news() == {}


def test_what_others_changed_is_reported_again():
    sensed = SensedFacts()
    sensed.sense({("powered", ()): True, ("at", ("ann",)): True})
    sensed.take_news()
    assert sensed.forget_sent(["POWERED"])
    assert sensed.take_news() == {("powered", ()): True}
    assert not sensed.forget_sent(["unrelated"])
    assert sensed.forget_sent()
    assert len(sensed.take_news()) == 2


def test_what_could_not_be_reported_stays_news_with_its_newest_value():
    sensed = SensedFacts()
    sensed.sense({("battery", ("ann",)): 5.0})
    news = sensed.take_news()
    sensed.sense({("battery", ("ann",)): 4.0})
    sensed.keep_news(news)
    assert sensed.take_news() == {("battery", ("ann",)): 4.0}
