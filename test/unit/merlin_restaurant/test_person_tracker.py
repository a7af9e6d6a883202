# SPDX-License-Identifier: Apache-2.0
"""Tracking the person that follows: simulated scans of a person, a wall and other people."""

import math
from typing import List, Tuple

import numpy as np

from merlin_restaurant.person_tracker import PersonTracker, people_like

Circle = Tuple[float, float, float]


def scan(circles: List[Circle], wall: float = 3.0) -> np.ndarray:
    """Points of 360 rays from the origin; circles are x, y, radius; a wall stands at x = -wall."""
    points = []
    for angle in np.radians(np.arange(360)):
        ray = np.array([math.cos(angle), math.sin(angle)])
        hits = [-wall / ray[0]] if ray[0] < -0.01 else []
        for x, y, radius in circles:
            along = ray[0] * x + ray[1] * y
            off = radius**2 - (x * x + y * y - along**2)
            if along > 0 and off > 0:
                hits.append(along - math.sqrt(off))
        if hits and min(hits) < 10.0:
            points.append(min(hits) * ray)
    return np.array(points)


def test_a_person_is_found_and_a_table_is_not() -> None:
    bodies = people_like(scan([(1.5, 0.0, 0.22), (0.0, 2.0, 0.4)]))
    assert len(bodies) == 1
    assert math.dist(bodies[0], (1.5, 0.0)) < 0.05


def test_nobody_is_found_where_nothing_is() -> None:
    assert people_like(np.zeros((0, 2))) == []
    assert not PersonTracker().update(0.0, (0.0, 0.0, 0.0), scan([]))


def test_the_robot_drives_off_and_the_person_stays_behind() -> None:
    tracker = PersonTracker()
    for step in range(40):
        x = -0.05 * step  # backwards, so that the person stays at x = 1.5 of the fixed frame
        seen = tracker.update(0.1 * step, (x, 0.0, 0.0), scan([(1.5 - x, 0.0, 0.22), (1.5 - x, 1.2, 0.22)]))
        assert seen
    assert abs(tracker.distance - (1.5 + 0.05 * 39)) < 0.1
    assert math.dist(tracker.place, (1.5, 0.0)) < 0.1, "it is still the person that stood in front"


def test_who_follows_a_turning_robot_is_not_confused_with_somebody_else() -> None:
    tracker = PersonTracker()
    sitting = (0.5, 1.3)
    for step in range(60):
        yaw, person = 0.05 * step, (1.5 - 0.01 * step, -0.02 * step)
        circles = [
            (
                math.cos(yaw) * x + math.sin(yaw) * y,
                math.cos(yaw) * y - math.sin(yaw) * x,
                0.22,
            )
            for x, y in (person, sitting)
        ]
        assert tracker.update(0.1 * step, (0.0, 0.0, yaw), scan(circles, 9.0))
    assert math.dist(tracker.place, person) < 0.1


def test_somebody_who_is_gone_is_not_seen() -> None:
    tracker = PersonTracker()
    assert tracker.update(0.0, (0.0, 0.0, 0.0), scan([(1.5, 0.0, 0.22)]))
    assert not tracker.update(0.1, (0.0, 0.0, 0.0), scan([(0.0, 3.0, 0.22)]))
    assert tracker.seen == 0.0
