"""Which parameter of an operator names the robot that runs it."""

from typing import Mapping, Sequence, Tuple

#: Type of the robots of a domain.
ROBOT_TYPE = "robot"


def robot_parameter(
    operator: str, parameters: Sequence[Tuple[str, str]], parents: Mapping[str, str], declared: str = ""
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


def is_robot(kind: str, parents: Mapping[str, str]) -> bool:
    """Whether a type is ``robot`` or below it."""
    above = {name.lower(): parent.lower() for name, parent in parents.items()}
    kind, seen = kind.lower(), set()
    while kind and kind not in seen:
        if kind == ROBOT_TYPE:
            return True
        seen.add(kind)
        kind = above.get(kind, "")
    return False
