# SPDX-License-Identifier: Apache-2.0
"""Names of actions: PDDL operators, ROS names, class names."""

import re
from typing import Dict, Iterable

#: What the class of an action declares for its bridge: attributes of the class, and parameters of its action.
WHILE_RUNNING, IF_INTERRUPTED, IF_STOPPED_AT = DECLARED = ("while_running", "if_interrupted", "if_stopped_at")
#: In `if_stopped_at`: the point of interest at which the robot stands.
HERE = "?here"
#: Likewise: how many of it run at once.
CONCURRENT = "concurrent"


def ros_name(operator: str) -> str:
    """The name below ``actions/`` of a PDDL operator: ``check-table`` is not a legal ROS name."""
    return operator.lower().replace("-", "_")


def by_ros_name(operators: Iterable[str]) -> Dict[str, str]:
    """ROS name → operator.

    :raises ValueError: when two operators get the same ROS name.
    """
    names: Dict[str, str] = {}
    for operator in operators:
        name = ros_name(operator)
        if name in names:
            raise ValueError(
                f"the operators {names[name]!r} and {operator!r} both map to actions/{name}; rename one"
            )
        names[name] = operator
    return names


def snake_case(class_name: str) -> str:
    """``OrderToBarman`` → ``order_to_barman``."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", class_name).lower()


def action_param(operator: str) -> str:
    """Relative name of the parameters in which the host of an action declares something to its bridge."""
    return f"actions/{ros_name(operator)}"
