# SPDX-License-Identifier: Apache-2.0
"""Knowledge items as PDDL text. Items are read by their fields, so any message with them will do."""

from typing import Any, List, Mapping

from merlin_monitor.text.plain_value import plain_text
from merlin_planning.knowledge_text import to_pddl

INSTANCE, FACT, FUNCTION, EXPRESSION, INEQUALITY = range(5)


def atom_text(name: str, arguments: List[str]) -> str:
    """``(robot_at kitchen)``."""
    return plain_text(f"({' '.join([name, *arguments])})")


def item_text(item: Any) -> str:
    """The text that names an item: of an object its name, of a function value the function."""
    if item.knowledge_type == INSTANCE:
        return plain_text(item.instance_name)
    if item.knowledge_type in (EXPRESSION, INEQUALITY):
        try:
            return plain_text(to_pddl(item))
        except (KeyError, ValueError, RecursionError) as error:
            return f"<an expression that cannot be read: {type(error).__name__}>"
    text = atom_text(item.attribute_name, [value.value for value in item.values])
    return f"(not {text})" if item.is_negative else text


def number_text(value: float) -> str:
    """A number without a tail of zeros."""
    return f"{value:.6g}"


def action_text(action: Mapping[str, Any]) -> str:
    """An action in PDDL.

    :param action: its name and parameters, pairs of label and object, as the state has them.
    """
    return atom_text(action["name"], [value for _, value in action["parameters"]])
