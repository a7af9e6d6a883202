"""The home's domain and problem: valid, readable elsewhere, and true to the world file."""

from pathlib import Path

import pytest

from merlin_pddl.checks.validate import validate
from merlin_sim.world.poi_distances import main as poi_distances
from merlin_sim.world.world_file import find_world

PDDL = Path(__file__).resolve().parents[3] / "pddl" / "home"
DOMAIN, PROBLEM = PDDL / "domain.pddl", PDDL / "problem.pddl"


def test_both_files_are_valid_and_other_parsers_read_them(capsys: pytest.CaptureFixture) -> None:
    code = validate([str(DOMAIN), str(PROBLEM)])
    output = capsys.readouterr().out
    assert code == 0 and "warning" not in output, output


def test_the_travel_times_are_those_of_the_world(capsys: pytest.CaptureFixture) -> None:
    options = ["--function", "travel_time", "--from", "anywhere", "--speed", "0.3", "--turning", "3"]
    assert poi_distances([str(find_world("apartment")), *options]) == 0
    measured = capsys.readouterr().out.splitlines()
    stated = [line.strip() for line in PROBLEM.read_text().splitlines() if "(= (travel_time" in line]
    assert len(measured) == 16
    assert [line.rstrip(")") for line in stated] == [line.rstrip(")") for line in measured]


def test_the_command_refuses_turning_without_a_speed() -> None:
    with pytest.raises(SystemExit):
        poi_distances([str(find_world("apartment")), "--turning", "3"])
