"""Deep Feature Deformation weights in Blender, as vertex groups of the vertices that look like a selected vertex."""

from __future__ import annotations

import bpy

from . import distill, operators, panel, properties, vertex_groups

__all__ = ["register", "unregister"]

CLASSES = (*properties.CLASSES, *operators.CLASSES, *distill.CLASSES, *panel.CLASSES)


def register() -> None:
    """Register the classes, and add the property `dfd` with the settings to all objects."""
    for each in CLASSES:
        bpy.utils.register_class(each)
    bpy.types.Object.dfd = bpy.props.PointerProperty(type=properties.ObjectSettings)


def unregister() -> None:
    """Unregister the classes and remove the settings. Vertex groups stay."""
    del bpy.types.Object.dfd
    for each in reversed(CLASSES):
        bpy.utils.unregister_class(each)
    vertex_groups.forget()
