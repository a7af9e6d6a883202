# SPDX-License-Identifier: Apache-2.0
"""What each robot of an evening did, from its actions and its odometry."""

import csv
import math
from pathlib import Path

import pytest
from nav_msgs.msg import Odometry

from merlin_executor.core.robot_lines import Deed
from merlin_restaurant.robots_account import COLUMNS, Mileage, robot_rows, robot_table, write_rows

ROBOTS = ["robot_1", "robot_2"]
DEEDS = [
    Deed("(navigate robot_1 bar table_1)", 0.0, 10.0, ""),
    Deed("(check_table robot_2 table_2)", 2.0, 6.0, ""),
    Deed("(deliver_order robot_1 table_1)", 12.0, 20.0, ""),
    Deed("(take_order robot_2 table_2)", 6.0, 9.0, "cancelled"),
]


def at(x: float) -> Odometry:
    message = Odometry()
    message.pose.pose.position.x = x
    return message


def test_a_place_that_is_no_number_is_not_driven_to() -> None:
    mileage = Mileage()
    for place in (math.nan, 0.0, 1.0, math.nan, 3.0):
        mileage.move(at(place), "robot_1")
    assert mileage.of("robot_1") == 3.0


def test_each_robot_has_a_row_of_its_own(tmp_path: Path) -> None:
    mileage = Mileage()
    for robot, places in (("robot_1", (0.0, 1.0, 3.0)), ("robot_2", (5.0, 5.01, 5.02, 5.01))):
        for place in places:
            mileage.move(at(place), robot)
    rows = robot_rows(DEEDS, ROBOTS, mileage)
    assert [(row["robot"], row["delivered"], row["orders"], row["tables_checked"]) for row in rows] == [
        ("robot_1", 1, 0, 0),
        ("robot_2", 0, 0, 1),
    ]
    assert [(row["actions"], row["failed"], row["busy_s"]) for row in rows] == [(2, 0, 18.0), (2, 1, 7.0)]
    assert [row["driven_m"] for row in rows] == [3.0, 0.0], "a robot that stands drives nothing"
    write_rows(tmp_path / "robots.csv", COLUMNS, rows)
    with (tmp_path / "robots.csv").open() as file:
        assert [row["driven_m"] for row in csv.DictReader(file)] == ["3.0", "0.0"]
    assert robot_table(rows)[1].split()[:3] == ["robot_1", "0", "1"]


@pytest.mark.parametrize("text", ["(navigate bar table_1)", "(check_entrance)"])
def test_the_only_robot_has_all_actions(text: str) -> None:
    (row,) = robot_rows([Deed(text, 0.0, 4.0, "")], [""], Mileage())
    assert (row["robot"], row["actions"], row["busy_s"]) == ("robot", 1, 4.0)


def test_time_that_actions_share_counts_once() -> None:
    deeds = [Deed("(check_entrance)", 0.0, 4.0, ""), Deed("(check_table table_1)", 2.0, 5.0, "")]
    (row,) = robot_rows(deeds, [""], Mileage())
    assert row["busy_s"] == 5.0
