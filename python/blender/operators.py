"""What the panel's buttons do: vertex groups of selected vertices, kept up to date with their sliders."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import bpy
import numpy as np

from .properties import HandleSettings
from .shapes import Shape

__all__ = ["CLASSES", "forget", "refresh"]

MOST_AT_ONCE = 64  # vertex groups that one click may make


class Kept(NamedTuple):
    """A shape, and what it was made of."""

    made_of: tuple[object, ...]
    shape: Shape


_kept: dict[int, Kept] = {}  # by the object's number in this session of Blender


def forget() -> None:
    """Let go of every shape."""
    _kept.clear()


def refresh(of: bpy.types.Object, handle: HandleSettings) -> None:
    """Weigh anew by the handle's settings; what goes wrong is left in its `note`, as a slider has nobody to tell."""
    try:
        with object_mode(of):
            _weigh(of, handle)
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


class DFD_OT_weigh(bpy.types.Operator):  # noqa: N801
    """Make a vertex group for each selected vertex, of all that looks like it"""

    bl_idname = "dfd.weigh"
    bl_label = "Weigh Selected Vertices"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Whether there is a mesh to work on."""
        return context.object is not None and context.object.type == "MESH"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Add the handles, and weigh."""
        of = context.object
        try:
            with object_mode(of):
                chosen = _selected(of)
                for vertex in chosen:
                    handle = of.dfd.handles.add()
                    handle.vertex, handle.name = vertex, _free_name(of, vertex)
                    try:
                        _weigh(of, handle)
                    except BaseException:
                        of.dfd.handles.remove(len(of.dfd.handles) - 1)
                        raise
        except (ValueError, OSError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, f"{len(chosen)} vertex {'group' if len(chosen) == 1 else 'groups'}")
        return {"FINISHED"}


class DFD_OT_remove(bpy.types.Operator):  # noqa: N801
    """Remove a handle and its vertex group"""

    bl_idname = "dfd.remove"
    bl_label = "Remove Handle"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012

    index: bpy.props.IntProperty(min=0)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Remove both."""
        of = context.object
        if of is None or self.index >= len(of.dfd.handles):
            self.report({"ERROR"}, f"There is no handle {self.index}")
            return {"CANCELLED"}
        group = of.vertex_groups.get(of.dfd.handles[self.index].name)
        if group is not None:
            of.vertex_groups.remove(group)
        of.dfd.handles.remove(self.index)
        return {"FINISHED"}


def _selected(of: bpy.types.Object) -> list[int]:
    chosen = np.zeros(len(of.data.vertices), bool)
    of.data.vertices.foreach_get("select", chosen)
    indices: list[int] = np.flatnonzero(chosen).tolist()
    if not indices:
        raise ValueError("Select one vertex or more")
    if len(indices) > MOST_AT_ONCE:
        raise ValueError(f"Select at most {MOST_AT_ONCE} vertices: each gets a group of its own, got {len(indices)}")
    return indices


def _free_name(of: bpy.types.Object, vertex: int) -> str:
    name, count = f"dfd {vertex}", 1
    while name in of.vertex_groups:
        count += 1
        name = f"dfd {vertex} ({count})"
    return name


def _weigh(of: bpy.types.Object, handle: HandleSettings) -> None:
    shape = _shape_of(of)
    weights = shape.weights(handle.vertex, reach=handle.reach, falloff=handle.falloff, locality=handle.locality)
    group = of.vertex_groups.get(handle.name) or of.vertex_groups.new(name=handle.name)
    group.remove(np.flatnonzero(weights == 0).tolist())
    held = np.flatnonzero(weights)
    for vertex, weight in zip(held.tolist(), weights[held].tolist(), strict=True):
        group.add((vertex,), weight, "REPLACE")


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
    kept = _kept.get(of.session_uid)
    if kept is None or kept.made_of != made_of:
        kept = Kept(made_of, Shape(vertices.astype(np.float64), triangles, path, of.dfd.axes))
        _kept[of.session_uid] = kept
    return kept.shape


CLASSES = (DFD_OT_weigh, DFD_OT_remove)
