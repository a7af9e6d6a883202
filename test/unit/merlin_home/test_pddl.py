# SPDX-License-Identifier: Apache-2.0
"""The home's domain and problem: valid, readable elsewhere, and true to the world file."""

from pathlib import Path
from typing import Tuple

import kairos
import pytest

from merlin_pddl.checks.validate import validate
from merlin_sim.world.poi_distances import main as poi_distances
from merlin_sim.world.world_file import find_world

PDDL = Path(__file__).resolve().parents[3] / "pddl" / "home"
DOMAIN, PROBLEM = PDDL / "domain.pddl", PDDL / "problem.pddl"
ROBOTS = PDDL / "robots.pddl", PDDL / "robots_problem.pddl"


@pytest.mark.parametrize("files", [(DOMAIN, PROBLEM), ROBOTS])
def test_both_files_are_valid_and_other_parsers_read_them(
    files: Tuple[Path, Path], capsys: pytest.CaptureFixture
) -> None:
    code = validate(list(map(str, files)))
    output = capsys.readouterr().out
    assert code == 0 and "warning" not in output, output


@pytest.mark.parametrize("problem", [PROBLEM, ROBOTS[1]])
def test_the_travel_times_are_those_of_the_world(problem: Path, capsys: pytest.CaptureFixture) -> None:
    options = ["--function", "travel_time", "--from", "anywhere", "--speed", "0.3", "--turning", "3"]
    assert poi_distances([str(find_world("apartment")), *options]) == 0
    measured = capsys.readouterr().out.splitlines()
    stated = [line.strip() for line in problem.read_text().splitlines() if "(= (travel_time" in line]
    assert len(measured) == 16
    assert [line.rstrip(")") for line in stated] == [line.rstrip(")") for line in measured]


@pytest.mark.parametrize("words", ["--turning 3", "--speed nan", "--speed inf", "--speed 1 --turning nan"])
def test_the_command_refuses_times_that_are_none(words: str) -> None:
    with pytest.raises(SystemExit):
        poi_distances([str(find_world("apartment")), *words.split()])


def test_two_robots_share_two_points() -> None:
    domain, problem = (path.read_text() for path in ROBOTS)
    goal = "(and (checked kitchen) (checked dorm_room))"
    problem = problem.replace("(:goal (robot_at ann anywhere))", f"(:goal {goal})")
    available = problem.replace("(:init", "(:init (available ann) (available bob)")
    found = kairos.Planner().start(kairos.parse_problem(available, kairos.parse_domain(domain)), timeout=60)
    steps = found.wait().plan.steps
    assert {(step.name, step.args[0]) for step in steps} == {
        (operator, robot) for operator in ("navigate", "ask") for robot in ("ann", "bob")
    }
