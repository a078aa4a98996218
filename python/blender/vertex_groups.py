"""Write vertex groups from a mesh, its field and the settings of a handle."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np

from .shapes import Shape

_kept: dict[int, tuple[object, Shape]] = {}  # by the object's `session_uid`: the inputs of a shape, and the shape


def forget() -> None:
    """Remove every shape from the cache."""
    _kept.clear()


def refresh(obj: bpy.types.Object, handle: bpy.types.PropertyGroup) -> None:
    """Write the handle's vertex group again. Store an error in `handle.note`, because a slider cannot report it."""
    try:
        with object_mode(obj):
            weigh(obj, handle)
        handle.note = ""
    except (ValueError, OSError) as error:
        handle.note = str(error)


@contextmanager
def object_mode(obj: bpy.types.Object) -> Iterator[None]:
    """Switch to object mode inside the `with` block, because other modes do not let Python write vertex groups."""
    mode = obj.mode
    if mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    try:
        yield
    finally:
        if mode != "OBJECT":
            bpy.ops.object.mode_set(mode=mode)


def weigh(obj: bpy.types.Object, handle: bpy.types.PropertyGroup) -> None:
    """In object mode, write the vertex group of a handle.

    Raises ValueError if no field is chosen, or it is invalid or of another shape. Raises OSError if there is no file.
    """
    weights = _shape_of(obj).weights(handle.vertex, obj.dfd.preset, **handle.controls())
    group = obj.vertex_groups.get(handle.name) or obj.vertex_groups.new(name=handle.name)
    group.remove(np.flatnonzero(weights == 0).tolist())
    held = np.flatnonzero(weights)
    for vertex, weight in zip(held.tolist(), weights[held].tolist(), strict=True):
        group.add((vertex,), weight, "REPLACE")


def cut(obj: bpy.types.Object) -> int:
    """In object mode, write a vertex group for each part of the shape, and return the number of parts.

    Raises ValueError if no field is chosen, or it is invalid or of another shape. Raises OSError if there is no file.
    """
    found = _shape_of(obj).parts()
    for number, vertices in enumerate(found, 1):
        name = f"part {number}"
        group = obj.vertex_groups.get(name) or obj.vertex_groups.new(name=name)
        group.remove(range(len(obj.data.vertices)))
        group.add(vertices.tolist(), 1.0, "REPLACE")
    return len(found)


def _shape_of(obj: bpy.types.Object) -> Shape:
    """Return the shape of the object's present mesh and field. If nothing has changed, it comes from the cache."""
    if not obj.dfd.field:
        raise ValueError("Choose a field, or distill one")
    path = Path(bpy.path.abspath(obj.dfd.field))
    mesh = obj.data
    vertices = np.empty((len(mesh.vertices), 3), np.float32)
    mesh.vertices.foreach_get("co", vertices.ravel())
    mesh.calc_loop_triangles()
    triangles = np.empty((len(mesh.loop_triangles), 3), np.int32)
    mesh.loop_triangles.foreach_get("vertices", triangles.ravel())
    changed = path.stat().st_mtime_ns  # raises OSError if the field does not exist
    inputs = (path, changed, obj.dfd.axes, len(triangles), zlib.crc32(vertices), zlib.crc32(triangles))
    before, shape = _kept.get(obj.session_uid, (None, None))
    if shape is None or before != inputs:
        shape = Shape(vertices.astype(np.float64), triangles, path, obj.dfd.axes)
        _kept[obj.session_uid] = inputs, shape
    return shape
