# SPDX-License-Identifier: Apache-2.0
"""The constructor arguments of a mission, from the private parameters of its node. Without ROS."""

import inspect
import math
from pathlib import Path
from typing import Any, Callable, Dict, Type, get_args, get_origin, get_type_hints


class ArgumentError(ValueError):
    """A parameter that a mission cannot begin with; the text names it and says what is wrong."""


def arguments_of(mission_class: Type[Any], value_of: Callable[[str], Any]) -> Dict[str, Any]:
    """The arguments for the constructor of a class, one per private parameter that is set.

    An annotation of str, int, float, bool, list or Path is checked; another one accepts any value.

    :param value_of: name of a parameter → its value; None when it is not set.
    :raises ArgumentError: when an argument has neither a default nor a parameter, or has a wrong type.
    """
    hints = get_type_hints(mission_class.__init__)
    found: Dict[str, Any] = {}
    for name, argument in inspect.signature(mission_class).parameters.items():
        if argument.kind in (argument.VAR_POSITIONAL, argument.VAR_KEYWORD):
            continue
        value = value_of(name)
        if value is not None:
            found[name] = converted(name, value, hints.get(name))
        elif argument.default is argument.empty:
            raise ArgumentError(
                f"parameter ~{name} is missing; {mission_class.__name__} has no default for it"
            )
    return found


def converted(name: str, value: Any, kind: Any) -> Any:
    """A value of the parameter server as an argument.

    A number is accepted as a text: a launch file turns the text ``3`` into a number.

    :param kind: the annotation of the argument.
    :raises ArgumentError: when the value does not fit.
    """
    kinds = [each for each in get_args(kind) if each is not type(None)]
    if len(kinds) == 1 < len(get_args(kind)):  # Optional[X], or X | None
        kind = kinds[0]
    kind = get_origin(kind) or kind  # List[str] → list
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
    if kind in (str, Path) and (is_number or isinstance(value, str)):
        return kind(str(value))
    if kind is float and is_number:
        return float(value)
    if kind is int and is_number and value == int(value):
        return int(value)
    if kind not in _WORDS or (kind in (bool, list) and isinstance(value, kind)):
        return value
    raise ArgumentError(f"parameter ~{name} is {value!r}, not {_WORDS[kind]}")


_WORDS = {
    str: "a text",
    Path: "a path",
    float: "a number",
    int: "a whole number",
    bool: "true or false",
    list: "a list",
}
