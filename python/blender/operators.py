"""The operators that the buttons of the panel call."""

from __future__ import annotations

import bpy
import numpy as np

from .vertex_groups import cut, object_mode, weigh

MOST_AT_ONCE = 64  # largest number of vertex groups that one click makes


class OfMesh:
    """Base class of operators and panels that need a mesh."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Return whether the active object is a mesh."""
        return context.object is not None and context.object.type == "MESH"


class Step(OfMesh):
    """Base class of operators that change a mesh by their method `work`, which returns a report or raises an error."""

    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Call `work` in object mode. Report the text that it returns, or its ValueError or OSError."""
        try:
            with object_mode(context.object):
                told = self.work(context.object)
        except (ValueError, OSError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, told)
        return {"FINISHED"}


class DFD_OT_weigh(Step, bpy.types.Operator):  # noqa: N801
    """Make a vertex group for each selected vertex; it contains all vertices that look like the selected vertex"""

    bl_idname = "dfd.weigh"
    bl_label = "Weigh Selected Vertices"

    def work(self, obj: bpy.types.Object) -> str:
        """Add a handle for each selected vertex, and write the handle's vertex group."""
        chosen = _selected(obj)
        for vertex in chosen:
            handle = obj.dfd.handles.add()
            handle.vertex, handle.name = vertex, obj.vertex_groups.new(name=f"dfd {vertex}").name
            try:
                weigh(obj, handle)
                if obj.dfd.preset != "default":
                    obj.dfd.start(handle)
            except BaseException:
                _remove(obj, len(obj.dfd.handles) - 1)
                raise
        return f"{len(chosen)} vertex {'group' if len(chosen) == 1 else 'groups'}"


class DFD_OT_parts(Step, bpy.types.Operator):  # noqa: N801
    """Make a vertex group for each part of the shape"""

    bl_idname = "dfd.parts"
    bl_label = "Vertex Groups from Parts"

    def work(self, obj: bpy.types.Object) -> str:
        """Cut the shape into parts and write their vertex groups."""
        return f"{cut(obj)} parts"


class DFD_OT_remove(Step, bpy.types.Operator):  # noqa: N801
    """Remove a handle and its vertex group"""

    bl_idname = "dfd.remove"
    bl_label = "Remove Handle"

    index: bpy.props.IntProperty(min=0)

    def work(self, obj: bpy.types.Object) -> str:
        """Remove the handle and its vertex group."""
        if self.index >= len(obj.dfd.handles):
            raise ValueError(f"There is no handle {self.index}")
        return f"Removed {_remove(obj, self.index)}"


def _selected(obj: bpy.types.Object) -> list[int]:
    chosen = np.zeros(len(obj.data.vertices), bool)
    obj.data.vertices.foreach_get("select", chosen)
    indices: list[int] = np.flatnonzero(chosen).tolist()
    if not indices:
        raise ValueError("Select at least one vertex")
    if len(indices) > MOST_AT_ONCE:
        raise ValueError(f"Select at most {MOST_AT_ONCE} vertices, because each gets its own group; got {len(indices)}")
    return indices


def _remove(obj: bpy.types.Object, index: int) -> str:
    """Remove a handle and its vertex group, and return their name."""
    name: str = obj.dfd.handles[index].name
    if name in obj.vertex_groups:
        obj.vertex_groups.remove(obj.vertex_groups[name])
    obj.dfd.handles.remove(index)
    return name


CLASSES = (DFD_OT_weigh, DFD_OT_parts, DFD_OT_remove)
