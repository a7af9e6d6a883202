# SPDX-License-Identifier: Apache-2.0
"""Two things cannot stand in the same place."""

import math

import cv2
import numpy as np
import pytest

from merlin_reactive.pose import Pose
from merlin_sim.world.footprints import collide, shared_area
from merlin_sim.world.survey import reachable
from merlin_sim.world.world_model import Solid


def polygon(draw):
    count, turn, radius = int(draw.choice([4, 24])), draw.random() * 6, draw.random() + 0.1
    x, y = draw.normal(size=2) * 0.6
    angles = [turn + 2 * math.pi * index / count for index in range(count)]
    return [(x + radius * math.cos(angle), y + radius * math.sin(angle)) for angle in angles]


@pytest.mark.parametrize("seed", range(40))
def test_the_shared_area_is_that_of_opencv(seed):
    draw = np.random.default_rng(seed)
    one, other = polygon(draw), polygon(draw)
    area, _ = cv2.intersectConvexConvex(np.array(one, np.float32), np.array(other, np.float32))
    assert shared_area(one, other) == pytest.approx(area, abs=1e-4)
    assert shared_area(one, one) == pytest.approx(cv2.contourArea(np.array(one, np.float32)), abs=1e-4)


def box(x, y, yaw=0.0):
    return Solid("box", Pose(x, y, yaw), 1.0, size=(1.0, 0.5))


@pytest.mark.parametrize(
    "other, expected",
    [(box(1.0, 0.0), False), (box(0.99, 0.0), True), (box(0.0, 0.5), False), (box(0.6, 0.45, 0.8), True)],
)
def test_things_may_stand_side_by_side(other, expected):
    assert collide(box(0.0, 0.0), other) is expected
    assert collide(other, box(0.0, 0.0)) is expected


@pytest.mark.parametrize("seed", range(20))
def test_what_is_reachable_is_connected_over_edges(seed):
    draw = np.random.default_rng(seed)
    free = draw.random((30, 40)) > 0.4
    starts = [(int(draw.integers(30)), int(draw.integers(40))) for _ in range(2)]
    _, labels = cv2.connectedComponents(free.astype(np.uint8), connectivity=4)
    expected = free & np.isin(labels, [labels[start] for start in starts if free[start]])
    assert np.array_equal(reachable(free, starts), expected)
