# SPDX-License-Identifier: Apache-2.0
"""The lower bound for several robots that share tasks."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from robots.shared_tasks import SharedTasks, Stand

from merlin_experiment.oracle.motion_limits import MotionLimits
from merlin_experiment.oracle.oracle import Oracle
from merlin_experiment.oracle.outlines import Outline, Outlines
from merlin_experiment.oracle.shortest_path import ShortestPaths

LIMITS = MotionLimits(speed=0.5, acceleration=1.0, turn_rate=1.0, turn_acceleration=2.0, radius=0.25)
SPEECH = 5.0
WALL = Outline(((2.0, -1.0), (2.2, -1.0), (2.2, 1.0), (2.0, 1.0)))
PATHS = ShortestPaths(Outlines([WALL]), LIMITS.radius)
ORACLE = Oracle(PATHS, LIMITS, SPEECH)
LEFT, RIGHT = Stand(0.0, 0.0, 0.0), Stand(4.0, 0.0, math.pi)
POINTS = st.tuples(st.floats(-1.0, 1.5), st.floats(-3.0, 3.0))


def time(robots, points):
    return SharedTasks(ORACLE, PATHS).time(robots, points)


def test_each_robot_does_the_task_on_its_side() -> None:
    near, far = (1.0, 0.0), (3.0, 0.0)
    # 1 m straight on: 0.5 s up, 0.5 s down, 0.75 m at 0.5 m/s
    assert time([LEFT, RIGHT], [near, far]) == pytest.approx(2.5 + SPEECH)
    assert time([LEFT, RIGHT], [far, near]) == pytest.approx(2.5 + SPEECH)


def test_one_robot_does_them_in_the_better_order() -> None:
    near, farther = (0.5, 0.0), (1.0, 0.0)
    on = ORACLE.task(near, 0.0, farther).time
    assert time([LEFT], [farther, near]) == pytest.approx(ORACLE.task((0.0, 0.0), 0.0, near).time + on)


def test_a_robot_whose_way_is_long_leaves_both_to_the_other() -> None:
    near = [(0.2, 0.0), (0.4, 0.0)]
    away = Stand(40.0, 0.0, 0.0)
    assert time([LEFT, away], near) == pytest.approx(time([LEFT], near))


def test_the_same_point_twice_costs_the_question_twice() -> None:
    assert time([LEFT], [(1.0, 0.0)] * 2) == pytest.approx(2.5 + 2 * SPEECH)


@settings(max_examples=25, deadline=None)
@given(st.lists(POINTS, min_size=1, max_size=3), st.floats(-math.pi, math.pi))
def test_a_further_robot_never_makes_it_longer_nor_a_task_shorter(points, yaw) -> None:
    one, two = [Stand(0.0, 0.0, yaw)], [Stand(0.0, 0.0, yaw), RIGHT]
    assert time(two, points) <= time(one, points) + 1e-9
    assert time(two, points[:-1]) <= time(two, points) + 1e-9
