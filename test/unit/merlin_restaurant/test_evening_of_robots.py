"""The mission with several robots: one plan for all that waits."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any, List

import pytest
from fake_robot import FakeRobot
from merlin_msgs.msg import ExecuteResult, ListenResult

from merlin_pddl.domain_reader import parse_domain
from merlin_restaurant.actions import of_robots
from merlin_restaurant.evening import AT_ONCE, TRIES, URGENT, Evening
from merlin_restaurant.table_state import remember_state
from merlin_sm.rosplan_assistant import MerlinROSPlanAssistant

FAILED = ExecuteResult(outcome=ExecuteResult.ACTION_FAILED, reason="the way is blocked")
DOMAIN = Path(__file__).resolve().parents[3] / "pddl" / "restaurant" / "robots.pddl"
NAMES = ["robot_1", "robot_2"]


@pytest.fixture()
def evening(robot: FakeRobot) -> FakeRobot:
    robot.things = {"table": ["table_1", "table_2"]}
    robot.known = ["(ready table_1)", "(ready table_2)", *(f"(available {name})" for name in NAMES)]
    return robot


def run() -> str:
    """An evening that has closed before it begins."""
    return Evening(lambda: True, lambda line: None, robots=NAMES).run()


def test_tables_and_entrance_are_looked_at_by_one_plan(evening: FakeRobot) -> None:
    evening.known.remove("(ready table_2)")
    assert run() == "succeeded"
    assert evening.sent[:2] == [("(checked table_2)", 0), ("(entrance_checked)", 0)]


def test_all_tables_that_wait_are_served_by_one_plan_and_trays_are_tidied(evening: FakeRobot) -> None:
    evening.known = [fact for fact in evening.known if "ready" not in fact]
    evening.known += ["(needs_serving table_1)", "(needs_serving table_2)", "(carrying robot_2 table_1)"]
    requests: List[List[str]] = []
    send = evening.send

    def note(goals: Any, *arguments: Any, **named: Any) -> Any:
        requests.append(list(goals))
        if "(tray_free robot_2)" in goals:
            evening.change(remove="(carrying robot_2 table_1)")
        evening.change(remove=[f"(needs_serving {goal.split()[1]}" for goal in goals if "served" in goal])
        return send(goals, *arguments, **named)

    evening.send = note  # type: ignore[method-assign]
    assert run() == "succeeded"
    assert ["(already_served table_1)", "(already_served table_2)"] in requests
    assert ["(tray_free robot_2)"] in requests
    assert ("(already_served table_1)", URGENT) in evening.sent


def test_a_table_that_cannot_be_served_is_tried_again_but_not_for_ever(evening: FakeRobot) -> None:
    evening.known.append("(needs_serving table_1)")
    evening.results["(already_served table_1)"] = FAILED
    assert run() == "succeeded"
    assert evening.goals.count("(already_served table_1)") == TRIES


def test_what_a_robot_carries_that_is_gone_is_out_of_reach(evening: FakeRobot) -> None:
    evening.known.remove("(available robot_2)")
    evening.known.append("(carrying robot_2 table_1)")
    assert run() == "succeeded"
    assert "(tray_free robot_2)" not in evening.goals


@pytest.mark.parametrize(
    ("call", "goal"),
    [
        ("waiter table two please", "(already_served table_2)"),
        ("good evening we would like a table", "(entrance_checked)"),
    ],
)
def test_a_call_interrupts_what_is_served_and_joins_it(evening: FakeRobot, call: str, goal: str) -> None:
    evening.known.append("(needs_serving table_1)")
    closed: List[bool] = []

    def close(sent: str) -> None:
        if (goal, AT_ONCE) in evening.sent:
            closed.append(True)

    evening.on_goal = close
    mission = Evening(lambda: bool(closed), lambda line: None, robots=NAMES)
    evening.servers["calls/listen"].results.append(ListenResult(text=call, heard=True))
    assert mission.run() == "succeeded"
    joined = [sent for sent, priority in evening.sent if priority == AT_ONCE]
    assert "(already_served table_1)" in joined and goal in joined


def test_a_guest_who_left_leaves_no_waiter(evening: FakeRobot, monkeypatch: pytest.MonkeyPatch) -> None:
    knowledge = SimpleNamespace(predicates=lambda: {"waiter": None})
    monkeypatch.setattr(MerlinROSPlanAssistant, "knowledge", knowledge)
    evening.known += ["(waiter robot_1 table_1)", "(waiter robot_2 table_2)", "(ordered table_1)"]
    remember_state(MerlinROSPlanAssistant(), "table_1", "needs_cleaning")
    assert "(waiter robot_2 table_2)" in evening.known
    assert "(unclaimed table_1)" in evening.known
    assert not {"(waiter robot_1 table_1)", "(ordered table_1)", "(ready table_1)"} & set(evening.known)


def test_each_operator_has_a_class_with_its_parameters() -> None:
    domain = parse_domain(DOMAIN.read_text())
    classes = {
        kind.operator_name(): kind for kind in vars(of_robots).values() if getattr(kind, "parameters", ())
    }
    for operator in domain.operators.values():
        assert list(classes.pop(operator.name).parameters) == [
            one.name.strip("?") for one in operator.parameters
        ]
    assert classes == {}
