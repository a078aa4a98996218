"""What the panel's buttons do."""

from __future__ import annotations

import bpy
import numpy as np

from .vertex_groups import cut, object_mode, weigh

MOST_AT_ONCE = 64  # vertex groups that one click may make


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
                        weigh(of, handle)
                        if of.dfd.preset != "default":
                            of.dfd.start(handle)
                    except BaseException:
                        of.dfd.handles.remove(len(of.dfd.handles) - 1)
                        raise
        except (ValueError, OSError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, f"{len(chosen)} vertex {'group' if len(chosen) == 1 else 'groups'}")
        return {"FINISHED"}


class DFD_OT_parts(bpy.types.Operator):  # noqa: N801
    """Make a vertex group for each part: what looks alike and would move as one"""

    bl_idname = "dfd.parts"
    bl_label = "Vertex Groups from Parts"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Whether there is a mesh to work on."""
        return DFD_OT_weigh.poll(context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Cut, and write the groups."""
        try:
            with object_mode(context.object):
                count = cut(context.object)
        except (ValueError, OSError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, f"{count} parts")
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


CLASSES = (DFD_OT_weigh, DFD_OT_parts, DFD_OT_remove)
