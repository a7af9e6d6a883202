# SPDX-License-Identifier: Apache-2.0
"""How far each cell of a grid is from the nearest occupied one."""

from typing import Optional

import numpy as np

LOOK = 4  # rows further that are looked at before the next question whether that was far enough


def distance_field(free: np.ndarray, most: Optional[int] = None) -> np.ndarray:
    """Distances from centre to centre, in cells, exact.

    First along each row, then over the rows around it, as far as the largest distance asks for. On maps of
    buildings that takes as long as SciPy's, which brings 40 packages and a compiler; the import of OpenCV
    costs a node 100 MB.

    :param free: the cells (row, column) that are not occupied, as numbers or booleans.
    :param most: up to which distance they are exact; a longer one then only is longer than that. Saves time.
    :return: of each cell; larger than the grid where nothing is occupied.
    """
    free = free.astype(bool)
    far = sum(free.shape)
    if free.all():
        return np.full(free.shape, far, np.float32)
    column = np.arange(free.shape[1], dtype=np.int32 if far < 20000 else np.int64)  # has to hold 5 far²
    before = np.maximum.accumulate(np.where(free, -far, column), axis=1)
    after = np.minimum.accumulate(np.where(free, 2 * far, column)[:, ::-1], axis=1)[:, ::-1]
    in_row = np.minimum(column - before, after - column) ** 2
    nearest = in_row.copy()
    for step in range(1, len(free) if most is None else min(most + 1, len(free))):
        if step % LOOK == 1 and nearest.max() <= step * step:
            break
        there = in_row + step * step
        np.minimum(nearest[step:], there[:-step], out=nearest[step:])
        np.minimum(nearest[:-step], there[step:], out=nearest[:-step])
    return np.sqrt(nearest).astype(np.float32)
