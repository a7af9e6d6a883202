# SPDX-License-Identifier: Apache-2.0
"""Draws shots: Panda3D's software renderer, which needs neither a display nor a driver."""

from typing import List, Optional, Sequence

import numpy as np
from panda3d.core import (
    AmbientLight,
    Camera,
    DirectionalLight,
    FrameBufferProperties,
    GraphicsEngine,
    GraphicsOutput,
    GraphicsPipe,
    GraphicsPipeSelection,
    LMatrix4,
    LQuaternion,
    LVector3,
    NodePath,
    PerspectiveLens,
    Texture,
    WindowProperties,
    load_prc_file_data,
)

from merlin_sim.rendering.appearance import Parts
from merlin_sim.rendering.part_nodes import part_node
from merlin_sim.rendering.shot import Shot
from merlin_sim.robot.camera import FAR, NEAR, CameraModel, CameraPose

LIGHT = (-1.0, -0.6, 2.0)  # where it comes from
AMBIENT, DIFFUSE = 0.7, 0.4  # brightness without the light, and what it adds to a face towards it
SKY = (1.0, 1.0, 1.0, 1.0)
#: The renderer puts corners into the middles of pixels: it draws this many for one, along both edges. Odd, so
#: that one of them has the same middle.
FINENESS = 3
FINE_PIXELS = 1.5e6  # larger pictures are drawn as they are, for the memory that they take

for setting in (
    "window-type offscreen",
    "notify-level error",
    "model-cache-dir",  # none: it would keep files in the user's home
    "load-file-type p3assimp",  # of meshes
    "assimp-gen-normals true",  # where their file has none
):
    load_prc_file_data("", setting)


class PictureEngine:
    """Makes the pictures of shots that come one after the other.

    :raises RuntimeError: the library has no software renderer.
    """

    def __init__(self) -> None:
        self._pipe = GraphicsPipeSelection.get_global_ptr().make_pipe(
            "TinyOffscreenGraphicsPipe", "p3tinydisplay"
        )
        if self._pipe is None:
            raise RuntimeError("Panda3D has no software renderer: its p3tinydisplay cannot be loaded")
        self._engine = GraphicsEngine()
        self._film: Optional[_Film] = None
        self._scene = -1
        self._root = NodePath("scene")
        self._bodies: List[NodePath] = []
        self._places = np.zeros((0, 7))

    def expose(self, shot: Shot) -> np.ndarray:
        """The picture of a shot, with its noise: height x width x 3, RGB, 0..255.

        :param shot: its looks may leave out those that an earlier shot of its scene had.
        :raises ValueError: they leave out more.
        """
        if shot.scene != self._scene:
            self.close()
            self._scene = shot.scene
            _light(self._root)
            # In the order in which they came: else addresses decide where two faces are in one place.
            self._root.set_bin("unsorted", 0)
        came = len(shot.places) - len(self._bodies)
        if not 0 <= came <= len(shot.looks):
            raise ValueError(f"{len(shot.places)} places for other bodies than there are")
        for look in shot.looks[len(shot.looks) - came :]:
            self._add(look)
        self._move(shot.places)
        model = shot.camera.model
        if self._film is None or self._film.model != model:
            self._drop_film()
            self._film = _Film(self._engine, self._pipe, self._root, model)
        self._film.point(shot.pose)
        self._engine.render_frame()
        return shot.camera.expose(self._film.pixels(), shot.tick)

    def close(self) -> None:
        """Frees the image buffer and all nodes of the scene."""
        self._drop_film()
        self._root.remove_node()
        self._root = NodePath("scene")
        self._scene = -1
        self._bodies, self._places = [], np.zeros((0, 7))

    def _drop_film(self) -> None:
        if self._film is not None:
            self._engine.remove_window(self._film.output)
            self._film = None

    def _add(self, look: Parts) -> None:
        body = self._root.attach_new_node("body")
        for part in look:
            node = part_node(part)
            node.reparent_to(body)
            node.set_pos_quat(LVector3(*part.at), _quaternion(part.turn))
        self._bodies.append(body)
        self._places = np.vstack([self._places, np.full((1, 7), np.nan)])

    def _move(self, places: np.ndarray) -> None:
        for index in np.flatnonzero((places != self._places).any(axis=1)):
            x, y, z, *turn = places[index].tolist()
            self._bodies[index].set_pos_quat(LVector3(x, y, z), _quaternion(turn))
        self._places = places


class _Film:
    """Where a camera's pictures are drawn."""

    def __init__(
        self, engine: GraphicsEngine, pipe: GraphicsPipe, root: NodePath, model: CameraModel
    ) -> None:
        self.model = model
        depths = FrameBufferProperties()
        depths.set_rgba_bits(8, 8, 8, 8)
        depths.set_depth_bits(24)
        self._fineness = FINENESS if model.width * model.height <= FINE_PIXELS else 1
        size = WindowProperties.size(self._fineness * model.width, self._fineness * model.height)
        self.output = engine.make_output(pipe, "film", 0, depths, size, GraphicsPipe.BF_refuse_window)
        if self.output is None:
            raise RuntimeError(f"no film of {model.width} x {model.height} pixels")
        self.output.set_clear_color(SKY)
        self._texture = Texture()
        self.output.add_render_texture(self._texture, GraphicsOutput.RTM_copy_ram)
        lens = PerspectiveLens()
        lens.set_film_size(model.width, model.height)
        lens.set_focal_length(model.focal)
        lens.set_near_far(NEAR, FAR)
        self._camera = root.attach_new_node(Camera("camera", lens))
        self.output.make_display_region().set_camera(self._camera)

    def point(self, pose: CameraPose) -> None:
        """Puts the camera somewhere."""
        # The library's camera has x to the right, y ahead and z up, and its matrices stand on their side.
        forward, left, up = pose.turn.T
        rows = zip((-left, forward, up, pose.position), (0.0, 0.0, 0.0, 1.0))
        self._camera.set_mat(LMatrix4(*[value for row, last in rows for value in (*row.tolist(), last)]))

    def pixels(self) -> np.ndarray:
        """What was drawn: height x width x 3, RGB, 0..255."""
        fine, middle = self._fineness, self._fineness // 2
        drawn = np.frombuffer(self._texture.get_ram_image(), dtype=np.uint32)
        drawn = drawn.reshape(fine * self.model.height, fine * self.model.width)[middle::fine, middle::fine]
        # Blue, green, red and opacity, the lowest row first. The copy fits into a cache.
        colors = drawn.copy().view(np.uint8).reshape(self.model.height, self.model.width, 4)
        return colors[::-1, :, 2::-1]


def _light(root: NodePath) -> None:
    ambient = AmbientLight("ambient")
    ambient.set_color((AMBIENT, AMBIENT, AMBIENT, 1.0))
    sun = DirectionalLight("sun")
    sun.set_color((DIFFUSE, DIFFUSE, DIFFUSE, 1.0))
    sun.set_direction(-LVector3(*LIGHT).normalized())
    for light in (ambient, sun):
        root.set_light(root.attach_new_node(light))


def _quaternion(turn: Sequence[float]) -> LQuaternion:
    x, y, z, w = turn
    return LQuaternion(w, x, y, z)
