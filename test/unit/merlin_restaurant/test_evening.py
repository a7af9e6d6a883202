# SPDX-License-Identifier: Apache-2.0
"""What the mission decides from what is known: its whole machine runs, over a robot without ROS."""

from typing import List

import pytest
from fake_robot import FakeRobot
from merlin_msgs.msg import ExecuteResult, ListenResult

from merlin_restaurant.evening import CLOSING_ROUNDS, URGENT, Evening

FAILED = ExecuteResult(outcome=ExecuteResult.ACTION_FAILED, reason="the way is blocked")


class Shift:
    """An evening in a restaurant of two tables, and what the mission says."""

    def __init__(self, robot: FakeRobot) -> None:
        self.robot = robot
        self.lines: List[str] = []
        self.closed = True
        self.mission = Evening(lambda: self.closed, self.lines.append)
        robot.things = {"table": ["table_1", "table_2"]}
        robot.known = ["(quiet)", "(ready table_1)", "(ready table_2)"]

    def call(self, text: str) -> None:
        """A guest calls: the first thing that the mission hears."""
        self.robot.servers["calls/listen"].results.append(ListenResult(text=text, heard=True))


@pytest.fixture()
def shift(robot: FakeRobot) -> Shift:
    return Shift(robot)


def test_when_all_is_known_a_closed_restaurant_needs_one_look_at_the_entrance(shift: Shift) -> None:
    shift.robot.known.remove("(ready table_2)")
    assert shift.mission.run() == "succeeded"
    assert shift.robot.sent == [("(checked table_2)", 0), ("(entrance_checked)", 0)]
    assert shift.lines == ["closed: looks once more at what is not ready"]


def test_the_evening_goes_on_until_the_restaurant_has_closed(shift: Shift) -> None:
    shift.closed = False

    def close(goal: str) -> None:
        shift.closed = shift.robot.goals.count("(entrance_checked)") == 2

    shift.robot.on_goal = close
    assert shift.mission.run() == "succeeded"
    one_round = ["(checked table_1)", "(checked table_2)", "(entrance_checked)"]
    assert shift.robot.goals == [*one_round, *one_round, "(entrance_checked)"]


def test_a_table_that_can_never_be_looked_at_does_not_keep_the_robot_for_ever(shift: Shift) -> None:
    shift.robot.known.remove("(ready table_2)")
    shift.robot.results["(checked table_2)"] = FAILED
    assert shift.mission.run() == "succeeded"
    assert shift.robot.goals.count("(checked table_2)") == CLOSING_ROUNDS
    assert shift.lines.count("looks again, because not all is known: (checked table_2)") == CLOSING_ROUNDS - 1


def test_each_table_that_waits_is_served_once_in_a_round_and_the_tray_is_tidied(shift: Shift) -> None:
    shift.robot.known += ["(needs_serving table_1)", "(needs_serving table_2)", "(carrying table_1)"]
    shift.robot.results["(already_served table_1)"] = FAILED
    shift.robot.on_goal = lambda goal: shift.robot.change(
        remove="(carrying table_1)" if goal == "(tray_free)" else ()
    )
    shift.mission.run()
    served = [
        ("(already_served table_1)", URGENT),
        ("(already_served table_2)", URGENT),
        ("(tray_free)", URGENT),
    ]
    assert shift.robot.sent == [*served, ("(entrance_checked)", 0)]


def test_a_client_is_guided_unless_no_table_is_free(shift: Shift) -> None:
    shift.robot.known.append("(waiting client_1)")
    shift.mission.run()
    assert shift.robot.sent[-1] == ("(seated client_1)", URGENT)


def test_a_client_waits_while_no_table_is_free(shift: Shift) -> None:
    shift.robot.known = ["(quiet)", "(waiting client_1)"]
    shift.mission.run()
    assert "(seated client_1)" not in shift.robot.goals
    assert "client_1 has to wait: no table is known to be free" in shift.lines


@pytest.mark.parametrize(
    ("call", "goal"),
    [
        ("waiter table two please", "(already_served table_2)"),
        ("good evening we would like a table", "(entrance_checked)"),
    ],
)
def test_a_call_is_an_urgent_goal_beside_the_rounds(shift: Shift, call: str, goal: str) -> None:
    shift.closed = False

    def close(sent: str) -> None:
        shift.closed = shift.closed or (goal, URGENT) in shift.robot.sent

    shift.robot.on_goal = close
    shift.call(call)
    assert shift.mission.run() == "succeeded"
    assert (goal, URGENT) in shift.robot.sent
    assert ("(needs_serving table_2)" in shift.robot.known) == ("two" in call)


def test_a_call_during_a_conversation_is_a_part_of_it(shift: Shift) -> None:
    shift.robot.known.remove("(quiet)")
    shift.closed = False
    ignored = "takes that for a part of the conversation that it is in"

    def close(sent: str) -> None:
        shift.closed = ignored in shift.lines

    shift.robot.on_goal = close
    shift.call("waiter table two please")
    shift.mission.run()
    assert "(already_served table_2)" not in shift.robot.goals
