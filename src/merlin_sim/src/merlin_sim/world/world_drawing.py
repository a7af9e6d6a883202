# SPDX-License-Identifier: Apache-2.0
"""Draws worlds as pictures: the plan, and over it the paths that robots took."""

import argparse
import sys
from pathlib import Path
from typing import List, Optional, Sequence, Tuple

import cv2
import numpy as np

from merlin_reactive.pose import Point, Pose
from merlin_sim.world.world_file import WorldError, file_to_write, find_world, load_world
from merlin_sim.world.world_model import World

SCALE = 80  # pixels per metre
BORDER = 0.3  # m around the walls


class WorldDrawing:
    """A picture of a world that more can be drawn on."""

    def __init__(self, world: World) -> None:
        self._left, bottom, right, self._top = world.bounds()
        width = round((right - self._left + 2 * BORDER) * SCALE)
        height = round((self._top - bottom + 2 * BORDER) * SCALE)
        self.image = np.full((height, width, 3), 255, dtype=np.uint8)
        for solid in [*world.furniture, *world.unmapped]:
            self._fill(solid.corners(), solid.color)
            self._outline(solid.corners())
        for solid in world.wall_solids():
            self._fill(solid.corners(), solid.color)
        for door in world.doors:
            leaf = door.leaf(world.wall_thickness, world.wall_height).corners()
            self._outline(leaf) if door.open else self._fill(leaf, "#c08a4a")
        for person in world.people:
            if person.absent:
                continue
            if len(person.path) > 1:
                self.path(person.path, "#e0b0c8", 1)
            self._fill(person.solid(Pose(*person.path[0])).corners(), "#b04a7a")
        for pose in world.starts:
            self._arrow(pose.point, pose.yaw, (160, 160, 160))
        for name, pose in world.points_of_interest.items():
            self._arrow(pose.point, pose.yaw, (40, 40, 200))
            x, y = self.pixel(pose.point)
            cv2.putText(
                self.image, name, (x - 30, y + 34), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (0, 0, 0), 1, cv2.LINE_AA
            )

    def pixel(self, point: Point) -> Tuple[int, int]:
        """The pixel (column, row) of a point of the map frame."""
        return (
            round((point[0] - self._left + BORDER) * SCALE),
            round((self._top - point[1] + BORDER) * SCALE),
        )

    def path(self, points: Sequence[Point], color: str = "#d04020", thickness: int = 2) -> None:
        """Draws a path."""
        pixels = np.array([self.pixel(point) for point in points], dtype=np.int32)
        cv2.polylines(self.image, [pixels], False, _bgr(color), thickness, cv2.LINE_AA)

    def save(self, path: Path) -> None:
        """Writes the picture.

        :raises OSError: when it cannot be written.
        """
        try:
            written = cv2.imwrite(str(path), self.image)
        except cv2.error as error:
            raise OSError(f"{path}: {error.err}") from error
        if not written:
            raise OSError(f"{path} cannot be written")

    def _fill(self, corners: List[Point], color: str) -> None:
        cv2.fillPoly(self.image, [np.array(list(map(self.pixel, corners)))], _bgr(color), cv2.LINE_AA)

    def _outline(self, corners: List[Point]) -> None:
        cv2.polylines(
            self.image, [np.array(list(map(self.pixel, corners)))], True, (90, 90, 90), 1, cv2.LINE_AA
        )

    def _arrow(self, point: Point, yaw: float, color: Tuple[int, int, int]) -> None:
        tip = (point[0] + 0.3 * np.cos(yaw), point[1] + 0.3 * np.sin(yaw))
        cv2.circle(self.image, self.pixel(point), 5, color, -1, cv2.LINE_AA)
        cv2.arrowedLine(self.image, self.pixel(point), self.pixel(tip), color, 2, cv2.LINE_AA, tipLength=0.4)


def _bgr(color: str) -> Tuple[int, int, int]:
    return int(color[5:7], 16), int(color[3:5], 16), int(color[1:3], 16)


def main(arguments: Optional[List[str]] = None) -> int:
    """The command ``draw_world``; returns its exit code."""
    parser = argparse.ArgumentParser(prog="draw_world", description="Draws a world file as a PNG.")
    parser.add_argument("world", help="world file (YAML), or the name of one that comes with merlin_sim")
    parser.add_argument("picture", type=file_to_write, help="PNG file to write")
    options = parser.parse_args(arguments)
    try:
        world = load_world(find_world(options.world))
        WorldDrawing(world).save(options.picture)
    except (WorldError, OSError) as error:
        print(f"draw_world: {error}", file=sys.stderr)
        return 1
    print(f"{options.picture}: the world {world.name}")
    return 0
