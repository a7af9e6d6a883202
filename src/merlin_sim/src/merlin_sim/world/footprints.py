"""Whether two things would be in the same place."""

import cv2
import numpy as np

from merlin_sim.world.world_model import Solid

TOUCHING = 2e-5  # m² that two outlines may share: things may stand side by side
STACKED = 0.002  # m, likewise in height


def collide(one: Solid, other: Solid, one_bottom: float = 0.0, other_bottom: float = 0.0) -> bool:
    """Whether two things share space; their lower ends are so many m above the floor."""
    if (
        one_bottom + one.height <= other_bottom + STACKED
        or other_bottom + other.height <= one_bottom + STACKED
    ):
        return False
    shared, _ = cv2.intersectConvexConvex(_polygon(one, one), _polygon(other, one))
    return bool(shared > TOUCHING)


def _polygon(solid: Solid, around: Solid) -> np.ndarray:
    # Single precision: near the origin it resolves micrometres.
    return (np.array(solid.corners()) - around.pose.point).astype(np.float32)
