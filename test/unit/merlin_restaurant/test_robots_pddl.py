# SPDX-License-Identifier: Apache-2.0
"""The restaurant's domain for several robots: plans use both, and a guest keeps one waiter."""

from pathlib import Path
from typing import Callable, Dict, List, Set

import kairos
import pytest

from merlin_pddl.checks.validate import validate
from merlin_sim.world.poi_distances import main as poi_distances
from merlin_sim.world.world_file import find_world

PDDL = Path(__file__).resolve().parents[3] / "pddl" / "restaurant"
DOMAIN, PROBLEM = PDDL / "robots.pddl", PDDL / "robots_problem.pddl"
SERVING = ["take_order", "order_to_barman", "load_order", "deliver_order"]
ROBOTS = {"robot_1", "robot_2"}
BOTH = ("(available robot_1)", "(available robot_2)")


Steps = List[List[str]]
LIMIT = 400.0  # s of wall time for a search; a loaded machine was not through after 60


def plan(
    goal: str,
    *facts: str,
    without: str = "",
    objects: str = "",
    until: Callable[[Steps], bool] = lambda steps: True,
) -> Steps:
    """The actions, as words, by which a goal is reached from the problem's state and some facts.

    :param without: facts of the problem that do not hold, separated by ``|``.
    :param until: ends the search for better plans; else it ends after :data:`LIMIT`.
    """
    text = PROBLEM.read_text().replace("(clear bar))\n  (:metric", f"{goal})\n  (:metric")
    for fact in filter(None, without.split("|")):
        text = text.replace(fact, "")
    text = text.replace("(:init", f"(:init {' '.join(facts)}").replace("- item)", f"- item {objects})")
    problem = kairos.parse_problem(text, kairos.parse_domain(DOMAIN.read_text()))
    steps: Steps = []
    for found in kairos.Planner().plans(problem, timeout=LIMIT, anytime=True):
        steps = [[step.name, *step.args] for step in found.steps]
        if until(steps):
            break
    assert steps, "no plan"
    return steps


def robots_of(steps: Steps, operator: str) -> Set[str]:
    """The robots that carry an operator out."""
    return {words[1] for words in steps if words[0] == operator}


def test_both_files_are_valid_and_have_the_distances_of_one_robot(capsys: pytest.CaptureFixture) -> None:
    code = validate([str(DOMAIN), str(PROBLEM)])
    output = capsys.readouterr().out
    assert code == 0 and "warning" not in output, output
    lines = (PDDL / "problem.pddl").read_text().splitlines()
    ways = [line.strip(" )") for line in lines if "(distance" in line]
    assert [way for way in ways if way not in PROBLEM.read_text()] == []


def test_both_robots_look() -> None:
    checks = " ".join(f"(checked table_{number})" for number in range(1, 7))
    steps = plan(f"(and {checks})", *BOTH, until=lambda steps: robots_of(steps, "check_table") == ROBOTS)
    assert robots_of(steps, "check_table") == ROBOTS
    assert sum(words[0] == "check_table" for words in steps) == 6


def test_both_serve_each_guest_keeps_a_waiter_and_one_robot_at_a_time_is_at_a_counter() -> None:
    waiting = ("(needs_serving table_1)", "(needs_serving table_4)")
    goal = "(and (already_served table_1) (already_served table_4))"
    steps = plan(goal, *BOTH, *waiting, until=lambda steps: robots_of(steps, "take_order") == ROBOTS)
    assert robots_of(steps, "take_order") == ROBOTS
    for table in ("table_1", "table_4"):
        serving = [words for words in steps if words[-1] == table and words[0] != "navigate"]
        assert [words[0] for words in serving] == SERVING
        assert len({words[1] for words in serving}) == 1, serving
    there: Dict[str, str] = {}
    for words in steps:
        if words[0] == "navigate" and words[2].startswith("bar"):
            assert there.pop(words[2]) == words[1]
        if words[0] == "navigate" and words[3].startswith("bar"):
            assert words[3] not in there, steps
            there[words[3]] = words[1]


def test_a_robot_that_is_gone_and_stands_at_the_bar_does_not_keep_guests_from_being_served() -> None:
    known = ("(needs_serving table_4)", "(robot_at robot_2 bar)", "(prepared bar table_4)")
    waiter = ("(waiter robot_2 table_4)", "(ordered table_4)")
    false = "(robot_at robot_2 anywhere)|(free bar)|(clear bar)|(unclaimed table_4)"
    steps = plan("(already_served table_4)", BOTH[0], *known, *waiter, without=false)
    assert [words for words in steps if words[0] != "navigate"] == [
        ["take_over", "robot_1", "robot_2", "table_4"],
        ["order_to_barman", "robot_1", "bar_2", "table_4"],
        ["load_order", "robot_1", "bar_2", "table_4"],
        ["deliver_order", "robot_1", "table_4"],
    ]


def test_a_robot_that_stands_where_another_one_is_needed_moves_away() -> None:
    """Only the robot that has the order can deliver it, and the other one was stopped at that table."""
    known = ("(needs_serving table_4)", "(waiter robot_1 table_4)", "(ordered table_4)")
    there = ("(carrying robot_1 table_4)", "(robot_at robot_2 table_4)")
    false = "(unclaimed table_4)|(free table_4)|(tray_free robot_1)|(robot_at robot_2 anywhere)"
    steps = plan("(already_served table_4)", *BOTH, *known, *there, without=false)
    assert [words[:3] for words in steps[:1]] == [["navigate", "robot_2", "table_4"]]
    assert steps[1:] == [
        ["navigate", "robot_1", "anywhere", "table_4"],
        ["deliver_order", "robot_1", "table_4"],
    ]


def test_a_robot_that_was_stopped_beside_a_table_drives_the_rest_before_it_looks() -> None:
    there = ("(robot_at robot_1 table_4)",)
    false = "(free table_4)|(robot_at robot_1 anywhere)"
    steps = plan("(checked table_4)", BOTH[0], *there, without=false)
    assert steps == [["line_up", "robot_1", "table_4"], ["check_table", "robot_1", "table_4"]]
    assert plan("(checked table_4)", BOTH[0], *there, "(in_position robot_1)", without=false) == steps[1:]


def test_the_waiter_of_a_guest_serves_although_the_other_is_nearer() -> None:
    known = (
        "(needs_serving table_4)",
        "(waiter robot_2 table_4)",
        "(ordered table_4)",
        "(robot_at robot_1 bar)",
        "(in_position robot_1)",
    )
    false = "(unclaimed table_4)|(robot_at robot_1 anywhere)|(free bar)"
    steps = plan("(already_served table_4)", *BOTH, *known, without=false)
    for operator in ("order_to_barman", "deliver_order"):
        assert robots_of(steps, operator) == {"robot_2"}


def test_a_waiter_that_is_gone_is_replaced() -> None:
    known = ("(needs_serving table_4)", "(waiter robot_2 table_4)", "(ordered table_4)")
    false = "(unclaimed table_4)|(tray_free robot_2)"
    steps = plan("(already_served table_4)", BOTH[0], *known, without=false)
    assert ["take_over", "robot_1", "robot_2", "table_4"] in steps
    assert {words[1] for words in steps} == {"robot_1"}


def test_an_order_on_the_bar_that_is_not_wanted_makes_room_for_the_next_one() -> None:
    known = ("(needs_serving table_4)", "(waiter robot_1 table_4)", "(ordered table_4)")
    full = ("(prepared bar table_1)", "(prepared bar_2 table_2)")
    false = "(unclaimed table_4)|(clear bar)|(clear bar_2)"
    steps = plan("(already_served table_4)", *BOTH, *known, *full, without=false)
    names = [words[0] for words in steps if words[0] != "navigate"]
    assert names.index("load_order") < names.index("order_to_barman")


def test_a_client_is_led_by_the_robot_that_has_greeted() -> None:
    steps = plan("(seated ann)", *BOTH, "(waiting ann)", "(ready table_1)", objects="ann - client")
    leading = [words for words in steps if "client" in words[0]]
    assert [words[0] for words in leading] == ["greet_client", "guide_client"]
    assert leading[0][1] == leading[1][1]


def test_two_clients_are_led_by_two_robots_one_after_the_other_at_the_entrance() -> None:
    waiting = ("(waiting ann)", "(waiting ben)", "(ready table_1)", "(ready table_4)")
    goal = "(and (seated ann) (seated ben))"
    steps = plan(
        goal,
        *BOTH,
        *waiting,
        objects="ann ben - client",
        until=lambda steps: robots_of(steps, "guide_client") == ROBOTS,
    )
    assert robots_of(steps, "guide_client") == ROBOTS
    first = next(words[1] for words in steps if words[0] == "guide_client")
    left = steps.index(next(words for words in steps if words[0] == "guide_client"))
    other = next(
        words for words in steps if words[0] == "navigate" and words[3] == "entrance" and words[1] != first
    )
    assert steps.index(other) > left


def test_a_robot_between_two_places_makes_room_by_the_plan_that_serves() -> None:
    known = ("(waiting ann)", "(ready table_1)", "(in_position robot_1)", "(robot_at robot_1 entrance)")
    false = "(free entrance)|(robot_at robot_1 anywhere)"
    goal = "(and (seated ann) (in_position robot_2))"
    steps = plan(
        goal,
        *BOTH,
        *known,
        objects="ann - client",
        without=false,
        until=lambda steps: [words[0] for words in steps if words[1] == "robot_2"] == ["navigate"],
    )
    aside = [words for words in steps if words[1] == "robot_2"]
    assert [words[0] for words in aside] == ["navigate"]
    assert aside[0][3] not in ("table_1", "entrance")


def test_the_distances_are_those_of_the_world(capsys: pytest.CaptureFixture) -> None:
    """Those of anywhere, a mean, are those of one robot, for whom there is one counter."""
    assert poi_distances([str(find_world("restaurant")), "--without", "kitchen"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert any("bar_2" in line for line in lines)
    assert [line for line in lines if line not in PROBLEM.read_text()] == []
