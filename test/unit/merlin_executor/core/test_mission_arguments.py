# SPDX-License-Identifier: Apache-2.0
"""A mission's constructor gets what its node's parameters say, or one sentence says what is wrong."""

import sys
from pathlib import Path
from typing import Any, Dict, List, Optional

import pytest

from merlin_executor.core.mission_arguments import ArgumentError, arguments_of


class Mission:
    def __init__(
        self,
        text: str,
        many: List[str],
        share: Optional[float] = None,
        rounds: int = 1,
        slow: bool = False,
        folder: Path = Path(),
        any_: Any = 0,
        **more: Any,
    ) -> None:
        pass


GIVEN: Dict[str, Any] = {"text": "kitchen", "many": ["a"]}


def arguments(**given: Any) -> Dict[str, Any]:
    return arguments_of(Mission, {**GIVEN, **given}.get)


def test_what_is_not_given_has_its_default() -> None:
    assert arguments() == GIVEN


@pytest.mark.parametrize(
    ("name", "value", "argument"),
    [
        ("text", 3, "3"),
        ("share", 1, 1.0),
        ("rounds", 2.0, 2),
        ("slow", True, True),
        ("folder", "results", Path("results")),
        ("any_", {"x": 1}, {"x": 1}),
    ],
)
def test_values_are_converted_to_their_annotations(name: str, value: Any, argument: Any) -> None:
    found = arguments(**{name: value})[name]
    assert found == argument and type(found) is type(argument)


@pytest.mark.parametrize(
    ("name", "value", "what"),
    [
        ("text", ["a"], "not a text"),
        ("text", True, "not a text"),
        ("many", "a", "not a list"),
        ("share", float("inf"), "not a number"),
        ("share", "1", "not a number"),
        ("rounds", 1.5, "not a whole number"),
        ("slow", 1, "not true or false"),
        ("folder", False, "not a path"),
    ],
)
def test_a_value_that_does_not_fit_is_named(name: str, value: Any, what: str) -> None:
    with pytest.raises(ArgumentError) as refused:
        arguments(**{name: value})
    assert str(refused.value) == f"parameter ~{name} is {value!r}, {what}"


@pytest.mark.skipif(sys.version_info < (3, 10), reason="Python has no X | None")
def test_an_annotation_may_say_none_in_either_way() -> None:
    def make(self: Any, text: "str | None" = None, rounds: "None | int" = None) -> None:
        pass

    newer = type("Newer", (), {"__init__": make})
    assert arguments_of(newer, {"text": 3, "rounds": 2.0}.get) == {"text": "3", "rounds": 2}
    with pytest.raises(ArgumentError, match="~rounds is 'two', not a whole number"):
        arguments_of(newer, {"rounds": "two"}.get)


def test_an_argument_without_default_has_to_be_given() -> None:
    with pytest.raises(ArgumentError, match="parameter ~many is missing; Mission has no default for it"):
        arguments_of(Mission, {"text": "a"}.get)


def test_parameters_that_the_constructor_does_not_name_are_left_alone() -> None:
    assert "more" not in arguments(more={"x": 1}, other=2)
