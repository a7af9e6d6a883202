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

from merlin_sim.rendering.appearance import Color, Part, Shape, Vector
from merlin_sim.rendering.shapes import Triangles, fields, triangles
from merlin_sim.rendering.tag_card import card_edges, card_fields


def part_node(part: Part) -> NodePath:
    """A part in its size and colour.

    :raises ValueError: the file of a mesh cannot be read.
    """
    if part.shape is Shape.MESH:
        return _mesh(part)
    if part.tag is not None:
        return _tag(part, part.tag)
    return _node(triangles(part.shape), part.size, part.color)


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
