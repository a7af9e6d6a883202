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
    if options.speed < 0 or options.turning < 0 or (options.turning and not options.speed):
        parser.error("--speed and --turning are positive, and --turning needs --speed")
    try:
        world = load_world(find_world(options.world))
        for name in options.without:
            if world.points_of_interest.pop(name, None) is None:
                raise WorldError(f"--without: world {world.name} has no point of interest {name!r}")
        if len(world.points_of_interest) < 2:
            raise WorldError(f"world {world.name}: there are no two points of interest left")
        found = poi_distances(world)
    except (WorldError, NoPath, OSError) as error:
        print(f"poi_distances: {error}", file=sys.stderr)
        return 1

    def value(length: float) -> str:
        return f"{length / options.speed + options.turning if options.speed else length:.1f}"

    for name in world.points_of_interest if options.also else ():
        lengths = [length for (_, end), length in found.items() if end == name]
        print(f"(= ({options.function} {options.also} {name}) {value(sum(lengths) / len(lengths))})")
    for (start, end), length in sorted(found.items()):
        print(f"(= ({options.function} {start} {end}) {value(length)})")
    return 0
