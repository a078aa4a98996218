"""The settings of an object: its field, and the handles of its vertex groups."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import bpy

from dfd.common.described import about, words_of
from dfd.editing.controls import Controls
from dfd.editing.presets import PARTLESS_REACH, PRESETS

from .vertex_groups import paused, refresh

PRESET_ITEMS = [("default", "Default", "The defaults of dfd"), ("paper", "Paper", "The paper's equations exactly")]
LEAST = 1e-6  # smallest value of a property that must be above 0
AXES = [
    ("AUTO", "Best fit", "Compare bounding boxes of the mesh and the field to choose one of the options below"),
    ("SAME", "The object's own", "The field has the same axes as the mesh in Blender"),
    ("Y_UP", "Y up, as glTF", "The field has the axes of a file that Blender rotated by 90 degrees during import"),
]


def _update(handle: HandleSettings, context: bpy.types.Context) -> None:
    """Update the handle's vertex group after a change of a control, and show this group in weight painting."""
    refresh(handle.id_data, handle)
    group = handle.id_data.vertex_groups.get(handle.name)
    if group is not None:
        handle.id_data.vertex_groups.active_index = group.index


def _update_all(settings: ObjectSettings, context: bpy.types.Context) -> None:
    """Update every vertex group after a change of the field or the axes. One update is enough for all of an edit."""
    refreshed = set()
    for handle in settings.handles:
        if handle.edit_id == 0 or not refreshed:
            refresh(settings.id_data, handle)
        if handle.edit_id:
            refreshed.add(handle.edit_id)


def _reset(settings: ObjectSettings, context: bpy.types.Context) -> None:
    """Set the controls of every handle to the preset's values, which updates every vertex group."""
    for handle in settings.handles:
        settings.start(handle)
    _update_all(settings, context)


PROPERTIES: dict[str, Any] = {}  # Blender properties for the controls that change weights
WORDS: dict[str, tuple[str, str]] = {}  # the switch "reach_part" sets the control "reach" to the value "part"
for name, (kind, said) in about(Controls).items():
    default, how = getattr(Controls, name), {"name": said.called(name), "description": said.text, "update": _update}
    if said.affects != "weights":
        continue
    if said.slider is not None:
        for word in words_of(kind):
            WORDS[f"{name}_{word}"] = name, word
            switch = {**how, "name": f"{said.called(name)}: {word}"}
            PROPERTIES[f"{name}_{word}"] = bpy.props.BoolProperty(**switch, default=default == word)
        how["default"] = PARTLESS_REACH if isinstance(default, str) else default or 0.0
        how |= {"soft_max": said.slider[1]} if said.unit is None else {"subtype": "DISTANCE"}
        how |= {} if said.maximum is None else {"max": said.maximum}
        least = LEAST if said.exclusive and default is not None else said.minimum
        PROPERTIES[name] = bpy.props.FloatProperty(**how, min=least, soft_min=said.slider[0])
    elif words := words_of(kind):
        items = [(word, word.capitalize(), "") for word in words]
        PROPERTIES[name] = bpy.props.EnumProperty(**how, items=items, default=default)
    elif kind is int:
        PROPERTIES[name] = bpy.props.IntProperty(**how, default=default)
    elif kind is bool:
        PROPERTIES[name] = bpy.props.BoolProperty(**how, default=default)
    else:
        PROPERTIES[name] = bpy.props.StringProperty(**how)


class HandleSettings(bpy.types.PropertyGroup):
    """One handle with its controls. The name of the handle is also the name of its vertex group."""

    vertex: bpy.props.IntProperty(name="Vertex", min=0)
    edit_id: bpy.props.IntProperty(description="Id of the handle in the object's edit; 0 if it is of no edit")
    note: bpy.props.StringProperty(description="Error of the last change")

    def controls(self) -> dict[str, Any]:
        """Return the controls as arguments of `dfd.Deformer.add`, except empty controls whose default is None."""
        given = {name: getattr(self, name) for name in PROPERTIES if name not in WORDS}
        given |= {control: word for switch, (control, word) in WORDS.items() if getattr(self, switch)}
        return {name: value for name, value in given.items() if value or getattr(Controls, name) is not None}

    def set(self, controls: Mapping[str, Any]) -> None:
        """Set the controls, without an update of the vertex group. Regions stay in the edit, and are not shown."""
        with paused():
            for name, value in controls.items():
                for switch, (control, word) in WORDS.items():
                    if control == name:
                        setattr(self, switch, value == word)
                if name in PROPERTIES and isinstance(value, (bool, int, float, str)):
                    setattr(self, name, PARTLESS_REACH if f"{name}_{value}" in WORDS else value)


HandleSettings.__annotations__.update(PROPERTIES)


class ObjectSettings(bpy.types.PropertyGroup):
    """The settings of an object. They are the object's property `dfd`."""

    field: bpy.props.StringProperty(
        name="Field", description="A .field.safetensors file of this shape", subtype="FILE_PATH", update=_update_all
    )
    axes: bpy.props.EnumProperty(name="Axes", items=AXES, default="AUTO", update=_update_all)
    preset: bpy.props.EnumProperty(
        name="Preset", description="Initial controls of handles", items=PRESET_ITEMS, default="default", update=_reset
    )
    handles: bpy.props.CollectionProperty(type=HandleSettings)
    edit: bpy.props.StringProperty(description="The text of the edit file that was applied")

    def start(self, handle: HandleSettings) -> None:
        """Set the controls of a handle to the preset's values, without an update of the vertex group."""
        handle.set(PRESETS[self.preset].handle)


class Preferences(bpy.types.AddonPreferences):
    """The path of the command `dfd`, which distills fields outside Blender, because Blender has no torch."""

    bl_idname = __package__
    command: bpy.props.StringProperty(
        name="dfd command", description="The command that runs dfd distill", default="dfd", subtype="FILE_PATH"
    )

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the preferences."""
        self.layout.prop(self, "command")


CLASSES = (HandleSettings, ObjectSettings, Preferences)
