# SPDX-License-Identifier: Apache-2.0
"""Several robots: names that are agreed, and what a launch file says for all or for each. Without ROS."""

from typing import Any, List, Mapping, Sequence

#: Parameter, beside the planning system: the robots of ``robots:=``; an empty list: one without a name.
ROBOTS = "merlin/robots"
#: Predicate of which the bridges keep the truth: the robot takes actions.
AVAILABLE = "available"
#: Type of the parameter that says which robot runs an action.
ROBOT_TYPE = "robot"


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


def of_robot(name: str, value: Any, robot: str, robots: Sequence[str]) -> Any:
    """The value that counts for one robot.

    :param name: of the parameter, for the error.
    :param value: one for all robots, or a mapping from names of robots to values.
    :param robot: its name; empty: the only one.
    :param robots: the names of all robots.
    :return: None where a mapping does not name the robot.
    :raises ValueError: when a mapping names a robot that there is not.
    """
    if not isinstance(value, dict):
        return value
    if not robots:
        raise ValueError(
            f"{name} names {_listed(value)}, and no robots are named; give robots:=… too, or a list"
        )
    unknown = [each for each in value if each not in robots]
    if unknown:
        raise ValueError(f"{name} names {_listed(unknown)}; the robots of robots:=… are {_listed(robots)}")
    return value.get(robot)


def texts(name: str, value: Any) -> List[str]:
    """A list of texts; yes and no count as texts, though YAML reads them as truth values without quotes.

    :raises ValueError: when it is something else.
    """
    listed = value if isinstance(value, list) else [value]
    found = [("no", "yes")[each] if isinstance(each, bool) else each for each in listed]
    if listed is not value or not all(isinstance(each, str) for each in found):
        raise ValueError(
            f"{name} has to be a list of texts, [yes, no], or such a list for each of several robots, "
            f"{{ria: [yes], tom: [no]}}; it is {value!r}"
        )
    return found


def _listed(names: Any) -> str:
    return ", ".join(map(str, names))
