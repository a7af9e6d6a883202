# SPDX-License-Identifier: Apache-2.0
"""The planar laser of a simulated robot."""

import math
from dataclasses import dataclass
from typing import Dict, Iterable, List, Optional, Tuple

import numpy as np

from merlin_reactive.pose import Point, Pose
from merlin_reactive.seeded_random import draw
from merlin_sim.world.world_model import Solid

Circle = Tuple[float, float, float]  # x, y, radius


class ScanOutlines:
    """The outlines of things at one height; things can move, come and go.

    :param height: m over the floor; lower things are not seen.
    """

    def __init__(self, height: float) -> None:
        self._height = height
        self._solids: Dict[str, Solid] = {}
        self._edges: Optional[np.ndarray] = None  # n x 4: start x, y, vector x, y
        self._circles = np.zeros((0, 3))

    def add(self, solid: Solid) -> None:
        """Adds a thing, or moves the one of its name."""
        if solid.height > self._height:
            self._solids[solid.name] = solid
            self._edges = None

    def remove(self, name: str) -> None:
        """Removes a thing, if it exists."""
        if self._solids.pop(name, None) is not None:
            self._edges = None

    def distances(
        self, origin: Point, angles: np.ndarray, reach: float, others: Iterable[Circle] = ()
    ) -> np.ndarray:
        """How far each ray gets, m; infinite when it meets nothing within reach.

        :param angles: directions in the map frame, rad.
        :param others: further circles.
        """
        edges = self._outline()
        directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        found = np.full(len(angles), np.inf)
        # A counter-clockwise outline shows its front to a viewer on the right of an edge.
        ahead = edges[:, :2] - np.asarray(origin)
        front = edges[:, 2] * ahead[:, 1] - edges[:, 3] * ahead[:, 0] > 0
        edges, ahead = edges[front], ahead[front]
        if len(edges):
            cross = directions[:, :1] * edges[:, 3] - directions[:, 1:] * edges[:, 2]
            with np.errstate(divide="ignore", invalid="ignore"):
                distance = (ahead[:, 0] * edges[:, 3] - ahead[:, 1] * edges[:, 2]) / cross
                along = (ahead[:, 0] * directions[:, 1:] - ahead[:, 1] * directions[:, :1]) / cross
                hit = (along >= 0) & (along <= 1) & (distance >= 0)
            found = np.where(hit, distance, np.inf).min(axis=1)
        circles = np.vstack([self._circles, *(np.array([circle]) for circle in others)])
        for x, y, radius in circles:
            found = np.minimum(found, _circle_distances(x - origin[0], y - origin[1], radius, directions))
        found[found > reach] = np.inf
        return found

    def _outline(self) -> np.ndarray:
        if self._edges is None:
            edges: List[np.ndarray] = [np.zeros((0, 4))]
            circles: List[np.ndarray] = [np.zeros((0, 3))]
            for solid in self._solids.values():
                if solid.radius is not None:
                    circles.append(np.array([[solid.pose.x, solid.pose.y, solid.radius]]))
                else:
                    corners = np.array(solid.corners())
                    edges.append(np.hstack([corners, np.roll(corners, -1, axis=0) - corners]))
            self._edges, self._circles = np.vstack(edges), np.vstack(circles)
        return self._edges


def _circle_distances(x: float, y: float, radius: float, directions: np.ndarray) -> np.ndarray:
    along = directions[:, 0] * x + directions[:, 1] * y
    inside = radius**2 - (x * x + y * y - along**2)
    distance = along - np.sqrt(np.maximum(inside, 0.0))
    return np.where((inside >= 0) & (distance >= 0), distance, np.inf)


@dataclass(frozen=True)
class LidarModel:
    """What the laser can do; lengths in m, angles in rad."""

    rays: int = 360
    range_min: float = 0.05
    range_max: float = 10.0
    sigma: float = 0.01  # of a range


class Lidar:
    """Scans from the middle of the robot; ray i points to -pi + i * 2 pi / rays in the robot's frame."""

    def __init__(self, model: LidarModel, seed: int, name: str) -> None:
        self.model = model
        self._seed, self._name = seed, name + "/scan"
        self.increment = 2 * math.pi / model.rays
        self._angles = -math.pi + self.increment * np.arange(model.rays)

    def scan(self, pose: Pose, outlines: ScanOutlines, others: Iterable[Circle], tick: int) -> np.ndarray:
        """The ranges seen from a pose, m; infinite where nothing is within reach.

        :param others: the outlines of other robots.
        :param tick: indexes the noise.
        """
        model = self.model
        ranges = outlines.distances(pose.point, self._angles + pose.yaw, model.range_max, others)
        ranges += model.sigma * draw(self._seed, self._name, tick).standard_normal(model.rays)
        ranges = np.maximum(ranges, model.range_min)
        ranges[ranges > model.range_max] = np.inf
        return ranges.astype(np.float32)
