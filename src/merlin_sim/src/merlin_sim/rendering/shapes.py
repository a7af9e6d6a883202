# SPDX-License-Identifier: Apache-2.0
"""The triangles of simple shapes of size 1, around their middle."""

import math
from dataclasses import dataclass
from typing import List, Sequence, Tuple

import numpy as np

from merlin_sim.rendering.appearance import Shape

AROUND = 32  # sides of a cylinder, and of a sphere's equator
UPWARDS = 16  # rings of a sphere from pole to pole

Corners = Sequence[np.ndarray]


@dataclass(frozen=True)
class Triangles:
    """Corners, three for each triangle, counter-clockwise as seen from outside.

    :param points, normals: of the corners, n x 3.
    """

    points: np.ndarray
    normals: np.ndarray


def triangles(shape: Shape) -> Triangles:
    """The triangles of a shape that is not a mesh."""
    return {
        Shape.BOX: _box,
        Shape.CYLINDER: _cylinder,
        Shape.SPHERE: _sphere,
        Shape.RECTANGLE: _rectangle,
    }[shape]()


def fields(edges: np.ndarray, chosen: np.ndarray) -> Triangles:
    """Those fields of a flat board, seen from above, that are chosen.

    :param edges: where rows and columns begin and end.
    :param chosen: row after row, along y.
    """
    faces = []
    for row, column in np.argwhere(chosen):
        xs, ys = edges[column : column + 2], edges[row : row + 2]
        corners = [np.array([xs[i], ys[j], 0.0]) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]
        faces.append((corners, [np.array([0.0, 0.0, 1.0])] * 4))
    return _quads(faces)


def _rectangle() -> Triangles:
    return fields(np.array([-0.5, 0.5]), np.array([[True]]))


def _box() -> Triangles:
    faces = []
    for axis in range(3):
        # Axes that follow each other in turn keep the side from which a face is seen.
        turned = [np.roll(corner, axis) for corner in _square()]
        normal = np.roll(np.array([0.0, 0.0, 1.0]), axis)
        faces.append(([corner + normal / 2 for corner in turned], [normal] * 4))
        faces.append(([corner - normal / 2 for corner in reversed(turned)], [-normal] * 4))
    return _quads(faces)


def _cylinder() -> Triangles:
    up = np.array([0.0, 0.0, 1.0])
    faces = []
    for one, other in _pairs(AROUND):
        a, b = _around(one), _around(other)
        faces.append(([a / 2 - up / 2, b / 2 - up / 2, b / 2 + up / 2, a / 2 + up / 2], [a, b, b, a]))
        # Lids of triangles: the fourth corner is the middle, too.
        faces.append(([up / 2, a / 2 + up / 2, b / 2 + up / 2, up / 2], [up] * 4))
        faces.append(([-up / 2, b / 2 - up / 2, a / 2 - up / 2, -up / 2], [-up] * 4))
    return _quads(faces)


def _sphere() -> Triangles:
    def point(turn: float, ring: int) -> np.ndarray:
        height = math.pi * ring / UPWARDS
        return _around(turn) * math.sin(height) - np.array([0.0, 0.0, math.cos(height)])

    faces = []
    for one, other in _pairs(AROUND):
        for ring in range(UPWARDS):
            corners = [point(one, ring), point(other, ring), point(other, ring + 1), point(one, ring + 1)]
            faces.append(([corner / 2 for corner in corners], corners))
    return _quads(faces)


def _square() -> List[np.ndarray]:
    return [np.array([x, y, 0.0]) / 2 for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]


def _pairs(count: int) -> List[Tuple[float, float]]:
    """The angles at both ends of each side of a regular polygon."""
    return [(2 * math.pi * i / count, 2 * math.pi * (i + 1) / count) for i in range(count)]


def _around(angle: float) -> np.ndarray:
    return np.array([math.cos(angle), math.sin(angle), 0.0])


def _quads(faces: Sequence[Tuple[Corners, Corners]]) -> Triangles:
    """The triangles of faces with four corners and their normals."""
    order = (0, 1, 2, 0, 2, 3)
    return Triangles(
        np.array([corners[index] for corners, _ in faces for index in order]),
        np.array([normals[index] for _, normals in faces for index in order]),
    )
