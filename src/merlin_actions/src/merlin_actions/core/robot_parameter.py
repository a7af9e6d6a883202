# SPDX-License-Identifier: Apache-2.0
"""Which parameter of an operator names the robot that runs it."""

import re
from typing import Mapping, Sequence, Tuple

from merlin_ros.robot_values import is_robot

Parameters = Sequence[Tuple[str, str]]  # variable without '?', type

_FACT = re.compile(r"\(\s*([A-Za-z][\w-]*)((?:\s+[^\s()]+)*)\s*\)")


def robot_parameter(
    operator: str, parameters: Parameters, parents: Mapping[str, str], declared: str = ""
) -> str:
    """The variable that names the robot; empty: the operator needs none.

    :param parameters: variable without ``?``, and type.
    :param parents: type -> its parent.
    :param declared: ``robot_parameter`` of the action's class; empty: the type says it.
    :raises ValueError: when it is not clear.
    """
    variables = [variable for variable, _ in parameters]
    if declared:
        if declared not in variables:
            raise ValueError(
                f"robot_parameter is {declared!r}, but operator {operator} has the parameters {variables}"
            )
        return declared
    robots = [variable for variable, kind in parameters if is_robot(kind, parents)]
    if len(robots) > 1:
        names = " and ".join("?" + name for name in robots)
        raise ValueError(
            f"operator {operator} has the robots {names}; say with robot_parameter which one runs it"
        )
    return robots[0] if robots else ""


def with_robot(text: str, variable: str, facts: Mapping[str, Parameters], parents: Mapping[str, str]) -> str:
    """A literal or numeric effect that was written for one robot, for one of several.

    Where a predicate or function has one parameter more than is written, and just one that is a robot, the
    robot is put there: ``(robot_at anywhere)`` becomes ``(robot_at ?r anywhere)``.

    :param variable: that names the robot, without ``?``.
    :param facts: predicates and functions of the domain → their parameters.
    :param parents: type -> its parent.
    """

    def put(match: "re.Match[str]") -> str:
        name, arguments = match[1], match[2].split()
        kinds = [kind for _, kind in facts.get(name.lower(), ())]
        robots = [place for place, kind in enumerate(kinds) if is_robot(kind, parents)]
        if len(robots) != 1 or len(kinds) != len(arguments) + 1:
            return match[0]
        arguments.insert(robots[0], f"?{variable}")
        return f"({' '.join([name, *arguments])})"

    return _FACT.sub(put, text)
