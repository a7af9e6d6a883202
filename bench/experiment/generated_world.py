# SPDX-License-Identifier: Apache-2.0
"""Generated worlds of the experiment, each with the planning problem that belongs to it."""

from pathlib import Path
from typing import NamedTuple

from merlin_sim.world.floor_plan import FloorPlan, write_plan
from merlin_sim.world.poi_distances import pddl_values
from merlin_sim.world.world_file import load_world

#: One point of interest each: as many as the apartment has.
ROOMS = 4
#: Size of the floor, m: the ways are about as long as those of the apartment.
WIDTH, HEIGHT = 12.0, 9.0
#: Pieces of furniture per room at most.
PIECES = 3
#: Cruising speed of the robot, m/s.
SPEED = 0.30
#: Time for the turns of a drive, s, as in the problem of the apartment.
TURNING = 3.0


class WorldFiles(NamedTuple):
    """Paths of a generated world: its world file (YAML) and its PDDL problem."""

    world: Path
    problem: Path


def write_world(folder: Path, seed: int) -> WorldFiles:
    """Generates a world and measures the durations of its drives; the same seed gives the same files.

    :param folder: an existing one.
    :param seed: of the floor plan.
    :raises OSError: a file cannot be written.
    :raises NoPath: two points of interest are not connected.
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
