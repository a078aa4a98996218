"""What the panel's buttons do."""

from __future__ import annotations

import bpy
import numpy as np

from .vertex_groups import cut, object_mode, weigh

MOST_AT_ONCE = 64  # vertex groups that one click may make


class OfMesh:
    """What needs a mesh."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Whether there is a mesh to work on."""
        return context.object is not None and context.object.type == "MESH"


class Step(OfMesh):
    """What changes a mesh at once: its `work` says what it has done, or raises ValueError or OSError."""

    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Do it, or say why not."""
        try:
            with object_mode(context.object):
                told = self.work(context.object)
        except (ValueError, OSError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, told)
        return {"FINISHED"}


class DFD_OT_weigh(Step, bpy.types.Operator):  # noqa: N801
    """Make a vertex group for each selected vertex, of all that looks like it"""

    bl_idname = "dfd.weigh"
    bl_label = "Weigh Selected Vertices"

    def work(self, of: bpy.types.Object) -> str:
        """Add the handles, and weigh."""
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
    """Make a vertex group for each part: what looks alike and would move as one"""

    bl_idname = "dfd.parts"
    bl_label = "Vertex Groups from Parts"

    def work(self, of: bpy.types.Object) -> str:
        """Cut, and write the groups."""
        return f"{cut(of)} parts"


class DFD_OT_remove(Step, bpy.types.Operator):  # noqa: N801
    """Remove a handle and its vertex group"""

    bl_idname = "dfd.remove"
    bl_label = "Remove Handle"

    index: bpy.props.IntProperty(min=0)

    def work(self, of: bpy.types.Object) -> str:
        """Remove both."""
        if self.index >= len(of.dfd.handles):
            raise ValueError(f"There is no handle {self.index}")
        return f"{_remove(of, self.index)} is removed"


def _selected(of: bpy.types.Object) -> list[int]:
    chosen = np.zeros(len(of.data.vertices), bool)
    of.data.vertices.foreach_get("select", chosen)
    indices: list[int] = np.flatnonzero(chosen).tolist()
    if not indices:
        raise ValueError("Select one vertex or more")
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
