# SPDX-License-Identifier: Apache-2.0
"""The mission with several robots: one plan for all that waits."""

import re
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any, List

import pytest
from fake_robot import FakeRobot
from merlin_msgs.msg import ExecuteResult, ListenResult, RobotWay

from merlin_pddl.domain_reader import parse_domain
from merlin_restaurant import evening as evening_module
from merlin_restaurant.evening import AT_ONCE, TRIES, Evening
from merlin_restaurant.table_state import remember_state
from merlin_ros.class_path import load_class
from merlin_sm.rosplan_assistant import MerlinROSPlanAssistant
from merlin_test import LONG

FAILED = ExecuteResult(outcome=ExecuteResult.ACTION_FAILED, reason="the way is blocked")
ROOT = Path(__file__).resolve().parents[3]
DOMAIN = ROOT / "pddl" / "restaurant" / "robots.pddl"
NAMES = ["robot_1", "robot_2"]


@pytest.fixture()
def evening(robot: FakeRobot) -> FakeRobot:
    robot.things = {"table": ["table_1", "table_2"], "counter": ["bar"]}
    robot.known = ["(ready table_1)", "(ready table_2)", *(f"(available {name})" for name in NAMES)]
    robot.known += [f"({state} {name})" for name in NAMES for state in ("quiet", "in_position")]
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
    evening.known += ["(needs_serving table_1)", "(needs_serving table_2)", "(carrying robot_2 table_3)"]
    requests: List[List[str]] = []
    send = evening.send

    def note(goals: Any, *arguments: Any, **named: Any) -> Any:
        requests.append(list(goals))
        if "(tray_free robot_2)" in goals:
            evening.change(remove="(carrying robot_2 table_3)")
        evening.change(remove=[f"(needs_serving {goal.split()[1]}" for goal in goals if "served" in goal])
        return send(goals, *arguments, **named)

    evening.send = note  # type: ignore[method-assign]
    assert run() == "succeeded"
    assert any(
        request[:3] == ["(already_served table_1)", "(already_served table_2)", "(tray_free robot_2)"]
        for request in requests
    )
    assert ("(already_served table_1)", AT_ONCE) in evening.sent


def test_a_table_that_cannot_be_served_is_tried_again_but_not_for_ever(evening: FakeRobot) -> None:
    evening.known.append("(needs_serving table_1)")
    evening.results["(already_served table_1)"] = FAILED
    assert run() == "succeeded"
    assert evening.goals.count("(already_served table_1)") == TRIES


def test_clients_are_seated_by_the_plan_that_serves_tables_one_for_each_ready_table(
    evening: FakeRobot,
) -> None:
    evening.known.remove("(ready table_1)")
    evening.known += ["(needs_serving table_1)", "(waiting client_1)", "(waiting client_2)"]
    plans: List[List[str]] = []
    send = evening.send

    def note(goals: Any, *arguments: Any, **named: Any) -> Any:
        plans.append(list(goals))
        if "(seated client_1)" in goals:
            evening.change(remove=["(needs_serving table_1)", "(waiting client_1)"])
        if "(seated client_2)" in goals:
            evening.change(remove="(waiting client_2)")
        return send(goals, *arguments, **named)

    evening.send = note  # type: ignore[method-assign]
    assert run() == "succeeded"
    seating = [plan[:2] for plan in plans if plan[0].startswith("(seated")]
    assert seating[0] == ["(seated client_1)", "(already_served table_1)"]
    assert seating[1][0] == "(seated client_2)"


def test_a_client_waits_while_no_table_is_ready_and_that_is_reported(evening: FakeRobot) -> None:
    evening.known = [fact for fact in evening.known if "ready" not in fact]
    evening.known.append("(waiting client_1)")
    reported: List[str] = []
    Evening(lambda: True, reported.append, robots=NAMES).run()
    assert not any("seated" in goal for goal in evening.goals)
    assert "a client has to wait: no table is known to be free" in reported


def test_where_a_robot_stands_that_is_gone_no_other_one_is_sent(evening: FakeRobot) -> None:
    evening.known = [fact for fact in evening.known if "ready" not in fact]
    evening.known += ["(needs_serving table_1)", "(robot_at robot_1 table_2)", "(robot_at robot_2 table_1)"]
    evening.known.remove("(available robot_2)")
    assert run() == "succeeded"
    assert "(checked table_2)" in evening.goals and "(entrance_checked)" in evening.goals
    assert not any("table_1" in goal for goal in evening.goals)
    evening.known.remove("(robot_at robot_2 table_1)")
    evening.known.append("(robot_at robot_2 entrance)")
    evening.sent.clear()
    assert run() == "succeeded"
    assert "(checked table_1)" in evening.goals and "(entrance_checked)" not in evening.goals


@pytest.mark.parametrize(("far", "place"), [(0.2, "table_1"), (0.2, "bar"), (1.0, "bar")])
def test_a_robot_that_died_as_it_set_off_stands_where_it_was(
    evening: FakeRobot, far: float, place: str
) -> None:
    """As far as the knowledge tells it is anywhere."""
    points = {"table_1": {"x": 1.0, "y": 2.0, "yaw": 0.0}, "bar": {"x": 7.0, "y": 2.0, "yaw": 0.0}}
    evening.parameters["/robot_2/world/points_of_interest"] = points
    evening.known = [fact for fact in evening.known if "ready" not in fact]
    evening.known += ["(needs_serving table_1)", "(robot_at robot_2 anywhere)"]
    mission = Evening(lambda: True, lambda line: None, robots=NAMES)
    way = RobotWay(robot="robot_2")
    way.pose.position.x, way.pose.position.y = points[place]["x"] + far, 2.0
    for take in evening.on_way:
        take(way)
    assert mission._urgent() == ["(already_served table_1)"]  # it drives
    evening.known.remove("(available robot_2)")
    assert mission._urgent() == ([] if far < 0.6 else ["(already_served table_1)"])
    assert ("(checked table_1)" in mission._tables(None)) == (far > 0.6 or place == "bar")


def test_a_bar_with_a_second_counter_is_not_closed_by_a_robot_that_is_gone(evening: FakeRobot) -> None:
    evening.things["counter"] = ["bar", "bar_2"]
    evening.known = [fact for fact in evening.known if "ready" not in fact]
    evening.known += ["(needs_serving table_1)", "(robot_at robot_2 bar)", "(carrying robot_1 table_2)"]
    evening.known.remove("(available robot_2)")
    mission = Evening(lambda: True, lambda line: None, robots=NAMES)
    assert mission._urgent() == ["(already_served table_1)", "(tray_free robot_1)"]
    evening.things["counter"] = ["bar"]
    assert mission._urgent() == []


def test_a_round_in_which_nothing_can_be_looked_at_is_not_begun_anew_at_once(
    evening: FakeRobot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(evening_module, "REST", 600.0)
    evening.results = dict.fromkeys(["(checked table_1)", "(entrance_checked)"], FAILED)
    looked, closed = threading.Event(), threading.Event()
    evening.on_goal = lambda goal: looked.set() if goal == "(entrance_checked)" else None
    reported: List[str] = []
    mission = threading.Thread(target=Evening(closed.is_set, reported.append, robots=NAMES).run)
    mission.start()
    assert looked.wait(LONG)
    closed.set()
    evening.change(add="(checked table_2)")
    mission.join(LONG)
    assert not mission.is_alive()
    assert reported == ["checks all tables", "closed: looks once more at what is not ready"]


def test_what_a_robot_carries_that_is_gone_is_out_of_reach(evening: FakeRobot) -> None:
    evening.known.remove("(available robot_2)")
    evening.known.append("(carrying robot_2 table_1)")
    assert run() == "succeeded"
    assert "(tray_free robot_2)" not in evening.goals


def test_a_table_found_waiting_joins_what_is_served_when_no_robot_is_in_a_conversation(
    evening: FakeRobot,
) -> None:
    evening.known.append("(needs_serving table_1)")
    evening.never = ["(already_served table_1)"]
    plans: List[List[str]] = []
    send = evening.send

    def note(goals: Any, *arguments: Any, **named: Any) -> Any:
        plans.append(list(goals))
        found = evening.goals.count("(already_served table_1)")
        if "(already_served table_2)" in goals:
            evening.never = ()
            evening.change(remove=["(needs_serving table_1)", "(needs_serving table_2)"])
        request = send(goals, *arguments, **named)
        if "(already_served table_1)" in goals and not found:
            evening.change(add="(needs_serving table_2)", remove="(quiet robot_2)")
            assert not any("(already_served table_2)" in plan for plan in plans)
            evening.change(add="(quiet robot_2)")
        return request

    evening.send = note  # type: ignore[method-assign]
    assert run() == "succeeded"
    urgent = [plan[:2] for plan in plans if plan[0].startswith("(already")]
    assert urgent[0][0] == "(already_served table_1)"
    assert urgent[1] == ["(already_served table_1)", "(already_served table_2)"]


def plans_of(evening: FakeRobot, mission: Evening) -> List[List[str]]:
    """The goals of each urgent request of a mission that runs to its end."""
    plans: List[List[str]] = []
    send = evening.send

    def note(goals: Any, priority: int = 0, *arguments: Any, **named: Any) -> Any:
        if priority == AT_ONCE:
            plans.append(list(goals))
        return send(goals, priority, *arguments, **named)

    evening.send = note  # type: ignore[method-assign]
    assert mission.run() == "succeeded"
    return plans


def test_an_order_that_is_waited_for_is_not_brought_back(evening: FakeRobot) -> None:
    evening.known += ["(needs_serving table_1)", "(carrying robot_2 table_1)"]

    def deliver(goal: str) -> None:
        if goal == "(already_served table_1)":
            evening.change(remove=["(needs_serving table_1)", "(carrying robot_2 table_1)"])

    evening.on_goal = deliver
    plans = plans_of(evening, Evening(lambda: True, lambda line: None, robots=NAMES))
    assert plans[0][0] == "(already_served table_1)"
    assert not any("tray" in goal for goal in evening.goals)


def test_only_a_robot_that_has_no_guest_looks_around_and_only_at_a_few_places(
    evening: FakeRobot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(evening_module, "LOOKS", 2)
    mission = Evening(lambda: False, lambda line: None, robots=NAMES)
    evening.known += ["(needs_serving table_1)", "(checked table_1)"]
    served = ["(already_served table_1)"]
    assert mission._all_that_waits(None) == [*served, "(checked table_2)", "(entrance_checked)"]
    evening.known.append("(needs_serving table_2)")
    assert mission._all_that_waits(None) == [*served, "(already_served table_2)"]


def test_a_robot_that_was_stopped_between_two_places_goes_out_of_the_way_but_not_for_ever(
    evening: FakeRobot,
) -> None:
    evening.known = [fact for fact in evening.known if "ready" not in fact]
    evening.known += ["(needs_serving table_1)", "(checked table_2)", "(checked table_1)"]
    evening.known.remove("(in_position robot_2)")
    mission = Evening(lambda: False, lambda line: None, robots=NAMES)
    served = "(already_served table_1)"
    assert mission._all_that_waits(None)[:2] == [served, "(in_position robot_2)"]
    for reason in (
        "(navigate robot_1 bar table_1) failed",
        *["(navigate robot_2 anywhere bar) failed"] * TRIES,
    ):
        assert "(in_position robot_2)" in mission._all_that_waits(None)
        mission._serve.reason = reason
        mission._note_end(None)
        mission._tried.pop("table_1", None)
    assert mission._all_that_waits(None)[:2] == [served, "(entrance_checked)"]


def test_more_guests_than_robots_wait_until_one_is_served(evening: FakeRobot) -> None:
    evening.known = [fact for fact in evening.known if "ready" not in fact]
    evening.known += ["(needs_serving table_1)", "(needs_serving table_2)"]
    evening.things["table"].append("table_3")
    evening.never = ["(already_served table_2)"]
    reported: List[int] = []

    def serve(goal: str) -> None:
        if goal == "(already_served table_2)" and not reported:
            reported.append(len(plans))
            evening.change(add="(needs_serving table_3)")  # all robots have a guest
            evening.change(remove="(needs_serving table_1)")  # one has served
        elif goal == "(already_served table_2)":
            evening.never = ()
        elif goal == "(already_served table_3)":
            evening.change(remove=["(needs_serving table_2)", "(needs_serving table_3)"])

    evening.on_goal = serve
    plans: List[List[str]] = []
    plans += plans_of(evening, Evening(lambda: True, lambda line: None, robots=NAMES))
    assert plans[0] == ["(already_served table_1)", "(already_served table_2)"]
    assert plans[1][:2] == ["(already_served table_2)", "(already_served table_3)"]


def test_a_client_who_was_greeted_is_led_before_the_plan_is_made_anew(evening: FakeRobot) -> None:
    evening.known += ["(waiting client_1)"]
    evening.never = ["(seated client_1)"]

    def greet(goal: str) -> None:
        if goal == "(seated client_1)" and evening.never:
            evening.change(add="(greeted robot_1 client_1)")
            evening.change(add="(needs_serving table_2)")  # news, and no robot is in a conversation
            assert not any("table_2" in goal for goal in evening.goals if "served" in goal)
            evening.never = ()
            evening.change(remove="(waiting client_1)")
        if goal == "(already_served table_2)":
            evening.change(remove="(needs_serving table_2)")

    evening.on_goal = greet
    plans = plans_of(evening, Evening(lambda: True, lambda line: None, robots=NAMES))
    assert plans[0][0] == "(seated client_1)"
    assert plans[1][0] == "(already_served table_2)"


def test_a_client_who_calls_again_is_still_one_client(evening: FakeRobot) -> None:
    evening.known = [fact for fact in evening.known if "ready" not in fact]
    reported: List[str] = []
    mission = Evening(
        lambda: reported.count("a client at the entrance calls") == 2, reported.append, robots=NAMES
    )
    call = ListenResult(text="good evening we would like a table", heard=True)
    evening.servers["calls/listen"].results += [call, call]
    assert mission.run() == "succeeded"
    assert evening.facts("waiting") == ["(waiting client_1)"]


@pytest.mark.parametrize(
    ("call", "goal"),
    [
        ("waiter table two please", "(already_served table_2)"),
        ("good evening we would like a table", "(seated client_1)"),
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
    launch = (ROOT / "launch" / "restaurant.launch").read_text()
    paths = re.findall(r"'(merlin_restaurant\.actions\.\w+:\w+)'", launch)
    classes = {kind.operator_name(): kind for kind in map(load_class, paths)}
    assert set(classes) == set(domain.operators)
    for operator in domain.operators.values():
        variables = [one.label for one in operator.parameters]
        assert classes[operator.name].fitted(variables, "r").parameters == variables
