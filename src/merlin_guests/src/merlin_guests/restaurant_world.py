# SPDX-License-Identifier: Apache-2.0
"""The world file of a restaurant that the players know their way about."""

from typing import List

from merlin_guests.barman import NAME as BARMAN
from merlin_guests.guest import CHAIR_NAME
from merlin_guests.house import BAR
from merlin_guests.places import ENTRANCE_DOOR
from merlin_guests.schedule import TABLES
from merlin_sim.world.world_file import WorldError, find_world, load_world
from merlin_sim.world.world_model import World


def restaurant_world(name: str) -> World:
    """Loads a world in which a restaurant can be played.

    :param name: a world file, or the name of one of merlin_sim.
    :raises WorldError: when it cannot be read, or lacks what the players use.
    """
    path = find_world(name)
    world = load_world(path)
    missing = _missing(world)
    if missing:
        raise WorldError(f"{path} is not a restaurant: it has no {', no '.join(missing)}")
    return world


def _missing(world: World) -> List[str]:
    furniture = [solid.name for solid in (*world.furniture, *world.unmapped)]
    needed = (
        ("door", [ENTRANCE_DOOR], [door.name for door in world.doors]),
        ("piece of furniture", [BAR, *TABLES, CHAIR_NAME], furniture),
        ("person", [BARMAN], [person.name for person in world.people]),
        ("point of interest", ["entrance", "bar", *TABLES], world.points_of_interest),
    )
    return [f"{what} {name!r}" for what, names, there in needed for name in names if name not in there]
