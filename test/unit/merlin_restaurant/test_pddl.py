# SPDX-License-Identifier: Apache-2.0
"""The restaurant's domain and problem: valid, solvable stage by stage, and true to the world file."""

from pathlib import Path
from typing import List

import pytest

from merlin_pddl.checks.validate import validate
from merlin_sim.world.poi_distances import main as poi_distances
from merlin_sim.world.world_file import find_world
from merlin_test import LONG

pytestmark = pytest.mark.processes

PDDL = Path(__file__).resolve().parents[3] / "pddl" / "restaurant"
DOMAIN, PROBLEM = PDDL / "domain.pddl", PDDL / "problem.pddl"
PATIENT = ["--time-limit", str(LONG)]
CHECK_ALL = " ".join(f"(checked table_{number})" for number in range(1, 7))


def plan(
    tmp_path: Path, capsys: pytest.CaptureFixture, goal: str, *facts: str, objects: str = ""
) -> List[str]:
    """The actions by which a goal is reached from the problem's state and some facts."""
    text = PROBLEM.read_text().replace("- item)", f"- item {objects})")
    if any(fact.startswith("(robot_at") for fact in facts):
        text = text.replace("(robot_at anywhere)", "")
    if any(fact.startswith("(carrying") for fact in facts):
        text = text.replace("(tray_free)", "")
    problem = tmp_path / "problem.pddl"
    problem.write_text(text.replace("(:init", f"(:init {' '.join(facts)}"))
    code = validate([*PATIENT, str(DOMAIN), str(problem), goal])
    output = capsys.readouterr().out
    assert code == 0, output
    return [line[line.index("(") : line.index(")") + 1] for line in output.splitlines() if line[:1].isdigit()]


def test_both_files_are_valid(capsys: pytest.CaptureFixture) -> None:
    code = validate([str(DOMAIN), str(PROBLEM)])
    output = capsys.readouterr().out
    assert code == 0 and "warning" not in output, output


def test_every_table_is_checked_once_on_a_short_way(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    steps = plan(tmp_path, capsys, f"(and {CHECK_ALL})")
    assert sorted(step for step in steps if "check_table" in step) == [
        f"(check_table table_{number})" for number in range(1, 7)
    ]
    assert sum("navigate" in step for step in steps) == 6


def test_an_order_goes_by_way_of_the_bar(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    steps = plan(tmp_path, capsys, "(already_served table_4)", "(needs_serving table_4)")
    assert steps == [
        "(navigate anywhere table_4)",
        "(take_order table_4)",
        "(navigate table_4 bar)",
        "(order_to_barman table_4)",
        "(load_order table_4)",
        "(navigate bar table_4)",
        "(deliver_order table_4)",
    ]


def test_a_tray_that_is_not_free_is_brought_back_first(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    facts = ["(carrying table_1)", "(needs_serving table_4)", "(ordered table_4)", "(robot_at bar)"]
    steps = plan(tmp_path, capsys, "(already_served table_4)", *facts)
    assert steps[:2] == ["(return_order table_1)", "(order_to_barman table_4)"]


def test_what_nobody_wants_any_more_goes_back_to_the_bar(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    steps = plan(
        tmp_path, capsys, "(tray_free)", "(carrying table_1)", "(robot_at table_1)", "(ready table_1)"
    )
    assert steps == ["(navigate table_1 bar)", "(return_order table_1)"]


def test_who_takes_an_order_says_nothing_else_meanwhile(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    problem = tmp_path / "problem.pddl"
    text = PROBLEM.read_text().replace("(robot_at anywhere)", "(robot_at table_4) (needs_serving table_4)")
    problem.write_text(text)
    goal = "(and (checked table_4) (ordered table_4))"
    assert validate([*PATIENT, str(DOMAIN), str(problem), goal]) == 0
    steps = [line for line in capsys.readouterr().out.splitlines() if line[:1].isdigit()]
    first, second = (float(line.split(":")[0]) for line in steps)
    assert second - first >= 6.0, steps


def test_a_client_gets_the_nearest_free_table(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    facts = ["(waiting ann)", "(ready table_3)", "(ready table_1)", "(ready table_6)"]
    steps = plan(tmp_path, capsys, "(seated ann)", *facts, objects="ann - client")
    assert steps == ["(navigate anywhere entrance)", "(greet_client ann)", "(guide_client ann table_1)"]


def test_no_client_is_seated_where_no_table_is_free(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    problem = tmp_path / "problem.pddl"
    problem.write_text(PROBLEM.read_text().replace("- item)", "- item ann - client)"))
    assert validate([*PATIENT, str(DOMAIN), str(problem), "(seated ann)"]) != 0
    assert "no plan" in capsys.readouterr().out


def test_the_distances_are_those_of_the_world(capsys: pytest.CaptureFixture) -> None:
    without = ["--without", "kitchen", "bar_2"]
    assert poi_distances([str(find_world("restaurant")), "--from", "anywhere", *without]) == 0
    for line in capsys.readouterr().out.splitlines():
        assert line in PROBLEM.read_text()
