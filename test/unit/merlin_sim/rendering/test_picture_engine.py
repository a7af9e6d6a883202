# SPDX-License-Identifier: Apache-2.0
"""What is drawn: shapes where their corners are, meshes, large pictures, one scene after the other."""

import math
import struct

import numpy as np
import pytest

from merlin_sim.rendering.appearance import Part, Shape
from merlin_sim.rendering.picture_engine import PictureEngine
from merlin_sim.rendering.shapes import triangles
from merlin_sim.rendering.shot import Shot
from merlin_sim.robot.camera import Camera, CameraModel, CameraPose

MODEL = CameraModel(160, 120, noise=0.0)
AHEAD = CameraPose(np.array([0.0, 0.0, 0.0]), np.eye(3))  # along x
RED = (1.0, 0.0, 0.0)


def shot(*looks, places=None, scene=1, model=MODEL, pose=AHEAD):
    places = places or [(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)] * len(looks)
    return Shot(scene, looks, np.reshape(places, (-1, 7)), Camera(model, 1, ""), pose, 0)


@pytest.fixture
def engine():
    engine = PictureEngine()
    yield engine
    engine.close()


def drawn(picture):
    """Where it is not sky."""
    return (picture < 250).any(axis=2)


@pytest.mark.parametrize("shift", [0.0, 0.004, 0.009])
def test_edges_are_where_the_camera_model_has_them(engine, shift):
    box = Part(Shape.BOX, (0.2, 0.5, 0.3), RED, at=(1.1, shift, 0.0))  # its front is at 1 m
    seen = drawn(engine.expose(shot((box,))))
    v, u = np.argwhere(seen).T
    left, _, depth = MODEL.matrix() @ [-0.25 - shift, 0.0, 1.0]
    right = (MODEL.matrix() @ [0.25 - shift, 0.0, 1.0])[0]
    top = (MODEL.matrix() @ [0.0, -0.15, 1.0])[1]
    assert depth == 1.0
    # The middle of a pixel is inside; the renderer rounds to a third of one.
    assert u.min() == pytest.approx(left + 0.5, abs=0.7)
    assert u.max() == pytest.approx(right - 0.5, abs=0.7)
    assert v.min() == pytest.approx(top + 0.5, abs=0.7)


@pytest.mark.parametrize("shape", [shape for shape in Shape if shape is not Shape.MESH])
def test_shapes_are_closed_and_turned_outwards(shape):
    corners = triangles(shape)
    one, two, three = (corners.points[index::3] for index in range(3))
    outwards = np.cross(two - one, three - one)
    area = np.linalg.norm(outwards, axis=1)
    middles = (corners.normals[0::3] + corners.normals[1::3] + corners.normals[2::3]) / 3
    assert (np.sum(outwards * middles, axis=1)[area > 1e-9] > 0).all()
    assert np.abs(corners.points).max() == pytest.approx(0.5)
    volume = np.sum(one * np.cross(two, three)) / 6
    whole = {Shape.BOX: 1.0, Shape.CYLINDER: math.pi / 4, Shape.SPHERE: math.pi / 6}
    assert volume == pytest.approx(whole.get(shape, 0.0), rel=0.03)


def test_a_face_is_as_bright_as_it_is_turned_to_the_light(engine):
    top = Part(Shape.BOX, (1.0, 1.0, 0.1), (0.5, 0.5, 0.5), at=(2.0, 0.0, -1.0))
    turn = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    down = CameraPose(np.array([2.0, 0.0, 2.0]), turn)
    picture = engine.expose(shot((top,), pose=down))
    light = 0.7 + 0.4 * 2.0 / math.sqrt(1.0 + 0.36 + 4.0)
    assert picture[60, 80] == pytest.approx(np.full(3, 127.5 * light), abs=3)


def write_stl(path):
    """A pyramid, apex up, 2 wide, 1 high."""
    a, b, c, d, top = (-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0), (0, 0, 1)
    faces = [(a, b, top), (b, c, top), (c, d, top), (d, a, top), (a, c, b), (a, d, c)]
    data = b"\0" * 80 + struct.pack("<I", len(faces))
    for face in faces:
        normal = np.cross(np.subtract(face[1], face[0]), np.subtract(face[2], face[0]))
        normal = normal / np.linalg.norm(normal)
        data += struct.pack("<12fH", *normal, *(value for corner in face for value in corner), 0)
    path.write_bytes(data)


def write_obj(path):
    corners = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nv 0 0 1\n"
    path.write_text(corners + "f 1 2 5\nf 2 3 5\nf 3 4 5\nf 4 1 5\nf 1 3 2\nf 1 4 3\n")


@pytest.mark.parametrize("write, name", [(write_stl, "pyramid.stl"), (write_obj, "pyramid.obj")])
def test_a_mesh_is_drawn_in_its_size_and_colour(engine, tmp_path, write, name):
    write(tmp_path / name)
    part = Part(Shape.MESH, (0.2, 0.2, 0.4), RED, at=(1.5, 0.0, 0.0), file=str(tmp_path / name))
    picture = engine.expose(shot((part,)))
    v, u = np.argwhere(drawn(picture)).T
    base = MODEL.matrix() @ [0.0, 0.0, 1.3]
    apex = MODEL.matrix() @ [0.0, -0.4, 1.5]
    assert v.max() == pytest.approx(base[1] / base[2], abs=1.5)
    assert v.min() == pytest.approx(apex[1] / apex[2], abs=2.5)
    assert u.max() - u.min() == pytest.approx(0.4 / 1.3 * MODEL.focal, abs=2.5)
    red, green, blue = picture[v.max() - 2, 80]
    assert red > 150 and green == blue == 0


def test_a_mesh_that_is_missing_is_named(engine):
    with pytest.raises(ValueError, match="missing.stl cannot be read"):
        engine.expose(shot((Part(Shape.MESH, (1.0, 1.0, 1.0), file="/missing.stl"),)))


def test_looks_may_be_left_out_that_are_known(engine):
    box = (Part(Shape.BOX, (0.2, 0.2, 0.2), RED, at=(1.0, 0.2, 0.0)),)
    other = (Part(Shape.SPHERE, (0.2, 0.2, 0.2), RED, at=(1.0, -0.2, 0.0)),)
    here = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    both = engine.expose(shot(box, other))
    again = PictureEngine()
    again.expose(shot(box))
    assert (again.expose(shot(other, places=[here, here])) == both).all()
    assert (again.expose(shot(box, other)) == both).all()
    with pytest.raises(ValueError, match="3 places"):
        again.expose(shot(places=[here] * 3))
    again.close()


def test_another_scene_and_another_size_leave_nothing_behind(engine):
    box = (Part(Shape.BOX, (0.2, 0.2, 0.2), RED, at=(1.0, 0.0, 0.0)),)
    first = engine.expose(shot(box))
    assert not drawn(engine.expose(shot(scene=2))).any()
    large = engine.expose(shot(box, scene=3, model=CameraModel(320, 240, noise=0.0)))
    assert large.shape == (240, 320, 3) and drawn(large).sum() == pytest.approx(
        4 * drawn(first).sum(), rel=0.1
    )
    assert (engine.expose(shot(box, scene=4)) == first).all()


def test_the_largest_picture_comes(engine):
    box = (Part(Shape.BOX, (0.2, 0.2, 0.2), RED, at=(1.0, 0.0, 0.0)),)
    model = CameraModel(4096, 4096, noise=0.0)
    picture = engine.expose(shot(box, model=model))
    width = np.count_nonzero(drawn(picture)[2048])
    assert width == pytest.approx(0.2 / 0.9 * model.focal, abs=2)
