# SPDX-License-Identifier: Apache-2.0
"""How far the points of interest of a world are from each other, as values of a PDDL problem."""

import argparse
import itertools
import math
import sys
from typing import Dict, List, Optional, Tuple

from merlin_reactive.navigation.path_planner import NoPath, PathPlanner
from merlin_sim.world.survey import map_of
from merlin_sim.world.world_file import WorldError, find_world, load_world
from merlin_sim.world.world_model import World
from merlin_sim.world.world_places import CLEARANCE, ROBOT_RADIUS


def poi_distances(world: World) -> Dict[Tuple[str, str], float]:
    """Length of the shortest safe path between each two points of interest, m.

    :raises NoPath: two of them are not connected.
    """
    planner = PathPlanner(map_of(world), ROBOT_RADIUS, CLEARANCE)
    found = {}
    for (first, start), (second, end) in itertools.combinations(world.points_of_interest.items(), 2):
        path = planner.plan(start.point, end.point)
        found[first, second] = found[second, first] = sum(math.dist(a, b) for a, b in zip(path, path[1:]))
    return found


def pddl_values(
    world: World, function: str, also: str = "", speed: float = 0.0, turning: float = 0.0
) -> List[str]:
    """The distances between points of interest, or the times of the drives, as values of a PDDL problem.

    :param function: of the domain; its arguments are the two points.
    :param also: a further start, at the mean distance of all points; empty: none.
    :param speed: m/s; 0: the values are distances in m, otherwise times in s.
    :param turning: s for the turns of each drive.
    :raises NoPath: when two points are not connected.
    """
    found = poi_distances(world)

    def value(length: float) -> str:
        return f"{length / speed + turning if speed else length:.1f}"

    lines = []
    for name in world.points_of_interest if also else ():
        lengths = [length for (_, end), length in found.items() if end == name]
        lines.append(f"(= ({function} {also} {name}) {value(sum(lengths) / len(lengths))})")
    lines += [
        f"(= ({function} {start} {end}) {value(length)})" for (start, end), length in sorted(found.items())
    ]
    return lines


def main(arguments: Optional[List[str]] = None) -> int:
    """The command ``poi_distances``; returns its exit code."""
    parser = argparse.ArgumentParser(
        prog="poi_distances",
        description="Prints the distances between points of interest for a PDDL problem, or their times.",
    )
    parser.add_argument("world", help="world file (YAML), or the name of one that comes with merlin_sim")
    parser.add_argument("--function", default="distance", help="of the domain (default: distance)")
    parser.add_argument("--from", dest="also", default="", help="a further place, at the mean distance")
    parser.add_argument("--without", nargs="*", default=[], help="points that the problem does not need")
    parser.add_argument("--speed", type=float, default=0.0, help="m/s: prints times in s, not distances in m")
    parser.add_argument("--turning", type=float, default=0.0, help="s for the turns of each drive")
    options = parser.parse_args(arguments)
    numbers = all(0.0 <= number < math.inf for number in (options.speed, options.turning))
    if not numbers or (options.turning and not options.speed):
        parser.error("--speed and --turning are positive, and --turning needs --speed")
    try:
        world = load_world(find_world(options.world))
        for name in options.without:
            if world.points_of_interest.pop(name, None) is None:
                raise WorldError(f"--without: world {world.name} has no point of interest {name!r}")
        if len(world.points_of_interest) < 2:
            raise WorldError(f"world {world.name}: there are no two points of interest left")
        lines = pddl_values(world, options.function, options.also, options.speed, options.turning)
    except (WorldError, NoPath, OSError) as error:
        print(f"poi_distances: {error}", file=sys.stderr)
        return 1
    print("\n".join(lines))
    return 0
