# SPDX-License-Identifier: Apache-2.0
"""Parameters that are not numbers, or of another size, are named with what they may be."""

import pytest
import rospy

from merlin_ros.parameters import ParameterError, whole


def read(monkeypatch: pytest.MonkeyPatch, value: object) -> int:
    monkeypatch.setattr(rospy, "get_param", lambda name, default: default if value is None else value)
    return whole("~port", 8080, 0, 65535)


@pytest.mark.parametrize(("value", "number"), [(None, 8080), (0, 0), (65535, 65535), (80.0, 80)])
def test_a_whole_number_is_taken(monkeypatch: pytest.MonkeyPatch, value: object, number: int) -> None:
    assert read(monkeypatch, value) == number


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (65536, "parameter ~port is 65536, not a whole number from 0 to 65535"),
        (-1, "parameter ~port is -1, not a whole number from 0 to 65535"),
        (80.5, "parameter ~port is 80.5, not a whole number from 0 to 65535"),
        ("many", "parameter ~port is 'many', not a number"),
        (True, "parameter ~port is True, not a number"),
        (float("inf"), "parameter ~port is inf, not a number"),
        ([80], r"parameter ~port is \[80\], not a number"),
    ],
)
def test_anything_else_is_named(monkeypatch: pytest.MonkeyPatch, value: object, text: str) -> None:
    with pytest.raises(ParameterError, match=text):
        read(monkeypatch, value)
