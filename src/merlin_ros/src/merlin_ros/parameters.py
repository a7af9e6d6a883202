# SPDX-License-Identifier: Apache-2.0
"""Parameters of nodes, checked when they are read."""

import math
from typing import Any, Sequence

import rospy
from rosgraph.names import is_legal_name


class ParameterError(Exception):
    """A parameter that cannot be used; the text names it and says what is wrong."""


def number(name: str, default: float, least: float) -> float:
    """A finite number from a parameter, at least `least`.

    :raises ParameterError: when it is something else.
    """
    value = rospy.get_param(name, default)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise ParameterError(f"parameter {name} is {value!r}, not a number")
    if value < least:
        raise ParameterError(f"parameter {name} is {value:g}, less than {least:g}")
    return float(value)


def whole(name: str, default: int, least: int = -(2**31) + 1, most: int = 2**31 - 1) -> int:
    """A whole number from a parameter.

    :raises ParameterError: when it is something else, less than `least` or more than `most`.
    """
    value = number(name, default, -math.inf)
    if value != round(value) or not least <= value <= most:
        raise ParameterError(f"parameter {name} is {value:.12g}, not a whole number from {least} to {most}")
    return round(value)


def is_name(value: Any) -> bool:
    """Whether a value is a legal name of ROS, of a topic, service, action or node."""
    return isinstance(value, str) and bool(value) and bool(is_legal_name(value))


def graph_name(name: str, default: str = "") -> str:
    """The name of a topic, service or node from a parameter, not resolved; an empty one is the default.

    :raises ParameterError: when it is not a legal name of ROS.
    """
    value = rospy.get_param(name, default)
    if value != "" and not is_name(value):
        raise ParameterError(f"parameter {name} is {value!r}, not a name of ROS as {default or 'topic'}")
    return str(value or default)


def flag(name: str, default: bool = False) -> bool:
    """True or false from a parameter.

    :raises ParameterError: when it is something else; a text as `false` would count as true.
    """
    value = rospy.get_param(name, default)
    if not isinstance(value, bool):
        raise ParameterError(f"parameter {name} is {value!r}; it has to be true or false")
    return value


def choice(name: str, choices: Sequence[str]) -> str:
    """One of some words from a parameter; the first one is the default.

    :raises ParameterError: when it is something else.
    """
    value = rospy.get_param(name, choices[0])
    if value not in choices:
        raise ParameterError(f"parameter {name} is {value!r}, not one of {', '.join(choices)}")
    return str(value)
