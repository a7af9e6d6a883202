# SPDX-License-Identifier: Apache-2.0
"""The way to the modules beside the tests; a robot whose plan is revised."""

import sys
from pathlib import Path
from typing import Any, Iterator

import pytest
import rospy
from fakes.revision_bench import Bench, Robot

from merlin_test import LONG

sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture
def robot() -> Robot:
    return Robot()


@pytest.fixture
def leave_limit() -> float:
    return LONG


@pytest.fixture
def bench(
    robot: Robot, leave_limit: float, tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Bench]:
    for module in ("merlin_sm.states.planning", "merlin_executor.node.plan_revision"):
        monkeypatch.setattr(f"{module}.master_answers", lambda *_: True)
    monkeypatch.setattr(rospy.Time, "now", lambda: rospy.Time(1))
    for level in ("loginfo", "logwarn", "logerr", "logerr_throttle_identical"):
        monkeypatch.setattr(rospy, level, lambda *_: None)
    made = Bench(robot, str(tmp_path / "goals"), leave_limit)
    yield made
    robot.answer()
    made.engine.shutdown(LONG)
    assert robot.stored == [], "no goal is left in the knowledge base"
    assert made.ended == [], "a goal of a request that has succeeded did not hold"
