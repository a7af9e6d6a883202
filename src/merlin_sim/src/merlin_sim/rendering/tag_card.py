# SPDX-License-Identifier: Apache-2.0
"""A card with an ArUco tag: which of its fields are black."""

import numpy as np

from merlin_reactive.recognition.tags import TAG, tag_dictionary
from merlin_sim.rendering.appearance import CARD

CELLS = 6  # of a 4x4 tag with its black border, along an edge


def card_edges() -> np.ndarray:
    """Where the fields of a card of size 1 begin and end, along an edge: a margin, the cells, a margin."""
    cells = np.linspace(-TAG / CARD / 2, TAG / CARD / 2, CELLS + 1)
    return np.array([-0.5, *cells, 0.5])


def card_fields(tag: int) -> np.ndarray:
    """Whether each field is black, the lowest row first."""
    import cv2  # few worlds have tags, and its import takes long

    dictionary = tag_dictionary()
    if hasattr(cv2.aruco, "generateImageMarker"):  # OpenCV 4.7 and later
        cells = cv2.aruco.generateImageMarker(dictionary, tag, CELLS)
    else:
        cells = cv2.aruco.drawMarker(dictionary, tag, CELLS)
    return np.pad(cells[::-1] == 0, 1)
