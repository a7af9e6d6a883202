# SPDX-License-Identifier: Apache-2.0
"""The parts of bodies as nodes of Panda3D's scenes, around the origin."""

import numpy as np
from panda3d.core import (
    Filename,
    Geom,
    GeomNode,
    GeomTriangles,
    GeomVertexData,
    GeomVertexFormat,
    Loader,
    LoaderOptions,
    Material,
    NodePath,
)

from merlin_reactive.recognition.tags import TAG, tag_dictionary
from merlin_sim.rendering.appearance import CARD, Color, Part, Shape, Vector
from merlin_sim.rendering.shapes import Triangles, fields, triangles


def part_node(part: Part) -> NodePath:
    """A part in its size and colour.

    :raises ValueError: the file of a mesh cannot be read.
    """
    if part.shape is Shape.MESH:
        return _mesh(part)
    if part.tag is not None:
        return _tag(part, part.tag)
    return _node(triangles(part.shape), part.size, part.color)


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


def _tag(part: Part, tag: int) -> NodePath:
    # Fields, not a picture on one face: the renderer's pictures on faces are not exact to a pixel.
    node, edges, black = NodePath("card"), card_edges(), card_fields(tag)
    _node(fields(edges, ~black), part.size, part.color).reparent_to(node)
    _node(fields(edges, black), part.size, (0.0, 0.0, 0.0)).reparent_to(node)
    return node


def _node(shape: Triangles, size: Vector, color: Color) -> NodePath:
    # Scaled here: a node that is would have normals of other lengths.
    corners = np.hstack([shape.points * size, shape.normals]).astype(np.float32)
    data = GeomVertexData("corners", GeomVertexFormat.get_v3n3(), Geom.UH_static)
    data.unclean_set_num_rows(len(corners))
    data.modify_array_handle(0).copy_data_from(corners.tobytes())
    order = GeomTriangles(Geom.UH_static)
    order.add_next_vertices(len(corners))
    geometry = Geom(data)
    geometry.add_primitive(order)
    node = GeomNode("shape")
    node.add_geom(geometry)
    path = NodePath(node)
    path.set_material(_material(color))
    return path


def _mesh(part: Part) -> NodePath:
    options = LoaderOptions(LoaderOptions.LF_no_cache)
    mesh = Loader.get_global_ptr().load_sync(Filename.from_os_specific(part.file), options)
    if mesh is None:
        raise ValueError(f"the mesh {part.file} cannot be read")
    node, path = NodePath("mesh"), NodePath(mesh)
    path.reparent_to(node)
    path.set_scale(*part.size)
    path.flatten_light()  # into the corners, for the normals' lengths
    path.set_texture_off(1)  # 1: over what the file says
    path.set_material(_material(part.color), 1)
    return node


def _material(color: Color) -> Material:
    material = Material()
    material.set_ambient((*color, 1.0))
    material.set_diffuse((*color, 1.0))
    return material
