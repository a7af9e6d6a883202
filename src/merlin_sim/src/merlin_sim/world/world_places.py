# SPDX-License-Identifier: Apache-2.0
"""Where in a world something can stand at first."""

from typing import Optional

from merlin_reactive.pose import Point
from merlin_sim.world.world_model import World

ROBOT = "robot"  # what a robot without a namespace is called
ROBOT_RADIUS = 0.25  # m, as in urdf/rb1.urdf
CLEARANCE = 0.05  # m that a plan keeps from what the map shows
OVERLAP = 0.01  # m that a robot may reach into something: physics pushes it out without a jump


def why_no_place(
    world: World, point: Point, radius: float = ROBOT_RADIUS, mapped: bool = False
) -> Optional[str]:
    """Why nothing round of a radius (m) can be at a point when the world begins; None: it can.

    :param mapped: only what the map shows counts; the rest may be moved.
    """
    x, y = point
    left, bottom, right, top = world.bounds()
    if not (left < x < right and bottom < y < top):
        return f"({x:g}, {y:g}) lies outside the walls"
    thickness, height = world.wall_thickness, world.wall_height
    solids = list(world.furniture)
    if not mapped:
        solids += world.unmapped
        solids += [door.leaf(thickness, height) for door in world.doors if not door.open]
    for solid in solids:
        if solid.distance(point) < radius - OVERLAP:
            return f"({x:g}, {y:g}) is taken by {solid.name}"
    if any(wall.distance(point) < radius - OVERLAP for wall in world.wall_solids()):
        return f"({x:g}, {y:g}) is in a wall"
    return None
