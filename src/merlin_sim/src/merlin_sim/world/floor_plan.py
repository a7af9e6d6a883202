# SPDX-License-Identifier: Apache-2.0
"""Generates random floor plans: rooms, doors, furniture, a point of interest in each room."""

import argparse
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Dict, List, Optional, Set, Tuple

import numpy as np
import yaml
from scipy.ndimage import label

from merlin_reactive.navigation.path_planner import PathPlanner
from merlin_reactive.occupancy_grid import OccupancyGrid
from merlin_reactive.pose import Pose
from merlin_reactive.seeded_random import draw
from merlin_sim.world.survey import map_of
from merlin_sim.world.world_file import file_to_write, parse_world
from merlin_sim.world.world_model import World
from merlin_sim.world.world_places import CLEARANCE, ROBOT_RADIUS

DOOR = 1.0  # m wide
CORNER = 0.5  # m between a door and the nearest corner
LEAST = 2.6  # m; no room is narrower
MOST = 200.0  # m of a side
TRIES = 60  # positions that are tried for one wall or one piece of furniture

FURNITURE = (  # name, size x, y, height (m), colour
    ("cupboard", 1.2, 0.45, 1.9, "#a67c52"),
    ("table", 1.2, 0.8, 0.75, "#8a6642"),
    ("sofa", 1.8, 0.8, 0.7, "#7a9e7e"),
    ("desk", 1.3, 0.6, 0.75, "#c9b18f"),
    ("box", 0.5, 0.5, 0.6, "#8fa7c4"),
)


@dataclass(frozen=True)
class Room:
    """A rectangle between the middles of its walls, m."""

    left: float
    bottom: float
    right: float
    top: float

    @property
    def area(self) -> float:
        """m²."""
        return (self.right - self.left) * (self.top - self.bottom)


class FloorPlan:
    """A plan that grows by dividing rooms.

    :param rooms: wanted; fewer when the area is too small for them.
    :param width: m, like height.
    :raises ValueError: when not even one room fits, or the floor is too large.
    """

    def __init__(self, rooms: int, width: float, height: float, seed: int) -> None:
        if not all(side >= LEAST for side in (width, height)):
            raise ValueError(f"a floor of {width:g} x {height:g} m is too small; each side needs {LEAST:g} m")
        if max(width, height) > MOST:
            raise ValueError(f"a floor of {width:g} x {height:g} m is too large; {MOST:g} m at most")
        if rooms < 1:
            raise ValueError(f"a floor needs at least one room, not {rooms}")
        self._random = draw(seed, "floor plan", 0)
        self.name = f"floor_{seed}"
        self.rooms = [Room(0.0, 0.0, round(width, 1), round(height, 1))]
        self._walls = [
            ((0.0, 0.0), (width, 0.0)),
            ((width, 0.0), (width, height)),
            ((width, height), (0.0, height)),
            ((0.0, height), (0.0, 0.0)),
        ]
        self._doors: List[Tuple[Tuple[float, float], Tuple[float, float]]] = []
        self._furniture: List[Dict[str, Any]] = []
        whole: Set[Room] = set()  # rooms that cannot be divided
        while len(self.rooms) < rooms and len(whole) < len(self.rooms):
            room = max((room for room in self.rooms if room not in whole), key=lambda room: room.area)
            if not self._divide(room):
                whole.add(room)

    def furnish(self, pieces: int) -> None:
        """Puts up to this many pieces into each room, none where it would cut something off."""
        for room in self.rooms:
            for _ in range(pieces):
                self._add_piece(room)

    def data(self) -> Dict[str, Any]:
        """The content of a world file."""
        return self._data(self._places(map_of(self._world())))

    def _world(self) -> World:
        """The present world; points in the middle of its rooms mark the inside, also below furniture."""
        world = parse_world(self._data([]), self.name)
        world.starts = [Pose((r.left + r.right) / 2, (r.bottom + r.top) / 2) for r in self.rooms]
        return world

    def _divide(self, room: Room) -> bool:
        upright = room.right - room.left > room.top - room.bottom
        low, high = (room.left, room.right) if upright else (room.bottom, room.top)
        first, last = (room.bottom, room.top) if upright else (room.left, room.right)
        if high - low < 2 * LEAST or last - first < DOOR + 2 * CORNER:
            return False
        for _ in range(TRIES):
            at = round(float(self._random.uniform(low + LEAST, high - LEAST)), 1)
            ends = [(at, first), (at, last)] if upright else [(first, at), (last, at)]
            if any(_near_door(end, door) for end in ends for door in self._doors):
                continue
            begin = round(float(self._random.uniform(first + CORNER, last - CORNER - DOOR)), 1)
            door = [(at, begin), (at, begin + DOOR)] if upright else [(begin, at), (begin + DOOR, at)]
            self._walls.append((ends[0], ends[1]))
            self._doors.append((door[0], door[1]))
            self.rooms.remove(room)
            high_side, low_side = ("right", "left") if upright else ("top", "bottom")
            self.rooms += [replace(room, **{high_side: at}), replace(room, **{low_side: at})]
            return True
        return False

    def _add_piece(self, room: Room) -> None:
        name, size_x, size_y, height, color = FURNITURE[self._random.integers(len(FURNITURE))]
        for _ in range(TRIES):
            if self._random.random() < 0.5:
                size_x, size_y = size_y, size_x
            free_x = room.right - room.left - size_x - 0.2
            free_y = room.top - room.bottom - size_y - 0.2
            if free_x <= 0.0 or free_y <= 0.0:
                continue
            x = room.left + 0.1 + size_x / 2 + free_x * float(self._random.choice([0.0, 1.0, 0.5]))
            y = room.bottom + 0.1 + size_y / 2 + free_y * float(self._random.random())
            piece = {
                "name": f"{name}_{len(self._furniture) + 1}",
                "at": [round(x, 2), round(y, 2)],
                "box": [size_x, size_y, height],
                "color": color,
            }
            self._furniture.append(piece)
            if self._all_reachable():
                return
            self._furniture.pop()

    def _all_reachable(self) -> bool:
        world = self._world()
        # Pieces that overlap pass for one; the map does not mind, but it looks odd.
        piece = world.furniture[-1]
        corners = np.array(piece.corners())
        for other in world.furniture[:-1]:
            box = np.array(other.corners())
            below = corners.min(axis=0) < box.max(axis=0)
            if below.all() and (corners.max(axis=0) > box.min(axis=0)).all():
                return False
        grid = map_of(world)
        try:
            places = self._places(grid)
        except ValueError:
            return False
        room = PathPlanner(grid, ROBOT_RADIUS, CLEARANCE).distance >= ROBOT_RADIUS + CLEARANCE
        labels, _ = label(room)
        return len({labels[cell] for cell in map(grid.cell, places) if cell is not None}) == 1

    def _places(self, grid: OccupancyGrid) -> List[Tuple[float, float]]:
        """The roomiest spot of each room."""
        planner = PathPlanner(grid, ROBOT_RADIUS, CLEARANCE)
        places = []
        for room in self.rooms:
            low, high = grid.cell((room.left, room.bottom)), grid.cell((room.right, room.top))
            assert low is not None and high is not None
            part = planner.distance[low[0] : high[0], low[1] : high[1]]
            if part.max() < ROBOT_RADIUS + CLEARANCE:
                raise ValueError("a room is full")
            row, column = np.unravel_index(int(np.argmax(part)), part.shape)
            x, y = grid.point(low[0] + int(row), low[1] + int(column))
            places.append((round(x, 3), round(y, 3)))
        return places

    def _data(self, places: List[Tuple[float, float]]) -> Dict[str, Any]:
        points = {f"room_{i}": {"x": x, "y": y, "yaw": 0.0} for i, (x, y) in enumerate(places, 1)}
        return {
            "name": self.name,
            "walls": [{"from": list(start), "to": list(end)} for start, end in self._walls],
            "doors": [
                {"name": f"door_{i}", "from": list(start), "to": list(end)}
                for i, (start, end) in enumerate(self._doors, 1)
            ],
            "furniture": self._furniture,
            "points_of_interest": points,
            "starts": list(points.values()),
        }


def _near_door(point: Tuple[float, float], door: Tuple[Tuple[float, float], Tuple[float, float]]) -> bool:
    (x0, y0), (x1, y1) = door
    return (
        min(x0, x1) - CORNER < point[0] < max(x0, x1) + CORNER
        and min(y0, y1) - CORNER < point[1] < max(y0, y1) + CORNER
    )


def write_plan(plan: FloorPlan, path: Path) -> None:
    """Writes a plan as a world file (YAML)."""
    text = yaml.safe_dump(plan.data(), sort_keys=False, default_flow_style=None)
    path.write_text(text, encoding="utf-8")


def main(arguments: Optional[List[str]] = None) -> int:
    """The command ``generate_world``; returns its exit code."""
    parser = argparse.ArgumentParser(prog="generate_world", description="Writes a random floor plan.")
    parser.add_argument("file", type=file_to_write, help="world file (YAML) to write")
    parser.add_argument("--rooms", type=int, default=8)
    parser.add_argument("--size", type=float, nargs=2, default=(16.0, 12.0), metavar=("WIDTH", "HEIGHT"))
    parser.add_argument("--furniture", type=int, default=3, help="pieces per room at most")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args(arguments)
    try:
        plan = FloorPlan(options.rooms, options.size[0], options.size[1], options.seed)
        plan.furnish(options.furniture)
        write_plan(plan, options.file)
    except (ValueError, OSError) as error:
        print(f"generate_world: {error}", file=sys.stderr)
        return 1
    if len(plan.rooms) < options.rooms:
        print(f"generate_world: only {len(plan.rooms)} of {options.rooms} rooms fit", file=sys.stderr)
    print(f"{options.file}: the world {plan.name}")
    return 0
