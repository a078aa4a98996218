"""The operators that the buttons of the panel call."""

from __future__ import annotations

import warnings
from pathlib import Path

import bpy
import numpy as np

from .vertex_groups import animate, apply, cut, object_mode, paused, shape_of, weigh

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
                obj.dfd.start(handle)
                weigh(obj, handle)
            except BaseException:
                _remove(obj, len(obj.dfd.handles) - 1)
                raise
        return f"{len(chosen)} vertex {'group' if len(chosen) == 1 else 'groups'}"


class DFD_OT_apply(Step, bpy.types.Operator):  # noqa: N801
    """Make vertex groups of the handles in an edit file, shape keys of its poses, and an animation of its key poses"""

    bl_idname = "dfd.apply"
    bl_label = "Apply an Edit File"

    filepath: bpy.props.StringProperty(name="Edit file", subtype="FILE_PATH")
    filter_glob: bpy.props.StringProperty(default="*.json", options={"HIDDEN"})

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Let the user choose the file."""
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def work(self, obj: bpy.types.Object) -> str:
        """Replace the edit that was applied before, if there is one, by the one in the file."""
        from dfd.editing.edit_file import read_made_on

        path, settings = Path(bpy.path.abspath(self.filepath)), obj.dfd
        _, field, _ = read_made_on(path)
        field = None if settings.field or field is None or not field.is_file() else field
        shape = shape_of(obj, field)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            edit, document = shape.read(path)
        shape.applied(edit)  # raises an error before anything is changed
        if field is not None:
            settings.field = str(field)
        for index in reversed(range(len(settings.handles))):
            if settings.handles[index].edit_id:
                _remove(obj, index)
        with paused():
            settings.preset = edit.preset
        settings.edit = document
        for handle in edit.handles:
            item = settings.handles.add()
            item.edit_id = handle.id
            place = handle.place
            item.vertex = shape.nearest_vertex(place.position) if place.vertex is None else place.vertex
            item.name = obj.vertex_groups.new(name=handle.name or f"dfd handle {handle.id}").name
            item.set(vars(handle.controls))
        applied = apply(obj)
        animate(obj, applied)
        said = f"{len(edit.handles)} handles, {len(edit.poses)} key poses"
        return "; ".join([said, *(str(each.message) for each in caught)])


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
        of_edit = obj.dfd.handles[self.index].edit_id
        name = _remove(obj, self.index)
        if of_edit:
            apply(obj)
        return f"Removed {name}"


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


CLASSES = (DFD_OT_weigh, DFD_OT_apply, DFD_OT_parts, DFD_OT_remove)
