"""Deep Feature Deformation weights in Blender: a vertex group for each selected vertex, of all that looks like it."""

from __future__ import annotations

import bpy

from . import distill, operators, panel, properties, vertex_groups

__all__ = ["register", "unregister"]

CLASSES = (*properties.CLASSES, *operators.CLASSES, *distill.CLASSES, *panel.CLASSES)


def register() -> None:
    """Add the classes, and what they keep with each object."""
    for each in CLASSES:
        bpy.utils.register_class(each)
    bpy.types.Object.dfd = bpy.props.PointerProperty(type=properties.ObjectSettings)


def unregister() -> None:
    """Take it all away again; vertex groups stay."""
    del bpy.types.Object.dfd
    for each in reversed(CLASSES):
        bpy.utils.unregister_class(each)
    vertex_groups.forget()
