# SPDX-License-Identifier: Apache-2.0
"""Parameters of nodes, checked when they are read."""

import math

import rospy


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
