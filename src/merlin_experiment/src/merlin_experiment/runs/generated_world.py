"""Generated worlds of the experiment, each with the planning problem that belongs to it."""

from pathlib import Path
from typing import NamedTuple

from merlin_sim.world.floor_plan import FloorPlan, write_plan
from merlin_sim.world.poi_distances import pddl_values
from merlin_sim.world.world_file import load_world

ROOMS = 4
"""One point of interest each: as many as the apartment has."""
WIDTH, HEIGHT = 12.0, 9.0
"""Size of the floor, m: the ways are about as long as those of the apartment."""
PIECES = 3
"""Pieces of furniture per room at most."""
SPEED = 0.30
"""Cruising speed of the robot, m/s."""
TURNING = 3.0
"""Time for the turns of a drive, s, as in the problem of the apartment."""


class WorldFiles(NamedTuple):
    """Paths of a generated world: its world file (YAML) and its PDDL problem."""

    world: Path
    problem: Path


def write_world(folder: Path, seed: int) -> WorldFiles:
    """Generates a world and measures the durations of its drives; the same seed gives the same files.

    Parameters:
        folder: an existing one.
        seed: of the floor plan.

    Raises:
        OSError: a file cannot be written.
        NoPath: two points of interest are not connected.
    """
    files = WorldFiles(folder / f"world_{seed}.yaml", folder / f"world_{seed}.pddl")
    plan = FloorPlan(ROOMS, WIDTH, HEIGHT, seed)
    plan.furnish(PIECES)
    write_plan(plan, files.world)
    files.problem.write_text(_problem(files.world), encoding="utf-8")
    return files


def _problem(world_file: Path) -> str:
    world = load_world(world_file)
    values = pddl_values(world, "travel_time", "anywhere", SPEED, TURNING)
    lines = "\n".join(f"    {line}" for line in values)
    return f"""; Times in s: the shortest path at {SPEED:g} m/s, and {TURNING:g} s for turning.
(define (problem {world.name})
  (:domain home)
  (:objects
    {" ".join(world.points_of_interest)} - poi)
  (:init
    (in_service)
    (robot_at anywhere)
{lines})
  (:goal (in_service))
  (:metric minimize (total-time)))
"""
