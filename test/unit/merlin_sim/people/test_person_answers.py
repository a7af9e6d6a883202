# SPDX-License-Identifier: Apache-2.0
"""What simulated people answer, and which of them hears the robot."""

import math

import pytest
import rospy

from merlin_reactive.seeded_random import draw
from merlin_ros.parameters import ParameterError
from merlin_sim.people.listener import Answers, HearingPerson, nearest, read_listeners


def random():
    return draw(1, "test", 0)


def test_next_answers_come_first_then_patterns_then_chance():
    answers = Answers(["maybe"], ["not yet"], ["order|like", "follow"], ["a coffee please", ""])
    assert answers.to("What would you like?", random()) == "not yet"
    assert answers.to("What would you LIKE?", random()) == "a coffee please"
    assert answers.to("Please follow me", random()) == ""
    assert answers.to("Hello", random()) == "maybe"
    assert Answers().to("Hello", random()) == ""


def with_parameters(monkeypatch, **given):
    parameters = {f"~{name}": value for name, value in given.items()}
    monkeypatch.setattr(rospy, "get_param", lambda name, default=None: parameters.get(name, default))


def test_replies_are_for_what_they_fit(monkeypatch):
    with_parameters(monkeypatch, answers=[], replies=[["^Hello", "what are you doing"], ["^Step", "why"]])
    (person,) = read_listeners()
    heard = ("Hello. Do you need something?", "Step 1 is there for it.", "I said hello.")
    assert [person.answers.to(each, random()) for each in heard] == ["what are you doing", "why", ""]


@pytest.mark.parametrize(
    "replies", ["^Hello", {"^Hello": "why"}, [["^Hello"]], [["^Hello", 3]], [["(", "why"]]]
)
def test_replies_that_cannot_be_used_are_named(monkeypatch, replies):
    with_parameters(monkeypatch, replies=replies)
    with pytest.raises(ParameterError, match=r"^parameter ~replies"):
        read_listeners()


@pytest.mark.parametrize(
    ("patterns", "answers", "words"),
    [(["a"], [], "1 patterns and 0 answers"), (["(a"], ["b"], "'(a' is not a regular expression")],
)
def test_what_does_not_go_together_is_refused(patterns, answers, words):
    with pytest.raises(ValueError) as error:
        Answers(patterns=patterns, answers=answers)
    assert words in str(error.value)


def test_the_nearest_who_hears_the_robot_answers():
    ann, bob = (HearingPerson(name, Answers(), hearing=3.0) for name in ("ann", "bob"))
    people = {"ann": (0.0, 0.0), "bob": (5.0, 0.0)}
    assert nearest([ann, bob], (1.0, 0.0), people) is ann
    assert nearest([ann, bob], (3.0, 0.0), people) is bob
    assert nearest([ann, bob], (2.0, 9.0), people) is None
    assert nearest([ann, bob], (1.0, 0.0), {"bob": (5.0, 0.0)}) is None  # ann is not in the world
    assert nearest([ann, bob], None, people) is None
    # The robot speaks to whom it faces, unless another one is much nearer.
    assert nearest([ann, bob], (2.0, 0.0), people, heading=0.0) is bob
    assert nearest([ann, bob], (2.0, 0.0), people, heading=math.pi) is ann
    assert nearest([ann, bob], (0.5, 0.0), people, heading=0.0) is ann
    assert nearest([HearingPerson("", Answers(), anywhere=True)], None, {}).name == ""
