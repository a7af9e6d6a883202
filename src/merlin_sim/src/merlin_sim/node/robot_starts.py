# SPDX-License-Identifier: Apache-2.0
"""Where the robots of the simulator begin. Without the simulator: a check of an application asks, too."""

import math
import re
from typing import Any, Iterator, List, Tuple

from merlin_reactive.pose import Pose
from merlin_ros.parameters import ParameterError
from merlin_sim.world.world_model import World
from merlin_sim.world.world_places import ROBOT, ROBOT_RADIUS, why_no_place


def place_robots(robots: Any, world: World) -> List[Tuple[str, Pose]]:
    """The namespace of each robot, and where it begins: its own pose, or the next of the world's starts.

    :param robots: namespaces, or maps with namespace, x, y and yaw.
    :raises ParameterError: when a robot cannot be placed.
    """
    if not isinstance(robots, list) or not robots:
        raise ParameterError(f"parameter ~robots is {robots!r}, not a list of namespaces or of maps")
    starts = iter(world.starts)
    placed = [_placed(item, starts, world) for item in robots]
    for index, (name, start) in enumerate(placed):
        reason = why_no_place(world, start.point)
        for other, its_start in placed[:index]:
            if start.distance(its_start) < 2 * ROBOT_RADIUS:
                reason = f"({start.x:g}, {start.y:g}) is taken by robot {other!r}"
        if reason:
            raise ParameterError(f"parameter ~robots: robot {name!r} cannot start there: {reason}")
    names = [name for name, _ in placed]
    if len({name or ROBOT for name in names}) != len(names):
        raise ParameterError(f"parameter ~robots names a namespace twice: {names}")
    return placed


def _placed(item: Any, starts: Iterator[Pose], world: World) -> Tuple[str, Pose]:
    fields = item if isinstance(item, dict) else {"namespace": item}
    name = fields.get("namespace", "")
    if not isinstance(name, str) or not re.match(r"^([A-Za-z][A-Za-z0-9_]*)?$", name.strip("/")):
        raise ParameterError(f"parameter ~robots: {name!r} is not a namespace")
    unknown = set(fields) - {"namespace", "x", "y", "yaw"}
    if unknown:
        raise ParameterError(f"parameter ~robots: unknown field {sorted(unknown)[0]} of robot {name!r}")
    if "x" in fields or "y" in fields:
        try:
            pose = Pose(float(fields["x"]), float(fields["y"]), float(fields.get("yaw", 0.0)))
            if not all(map(math.isfinite, (pose.x, pose.y, pose.yaw))):
                raise ValueError(f"{pose} is not finite")
            return name.strip("/"), pose
        except (KeyError, TypeError, ValueError) as error:
            raise ParameterError(
                f"parameter ~robots: robot {name!r} needs numbers x and y (and yaw): {error}"
            ) from error
    if "yaw" in fields:
        raise ParameterError(f"parameter ~robots: robot {name!r} has a yaw, but no x and y")
    start = next(starts, None)
    if start is None:
        raise ParameterError(
            f"parameter ~robots: no start left for robot {name!r}; world {world.name} has {len(world.starts)}"
        )
    return name.strip("/"), start
