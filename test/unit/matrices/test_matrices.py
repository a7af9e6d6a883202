# SPDX-License-Identifier: Apache-2.0
"""The commands that measure: what they count, and that they measure the right thing."""

import math
from argparse import ArgumentTypeError
from types import SimpleNamespace

import pytest
from matrices.listening_matrix import Question, tallies
from matrices.navigation_matrix import main as navigation_matrix
from matrices.positioning_matrix import found_after, odometry_errors
from matrices.trial import trials

from merlin_sim.robot.diff_drive import OdometryNoise
from merlin_sim.world.world_file import find_world, load_world


def test_the_square_of_odometry_bumps_into_nothing():
    world = load_world(find_world("apartment"))
    metres, radians = odometry_errors(world, OdometryNoise(), 1)
    assert metres < 0.005 and radians < 0.01


@pytest.mark.parametrize("text", ["0", "-1", "two", ""])
def test_no_trials_are_no_figures(text):
    with pytest.raises(ArgumentTypeError):
        trials(text)
    assert trials("2") == 2


def test_a_case_that_does_not_exist_is_no_empty_table(capsys):
    with pytest.raises(SystemExit):
        navigation_matrix(["--case", "flood"])
    assert "no case of apartment contains 'flood'" in capsys.readouterr().err


class Parrot:
    """Understands the same, whatever is said."""

    def use(self, grammar):
        self.grammar = grammar

    def understand(self, samples):
        assert len(samples)
        return SimpleNamespace(text="yes")


def test_sentences_are_counted_by_what_became_of_them():
    question = Question("?", "grammar", ("yes", "no"), ("hello",))
    allowed, others = tallies(question, "en-us", Parrot(), 1)
    assert (allowed.shown, allowed.right, allowed.wrong) == (2, 1, 1)
    assert (others.shown, others.right, others.wrong) == (1, 0, 1)


@pytest.mark.parametrize(
    ("errors", "found"),
    [
        ([(0.0, 0.1, 0.0), (1.0, 0.1, 0.0)], 0.0),
        ([(0.0, 3.0, 0.0), (1.0, 0.1, 1.0), (2.0, 0.1, 0.0)], 1.0),
        ([(0.0, 0.1, 0.0), (1.0, 3.0, 0.0)], math.inf),
    ],
)
def test_a_robot_is_found_when_it_is_not_lost_again(errors, found):
    assert found_after(errors) == found
