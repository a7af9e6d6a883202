# SPDX-License-Identifier: Apache-2.0
"""What a launch file says for all robots, or for each."""

from typing import Any

import pytest

from merlin_ros.robot_values import of_robot, texts

ROBOTS = ["ria", "tom"]


def test_one_value_is_that_of_all_robots_and_a_mapping_has_one_for_each() -> None:
    assert of_robot("answers", ["yes"], "ria", ROBOTS) == ["yes"]
    assert of_robot("answers", ["yes"], "", []) == ["yes"]
    assert of_robot("answers", {"ria": ["yes"]}, "ria", ROBOTS) == ["yes"]
    assert of_robot("answers", {"ria": ["yes"]}, "tom", ROBOTS) is None


@pytest.mark.parametrize(
    ("robots", "said"),
    [
        (ROBOTS, "sees names tim; the robots of robots:=… are ria, tom"),
        ([], "sees names ria, tim, and no robots are named; give robots:=… too, or a list"),
    ],
)
def test_a_mapping_that_names_another_robot_is_refused(robots: Any, said: str) -> None:
    with pytest.raises(ValueError) as error:
        of_robot("sees", {"ria": [], "tim": []}, "ria", robots)
    assert str(error.value) == said


def test_what_yaml_takes_for_truth_values_are_words() -> None:
    assert texts("answers", ["", True, False, "maybe"]) == ["", "yes", "no", "maybe"]


@pytest.mark.parametrize("value", ["yes", True, None, [1], {"ria": ["yes"]}])
def test_another_shape_is_refused_with_the_right_one(value: Any) -> None:
    with pytest.raises(
        ValueError, match=r"answers has to be a list of texts, \[yes, no\], or such a list for each"
    ):
        texts("answers", value)
