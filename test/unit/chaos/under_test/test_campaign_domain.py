# SPDX-License-Identifier: Apache-2.0
"""The domain of the campaign: only a trial that is about a drive that misbehaves has one in its plans."""

from pathlib import Path

import pytest

from merlin_pddl.checks import kairos_check
from merlin_rosplan.planning.planner import PlannerSettings
from merlin_rosplan.planning.planning_outcome import PlannerState
from merlin_rosplan.supervision.supervised_planning import Planning

APPLICATION = Path(__file__).parents[4] / "bench" / "chaos" / "under_test" / "application"


@pytest.mark.skipif(not kairos_check.available(), reason="kairos needs Python 3.10")
@pytest.mark.parametrize("fact, state", [("", PlannerState.UNSOLVABLE), ("(odd)", PlannerState.SOLVED)])
def test_a_drive_that_misbehaves_has_to_be_asked_for(tmp_path: Path, fact: str, state: PlannerState) -> None:
    text = (APPLICATION / "problem.pddl").read_text().replace("(:init", f"(:init {fact}")
    problem = tmp_path / "problem.pddl"
    problem.write_text(text.replace("(:goal (and))", "(:goal (and (deaf_at kitchen)))"))
    assert Planning(PlannerSettings(), str(APPLICATION / "domain.pddl"), str(problem)).run().state is state
