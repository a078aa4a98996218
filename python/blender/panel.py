"""The panel in the sidebar of the 3D view."""

from __future__ import annotations

import bpy

from dfd.editing.controls import CONTROLS

from .operators import OfMesh
from .properties import PROPERTIES


class DFD_PT_weights(OfMesh, bpy.types.Panel):  # noqa: N801
    """The field, the handles and the controls of the handles"""

    bl_idname = "DFD_PT_weights"
    bl_label = "Feature Weights"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "dfd"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the settings, buttons and handles, in the order in which users need them."""
        layout, settings = self.layout, context.object.dfd
        layout.use_property_split = True
        layout.use_property_decorate = False  # no keyframe buttons: weights cannot be animated
        layout.prop(settings, "field")
        if settings.field:
            layout.prop(settings, "axes")
        layout.prop(settings, "preset")
        layout.operator("dfd.distill")
        layout.operator("dfd.weigh")
        layout.operator("dfd.apply", icon="FILE_FOLDER")
        layout.operator("dfd.parts")
        for index, handle in enumerate(settings.handles):
            box = layout.box()
            row = box.row()
            row.label(text=handle.name, icon="GROUP_VERTEX")
            row.operator("dfd.remove", text="", icon="X").index = index
            for name in PROPERTIES:
                box.prop(handle, name, slider=name in CONTROLS and CONTROLS[name].unit is None)
            if handle.note:
                box.label(text=handle.note, icon="ERROR")


CLASSES = (DFD_PT_weights,)
