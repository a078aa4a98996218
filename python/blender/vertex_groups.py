"""Vertex groups, as a mesh, its field and a handle's settings make them."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np

from .shapes import Shape

_kept: dict[int, tuple[object, Shape]] = {}  # what it is made of and the shape, by the object's number in this session


def forget() -> None:
    """Let go of every shape."""
    _kept.clear()


def refresh(of: bpy.types.Object, handle: bpy.types.PropertyGroup) -> None:
    """Weigh anew by the handle's settings; what goes wrong is left in its `note`, as a slider has nobody to tell."""
    try:
        with object_mode(of):
            weigh(of, handle)
        handle.note = ""
    except (ValueError, OSError) as error:
        handle.note = str(error)


@contextmanager
def object_mode(of: bpy.types.Object) -> Iterator[None]:
    """Leave edit mode for a moment: only then are vertex groups Python's to write, and selections to read."""
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
    """Write a vertex group for each part of the shape, in object mode; return how many there are.

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
    """The shape of the object as its mesh and its field are now."""
    if not of.dfd.field:
        raise ValueError("Choose a field, or distill one")
    path = Path(bpy.path.abspath(of.dfd.field))
    mesh = of.data
    vertices = np.empty((len(mesh.vertices), 3), np.float32)
    mesh.vertices.foreach_get("co", vertices.ravel())
    mesh.calc_loop_triangles()
    triangles = np.empty((len(mesh.loop_triangles), 3), np.int32)
    mesh.loop_triangles.foreach_get("vertices", triangles.ravel())
    changed = path.stat().st_mtime_ns  # a field that is not there says so here
    made_of = (path, changed, of.dfd.axes, len(triangles), zlib.crc32(vertices), zlib.crc32(triangles))
    before, shape = _kept.get(of.session_uid, (None, None))
    if shape is None or before != made_of:
        shape = Shape(vertices.astype(np.float64), triangles, path, of.dfd.axes)
        _kept[of.session_uid] = made_of, shape
    return shape
