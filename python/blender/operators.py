"""Operators of the panel's buttons."""

from __future__ import annotations

import bpy
import numpy as np

from .vertex_groups import cut, object_mode, weigh

MOST_AT_ONCE = 64  # vertex groups of one click


class OfMesh:
    """Base of operators and panels that need a mesh."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Return whether the active object is a mesh."""
        return context.object is not None and context.object.type == "MESH"


class Step(OfMesh):
    """Base of operators that change a mesh: `work` returns a report, or raises ValueError or OSError."""

    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Call `work` in object mode, and report its result or error."""
        try:
            with object_mode(context.object):
                told = self.work(context.object)
        except (ValueError, OSError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, told)
        return {"FINISHED"}


class DFD_OT_weigh(Step, bpy.types.Operator):  # noqa: N801
    """Make a vertex group for each selected vertex, of all vertices that look like it"""

    bl_idname = "dfd.weigh"
    bl_label = "Weigh Selected Vertices"

    def work(self, of: bpy.types.Object) -> str:
        """Add a handle for each selected vertex and write its vertex group."""
        chosen = _selected(of)
        for vertex in chosen:
            handle = of.dfd.handles.add()
            handle.vertex, handle.name = vertex, of.vertex_groups.new(name=f"dfd {vertex}").name
            try:
                weigh(of, handle)
                if of.dfd.preset != "default":
                    of.dfd.start(handle)
            except BaseException:
                _remove(of, len(of.dfd.handles) - 1)
                raise
        return f"{len(chosen)} vertex {'group' if len(chosen) == 1 else 'groups'}"


class DFD_OT_parts(Step, bpy.types.Operator):  # noqa: N801
    """Make a vertex group for each part of the shape"""

    bl_idname = "dfd.parts"
    bl_label = "Vertex Groups from Parts"

    def work(self, of: bpy.types.Object) -> str:
        """Cut the shape into parts and write their vertex groups."""
        return f"{cut(of)} parts"


class DFD_OT_remove(Step, bpy.types.Operator):  # noqa: N801
    """Remove a handle and its vertex group"""

    bl_idname = "dfd.remove"
    bl_label = "Remove Handle"

    index: bpy.props.IntProperty(min=0)

    def work(self, of: bpy.types.Object) -> str:
        """Remove the handle and its vertex group."""
        if self.index >= len(of.dfd.handles):
            raise ValueError(f"There is no handle {self.index}")
        return f"Removed {_remove(of, self.index)}"


def _selected(of: bpy.types.Object) -> list[int]:
    chosen = np.zeros(len(of.data.vertices), bool)
    of.data.vertices.foreach_get("select", chosen)
    indices: list[int] = np.flatnonzero(chosen).tolist()
    if not indices:
        raise ValueError("Select at least one vertex")
    if len(indices) > MOST_AT_ONCE:
        raise ValueError(f"Select at most {MOST_AT_ONCE} vertices: each gets a group of its own, got {len(indices)}")
    return indices


def _remove(of: bpy.types.Object, index: int) -> str:
    """Remove a handle and its group, and return its name."""
    name: str = of.dfd.handles[index].name
    if name in of.vertex_groups:
        of.vertex_groups.remove(of.vertex_groups[name])
    of.dfd.handles.remove(index)
    return name


CLASSES = (DFD_OT_weigh, DFD_OT_parts, DFD_OT_remove)
