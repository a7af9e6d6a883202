# SPDX-License-Identifier: Apache-2.0
"""PyBullet without a window, quiet, and robots for it."""

import contextlib
import ctypes
import os
import sys
from tempfile import NamedTemporaryFile
from typing import Any, Dict, Iterator, List, Tuple

from merlin_sim.rendering.appearance import Part, Parts, Shape


@contextlib.contextmanager
def muted_output() -> Iterator[None]:
    """Sends the descriptors of standard output and error to nowhere meanwhile; exceptions pass."""
    sys.stdout.flush()
    sys.stderr.flush()
    nowhere = os.open(os.devnull, os.O_WRONLY)
    kept = [(stream, os.dup(stream)) for stream in (1, 2)]
    try:
        for stream, _ in kept:
            os.dup2(nowhere, stream)
        yield
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        ctypes.CDLL(None).fflush(None)  # what C's own buffer still holds belongs to the silence
        for stream, copy in kept:
            os.dup2(copy, stream)
            os.close(copy)
        os.close(nowhere)


with muted_output():  # the engine greets on standard output when it is imported
    import pybullet
    from pybullet_utils.bullet_client import BulletClient

BASE = -1  # the engine's number of a body's first link


def new_engine() -> Any:
    """A PyBullet without a window and with nothing in it."""
    with muted_output():
        return BulletClient(pybullet.DIRECT)


def load_robot(engine: Any, urdf: str) -> int:
    """Puts a robot into an engine; returns its body.

    :param urdf: the text of its description.
    """
    with NamedTemporaryFile("w", suffix=".urdf", encoding="utf-8") as file:
        file.write(urdf)
        file.flush()
        with muted_output():
            return int(engine.loadURDF(file.name, useFixedBase=False))


def links_seen(engine: Any, body: int) -> List[Tuple[int, Parts]]:
    """The links of a robot that can be seen, each with its parts in the frame of :func:`place_of`."""
    # Where the engine says that a body is, is its centre of mass; of a link it knows the frame too.
    mass = engine.getDynamicsInfo(body, BASE)[3:5]
    to_mass = engine.invertTransform(*mass)
    links: Dict[int, List[Part]] = {}
    for _, link, kind, sizes, file, at, turn, rgba, *_ in engine.getVisualShapeData(body):
        if link == BASE:
            at, turn = engine.multiplyTransforms(*to_mass, at, turn)
        shape, size = _shape(kind, sizes)
        part = Part(shape, size, tuple(rgba[:3]), tuple(at), tuple(turn), file.decode())
        links.setdefault(link, []).append(part)
    return [(link, tuple(parts)) for link, parts in links.items()]


def place_of(engine: Any, body: int, link: int = BASE) -> Tuple[float, ...]:
    """Where a body or a link is: x, y, z (m) and the quaternion x, y, z, w."""
    if link == BASE:
        position, turn = engine.getBasePositionAndOrientation(body)
    else:
        position, turn = engine.getLinkState(body, link, computeForwardKinematics=True)[4:6]
    return (*position, *turn)


def _shape(kind: int, sizes: Tuple[float, float, float]) -> Tuple[Shape, Tuple[float, float, float]]:
    one, other, _ = sizes
    if kind == pybullet.GEOM_BOX:
        return Shape.BOX, sizes
    if kind == pybullet.GEOM_CYLINDER:  # length and radius
        return Shape.CYLINDER, (2 * other, 2 * other, one)
    if kind == pybullet.GEOM_SPHERE:
        return Shape.SPHERE, (2 * one, 2 * one, 2 * one)
    return Shape.MESH, sizes
