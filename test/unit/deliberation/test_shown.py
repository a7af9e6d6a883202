# SPDX-License-Identifier: Apache-2.0
"""What the page gets of the house: a map, and where the robot is on it."""

import math
from typing import Any, Tuple

import numpy
import pytest
from fakes.topics import Topics

from deliberation.shown import Shown
from merlin_test import LONG


class Simulation:
    def floor(self, cell: float) -> Tuple[float, float, Any]:
        return -1.0, -2.0, numpy.array([[100, 0, 100], [100, 0, 0]])

    def pose(self) -> Tuple[float, float, float]:
        return 0.5, -1.5, math.pi / 2


def test_the_house_and_the_robot_are_shown(clock: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    topics = Topics(monkeypatch)
    shown = Shown(Simulation())  # type: ignore[arg-type]
    shown.start()
    grid = topics.published("/map").get(timeout=LONG)
    assert (grid.info.width, grid.info.height, list(grid.data)) == (3, 2, [100, 0, 100, 100, 0, 0])
    assert (grid.info.origin.position.x, grid.info.origin.position.y) == (-1.0, -2.0)
    (at,) = topics.published("/tf").get(timeout=LONG).transforms
    shown.shutdown()
    assert (at.header.frame_id, at.child_frame_id) == ("map", "base_footprint")
    assert (at.transform.translation.x, at.transform.translation.y) == (0.5, -1.5)
    assert 2 * math.atan2(at.transform.rotation.z, at.transform.rotation.w) == pytest.approx(math.pi / 2)
