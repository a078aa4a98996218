"""Distill a field with the command `dfd distill` in another process, because Blender has no torch."""

from __future__ import annotations

import subprocess
import tempfile
from pathlib import Path
from typing import IO

import bpy

from .operators import OfMesh
from .vertex_groups import object_mode

CHECK_INTERVAL = 0.5  # seconds; how often the extension checks whether the process has ended


class DFD_OT_distill(OfMesh, bpy.types.Operator):  # noqa: N801
    """Distill a field of the mesh and write the field to a file; Escape stops the distillation"""

    bl_idname = "dfd.distill"
    bl_label = "Distill a Field"

    output: bpy.props.StringProperty(
        name="Field",
        description="The file to write; if empty, a file in the folder of the .blend file",
        subtype="FILE_PATH",
    )
    options: bpy.props.StringProperty(name="Options", description="Further options of dfd distill")

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Start the process. In background mode, wait until it ends."""
        self._object_name = context.object.name
        self._path = Path(bpy.path.abspath(self.output)) if self.output else _beside_blend(context.object)
        self._folder = tempfile.TemporaryDirectory(prefix="dfd-")
        mesh = Path(self._folder.name) / "mesh.glb"
        command = context.preferences.addons[__package__].preferences.command
        self._log: IO[bytes] = (Path(self._folder.name) / "log").open("w+b")
        try:
            export(context.object, mesh)
            self._process = subprocess.Popen(
                [command, "distill", mesh, "--output", self._path, "--up", "+z", *self.options.split()],
                stdin=subprocess.DEVNULL,
                stdout=self._log,
                stderr=subprocess.STDOUT,
            )
        except (OSError, RuntimeError) as error:
            self._close()
            self.report({"ERROR"}, f"dfd distill did not start: {error}. Set the path of dfd in the preferences")
            return {"CANCELLED"}
        if bpy.app.background:
            self._process.wait()
            return self._finish()
        self._timer = context.window_manager.event_timer_add(CHECK_INTERVAL, window=context.window)
        context.window_manager.modal_handler_add(self)
        context.workspace.status_text_set("dfd distill: Escape stops it")
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Finish if the process has ended, or stop the process if Escape is pressed."""
        stopped = event.type == "ESC"
        if stopped:
            self._process.terminate()
            self._process.wait()
        if not stopped and (event.type != "TIMER" or self._process.poll() is None):
            return {"PASS_THROUGH"}
        context.window_manager.event_timer_remove(self._timer)
        context.workspace.status_text_set(None)
        if stopped:
            self._close()
            return {"CANCELLED"}
        return self._finish()

    def _finish(self) -> set[str]:
        """Set the object's field to the written file, or report the error."""
        self._log.seek(0)
        log = self._log.read().decode(errors="replace").strip()
        failed = self._process.returncode != 0
        self._close()
        if failed:
            self.report({"ERROR"}, f"dfd distill failed: {log.splitlines()[-1] if log else 'no output'}")
            return {"CANCELLED"}
        obj = bpy.data.objects.get(self._object_name)
        if obj is not None:
            obj.dfd.axes = "SAME"
            obj.dfd.field = str(self._path)
        return {"FINISHED"}

    def _close(self) -> None:
        self._log.close()
        self._folder.cleanup()


def export(obj: bpy.types.Object, path: Path) -> None:
    """Write the mesh and its materials to `path`, in the object's own coordinates."""
    # The exporter gets a copy of the object at the origin and without modifiers.
    collection, alone = bpy.data.collections.new("dfd"), bpy.data.objects.new("dfd", obj.data)
    bpy.context.scene.collection.children.link(collection)
    collection.objects.link(alone)
    try:
        with object_mode(obj):
            bpy.ops.export_scene.gltf(
                filepath=str(path),
                collection=collection.name,
                export_yup=False,
                export_apply=False,
                export_animations=False,
                export_skins=False,
                export_morph=False,
            )
    finally:
        bpy.data.objects.remove(alone)
        bpy.data.collections.remove(collection)


def _beside_blend(obj: bpy.types.Object) -> Path:
    folder = Path(bpy.data.filepath).parent if bpy.data.filepath else Path(bpy.app.tempdir)
    return folder / f"{bpy.path.clean_name(obj.name)}.field.safetensors"


CLASSES = (DFD_OT_distill,)
