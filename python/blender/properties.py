"""What is kept with an object: its field, and the handles that its vertex groups came of."""

from __future__ import annotations

from typing import get_args

import bpy

from dfd.editing.presets import PARTLESS_REACH, PRESETS
from dfd.weights.bind import Falloff

from .vertex_groups import refresh

FALLOFFS = [(name, name.capitalize(), "") for name in get_args(Falloff)]
DEFAULTS = PRESETS["default"]
PRESET_ITEMS = [
    ("default", "Default", "What measurements and pictures say is better"),
    ("paper", "Paper", "The paper's equations to the letter"),
]
AXES = [
    ("AUTO", "Whichever fits", "As the object's or as glTF's, by the box of the field's shape"),
    ("SAME", "The object's own", "The field has the coordinates of the mesh as Blender shows them"),
    ("Y_UP", "Y up, as glTF", "Blender turned the file by a quarter when it was imported"),
]


def _again(handle: HandleSettings, context: bpy.types.Context) -> None:
    """A slider moved: the handle's vertex group follows, and is the one that weight painting shows."""
    refresh(handle.id_data, handle)
    group = handle.id_data.vertex_groups.get(handle.name)
    if group is not None:
        handle.id_data.vertex_groups.active_index = group.index


def _another(settings: ObjectSettings, context: bpy.types.Context) -> None:
    """Another field, or other axes: every group follows."""
    for handle in settings.handles:
        refresh(settings.id_data, handle)


def _preset(settings: ObjectSettings, context: bpy.types.Context) -> None:
    """Another preset: every handle has its reach and falloff, and every group follows."""
    for handle in settings.handles:
        settings.start(handle)


class HandleSettings(bpy.types.PropertyGroup):
    """One handle; its `name` is that of its vertex group."""

    vertex: bpy.props.IntProperty(name="Vertex", min=0)
    whole_part: bpy.props.BoolProperty(
        name="Whole part",
        description="Hold the part at the vertex with its counterparts; where no part ends there, the reach counts",
        default=DEFAULTS.reach == "part",
        update=_again,
    )
    reach: bpy.props.FloatProperty(
        name="Reach",
        description="Distance between features at which the weight is 0: less takes fewer counterparts along",
        default=PARTLESS_REACH,
        min=0.01,
        soft_max=1.5,
        update=_again,
    )
    falloff: bpy.props.EnumProperty(name="Falloff", items=FALLOFFS, default=DEFAULTS.falloff, update=_again)
    locality: bpy.props.FloatProperty(
        name="Locality",
        description="How much faster the weight falls off along the surface; 0 for not at all",
        default=0.0,
        min=0.0,
        soft_max=10.0,
        update=_again,
    )
    note: bpy.props.StringProperty(description="What went wrong with the last change")


class ObjectSettings(bpy.types.PropertyGroup):
    """What dfd knows of an object."""

    field: bpy.props.StringProperty(
        name="Field", description="A .field.safetensors of this shape", subtype="FILE_PATH", update=_another
    )
    axes: bpy.props.EnumProperty(name="Axes", items=AXES, default="AUTO", update=_another)
    preset: bpy.props.EnumProperty(
        name="Preset", description="What handles begin with", items=PRESET_ITEMS, default="default", update=_preset
    )
    handles: bpy.props.CollectionProperty(type=HandleSettings)

    def start(self, handle: HandleSettings) -> None:
        """Give a handle the preset's reach and falloff."""
        reach = PRESETS[self.preset].reach
        handle.whole_part = reach == "part"
        handle.reach = PARTLESS_REACH if isinstance(reach, str) else reach
        handle.falloff = PRESETS[self.preset].falloff


class Preferences(bpy.types.AddonPreferences):
    """Where dfd's command is: distilling needs the whole package, which Blender has not."""

    bl_idname = __package__
    command: bpy.props.StringProperty(
        name="dfd command", description="What starts dfd distill", default="dfd", subtype="FILE_PATH"
    )

    def draw(self, context: bpy.types.Context) -> None:
        """Show it."""
        self.layout.prop(self, "command")


CLASSES = (HandleSettings, ObjectSettings, Preferences)
