"""The restaurant's domain for several robots: plans use both, and a guest keeps one waiter."""

from pathlib import Path
from typing import List, Set

import kairos
import pytest

from merlin_pddl.checks.validate import validate

PDDL = Path(__file__).resolve().parents[3] / "pddl" / "restaurant"
DOMAIN, PROBLEM = PDDL / "robots.pddl", PDDL / "robots_problem.pddl"
SERVING = ["take_order", "order_to_barman", "load_order", "deliver_order"]
BOTH = ("(available robot_1)", "(available robot_2)")


def plan(
    goal: str, *facts: str, without: str = "", objects: str = "", better: float = 0.0
) -> List[List[str]]:
    """The actions, as words, by which a goal is reached from the problem's state and some facts.

    :param without: facts of the problem that do not hold, separated by ``|``.
    :param better: s without a better plan after which the search ends; 0: the first plan will do.
    """
    text = PROBLEM.read_text().replace("(bar_clear))\n  (:metric", f"{goal})\n  (:metric")
    for fact in filter(None, without.split("|")):
        text = text.replace(fact, "")
    text = text.replace("(:init", f"(:init {' '.join(facts)}").replace("- item)", f"- item {objects})")
    problem = kairos.parse_problem(text, kairos.parse_domain(DOMAIN.read_text()))
    search = kairos.Planner().start(
        problem, timeout=60, anytime=better > 0.0, stop_after_no_improvement=better or None
    )
    result = search.wait()
    assert result.status == kairos.Status.SOLVED, result.diagnostics
    return [[step.name, *step.args] for step in result.plan.steps]


def robots_of(steps: List[List[str]], operator: str) -> Set[str]:
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
    steps = plan(f"(and {checks})", *BOTH, better=3.0)
    assert robots_of(steps, "check_table") == {"robot_1", "robot_2"}
    assert sum(words[0] == "check_table" for words in steps) == 6


def test_both_serve_each_guest_keeps_a_waiter_and_one_robot_at_a_time_is_at_the_bar() -> None:
    waiting = ("(needs_serving table_1)", "(needs_serving table_4)")
    steps = plan("(and (already_served table_1) (already_served table_4))", *BOTH, *waiting, better=3.0)
    assert robots_of(steps, "take_order") == {"robot_1", "robot_2"}
    for table in ("table_1", "table_4"):
        serving = [words for words in steps if words[-1] == table and words[0] != "navigate"]
        assert [words[0] for words in serving] == SERVING
        assert len({words[1] for words in serving}) == 1, serving
    there = ""
    for words in steps:
        if words[0] == "navigate" and words[2] == "bar":
            assert there == words[1]
            there = ""
        if words[0] == "navigate" and words[3] == "bar":
            assert not there, steps
            there = words[1]


def test_the_waiter_of_a_guest_serves_although_the_other_is_nearer() -> None:
    known = (
        "(needs_serving table_4)",
        "(waiter robot_2 table_4)",
        "(ordered table_4)",
        "(robot_at robot_1 bar)",
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
    known = ("(prepared table_1)", "(needs_serving table_4)", "(waiter robot_1 table_4)", "(ordered table_4)")
    steps = plan("(already_served table_4)", *BOTH, *known, without="(unclaimed table_4)|(bar_clear)")
    names = [words[0] for words in steps if words[0] != "navigate"]
    assert names.index("load_order") < names.index("order_to_barman")


def test_a_client_is_led_by_the_robot_that_has_greeted() -> None:
    steps = plan("(seated ann)", *BOTH, "(waiting ann)", "(ready table_1)", objects="ann - client")
    leading = [words for words in steps if "client" in words[0]]
    assert [words[0] for words in leading] == ["greet_client", "guide_client"]
    assert leading[0][1] == leading[1][1]
