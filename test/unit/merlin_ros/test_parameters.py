# SPDX-License-Identifier: Apache-2.0
"""Parameters that are not numbers, or of another size, are named with what they may be."""

import pytest
import rospy

from merlin_ros.parameters import ParameterError, choice, flag, graph_name, whole


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


@pytest.mark.parametrize(
    ("value", "name"), [(None, "map"), ("", "map"), ("/robot1/map", "/robot1/map"), ("~map", "~map")]
)
def test_a_name_is_taken(monkeypatch: pytest.MonkeyPatch, value: object, name: str) -> None:
    monkeypatch.setattr(rospy, "get_param", lambda name, default: default if value is None else value)
    assert graph_name("~map_topic", "map") == name


@pytest.mark.parametrize("value", [7, ["map"], True, "the map", "7", {"map": 1}])
def test_what_is_no_name_of_a_topic_is_named(monkeypatch: pytest.MonkeyPatch, value: object) -> None:
    monkeypatch.setattr(rospy, "get_param", lambda name, default: value)
    with pytest.raises(ParameterError) as refused:
        graph_name("~map_topic", "map")
    assert str(refused.value) == f"parameter ~map_topic is {value!r}, not a name of ROS as map"


@pytest.mark.parametrize("value", ["false", 0, []])
def test_what_is_neither_true_nor_false_is_named(monkeypatch: pytest.MonkeyPatch, value: object) -> None:
    monkeypatch.setattr(rospy, "get_param", lambda name, default: value)
    with pytest.raises(ParameterError) as refused:
        flag("~robots")
    assert str(refused.value) == f"parameter ~robots is {value!r}; it has to be true or false"


def test_one_of_some_words_is_taken_the_first_by_default(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rospy, "get_param", lambda name, default: default)
    assert choice("~policy", ("constant", "adaptive")) == "constant"
    monkeypatch.setattr(rospy, "get_param", lambda name, default: "adaptive")
    assert choice("~policy", ("constant", "adaptive")) == "adaptive"


@pytest.mark.parametrize("value", ["sometimes", "", 1, ["constant"], {"constant": 1}])
def test_another_word_is_named_with_those_there_are(monkeypatch: pytest.MonkeyPatch, value: object) -> None:
    monkeypatch.setattr(rospy, "get_param", lambda name, default: value)
    with pytest.raises(ParameterError) as refused:
        choice("~policy", ("constant", "adaptive"))
    assert str(refused.value) == f"parameter ~policy is {value!r}, not one of constant, adaptive"
