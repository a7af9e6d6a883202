# SPDX-License-Identifier: Apache-2.0
"""Distances on a grid are those of OpenCV, also where nothing is occupied."""

import cv2
import numpy as np
import pytest

from merlin_reactive.distance_field import distance_field


def grid(rows, columns, occupied, seed=1):
    free = np.ones((rows, columns), np.uint8)
    draw = np.random.default_rng(seed)
    free[draw.integers(rows, size=occupied), draw.integers(columns, size=occupied)] = 0
    return free


@pytest.mark.parametrize(
    "size", [(60, 90, 200), (60, 90, 4), (1, 50, 3), (50, 1, 2), (7, 7, 1), (40, 320, 1)]
)
def test_they_are_exact(size):
    free = grid(*size)
    exact = cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    assert np.allclose(distance_field(free), exact, rtol=1e-6)
    assert np.array_equal(distance_field(free.astype(bool)), distance_field(free))


@pytest.mark.parametrize("size", [(60, 90, 40), (90, 60, 4), (1, 50, 3), (50, 1, 2)])
def test_up_to_a_given_one_they_are_exact_and_beyond_it_longer(size):
    free = grid(*size)
    exact, most = distance_field(free), 6
    near = exact <= most
    found = distance_field(free, most)
    assert near.any() and not near.all()
    assert np.array_equal(found[near], exact[near]) and (found[~near] > most).all()


def test_nothing_occupied_is_farther_than_the_grid_is_large():
    assert (distance_field(np.ones((4, 6))) >= 10).all()
