# SPDX-License-Identifier: Apache-2.0
"""A picture that is to be made: everything that it shows, as it is at one moment."""

from dataclasses import dataclass
from typing import Tuple

import numpy as np

from merlin_sim.rendering.appearance import Parts
from merlin_sim.robot.camera import Camera, CameraPose


class PictureError(Exception):
    """No picture came; the text says why."""


@dataclass(frozen=True)
class Shot:
    """What a camera is to see.

    :param scene: number of the scene; a world that began anew is another one.
    :param looks: of all bodies of the scene, in the order in which they came. Each link of a robot is one.
    :param places: of the bodies: x, y, z (m) and the quaternion x, y, z, w.
    :param tick: physics steps; indexes the noise.
    """

    scene: int
    looks: Tuple[Parts, ...]
    places: np.ndarray
    camera: Camera
    pose: CameraPose
    tick: int
