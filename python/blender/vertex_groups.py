"""Vertex groups from a mesh, its field and a handle's settings."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np

from .shapes import Shape

_kept: dict[int, tuple[object, Shape]] = {}  # by `session_uid` of the object: the inputs of the shape, and the shape


def forget() -> None:
    """Remove every shape from the cache."""
    _kept.clear()


def refresh(of: bpy.types.Object, handle: bpy.types.PropertyGroup) -> None:
    """Write the handle's vertex group again; an error goes to its `note`, because a slider cannot report one."""
    try:
        with object_mode(of):
            weigh(of, handle)
        handle.note = ""
    except (ValueError, OSError) as error:
        handle.note = str(error)


@contextmanager
def object_mode(of: bpy.types.Object) -> Iterator[None]:
    """Switch to object mode, in which Python can write vertex groups and read selections."""
    mode = of.mode
    if mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    try:
        yield
    finally:
        if mode != "OBJECT":
            bpy.ops.object.mode_set(mode=mode)


def weigh(of: bpy.types.Object, handle: bpy.types.PropertyGroup) -> None:
    """Write the vertex group of a handle, in object mode.

    Raises ValueError if there is no field, or it is not of this shape. Raises OSError if it cannot be read.
    """
    weights = _shape_of(of).weights(handle.vertex, of.dfd.preset, **handle.controls())
    group = of.vertex_groups.get(handle.name) or of.vertex_groups.new(name=handle.name)
    group.remove(np.flatnonzero(weights == 0).tolist())
    held = np.flatnonzero(weights)
    for vertex, weight in zip(held.tolist(), weights[held].tolist(), strict=True):
        group.add((vertex,), weight, "REPLACE")


def cut(of: bpy.types.Object) -> int:
    """Write a vertex group for each part of the shape, in object mode, and return the number of parts.

    Raises ValueError if there is no field, or it is not of this shape. Raises OSError if it cannot be read.
    """
    found = _shape_of(of).parts()
    for number, vertices in enumerate(found, 1):
        name = f"part {number}"
        group = of.vertex_groups.get(name) or of.vertex_groups.new(name=name)
        group.remove(range(len(of.data.vertices)))
        group.add(vertices.tolist(), 1.0, "REPLACE")
    return len(found)


def _shape_of(of: bpy.types.Object) -> Shape:
    """Return the shape of the object's present mesh and field, from the cache if neither has changed."""
    if not of.dfd.field:
        raise ValueError("Choose a field, or distill one")
    path = Path(bpy.path.abspath(of.dfd.field))
    mesh = of.data
    vertices = np.empty((len(mesh.vertices), 3), np.float32)
    mesh.vertices.foreach_get("co", vertices.ravel())
    mesh.calc_loop_triangles()
    triangles = np.empty((len(mesh.loop_triangles), 3), np.int32)
    mesh.loop_triangles.foreach_get("vertices", triangles.ravel())
    changed = path.stat().st_mtime_ns  # raises OSError if the field does not exist
    made_of = (path, changed, of.dfd.axes, len(triangles), zlib.crc32(vertices), zlib.crc32(triangles))
    before, shape = _kept.get(of.session_uid, (None, None))
    if shape is None or before != made_of:
        shape = Shape(vertices.astype(np.float64), triangles, path, of.dfd.axes)
        _kept[of.session_uid] = made_of, shape
    return shape
