# SPDX-License-Identifier: Apache-2.0
"""Draws the way of the robot over the map."""

from dataclasses import dataclass
from pathlib import Path
from typing import Dict, Optional, Sequence, Tuple

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

Point = Tuple[float, float]


@dataclass(frozen=True)
class MapPicture:
    """An occupancy grid ready to be drawn.

    :ivar occupied: true where there is an obstacle; row = y, column = x.
    :ivar resolution: edge of a cell, m.
    :ivar origin: map coordinates of the outer corner of cell (0, 0), m.
    """

    occupied: np.ndarray
    resolution: float
    origin: Point

    def draw(self, axes: Axes, points: Dict[str, Point]) -> None:
        """Draws the map and the points of interest (m)."""
        rows, columns = self.occupied.shape
        x, y = self.origin
        extent = (x, x + columns * self.resolution, y, y + rows * self.resolution)
        axes.imshow(self.occupied, cmap="Greys", vmin=0, vmax=1.6, origin="lower", extent=extent)
        for name, (point_x, point_y) in points.items():
            axes.plot(point_x, point_y, "x", color="tab:red", markersize=8, markeredgewidth=2)
            axes.annotate(name, (point_x, point_y), xytext=(6, 6), textcoords="offset points", fontsize=8)
        axes.set_aspect("equal")
        axes.set_xlabel("x (m)")
        axes.set_ylabel("y (m)")


def plot_path(
    path: Path,
    picture: MapPicture,
    points: Dict[str, Point],
    way: Sequence[Point],
    stops: Optional[Sequence[Point]] = None,
    title: str = "",
) -> None:
    """Writes a PNG of one run.

    :param path: the file.
    :param picture: the map.
    :param points: points of interest, m.
    :param way: positions of the robot in their order, m.
    :param stops: where tasks were cancelled, m.
    :param title: of the figure.
    """
    figure, axes = plt.subplots(figsize=(8, 6.5))
    picture.draw(axes, points)
    if way:
        x, y = zip(*way)
        axes.plot(x, y, color="tab:blue", linewidth=1.2, label="path")
        axes.plot(x[0], y[0], "o", color="tab:green", label="start")
    if stops:
        x, y = zip(*stops)
        axes.plot(x, y, "s", color="tab:orange", markersize=5, label="cancelled here")
    axes.legend(loc="upper left", bbox_to_anchor=(0.0, -0.08), ncol=3, frameon=False)
    axes.set_title(title)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110, bbox_inches="tight")
    plt.close(figure)
