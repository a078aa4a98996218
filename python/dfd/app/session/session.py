"""The state of one tab: its shape, field, edit and messages. This module does not depend on the web server."""

import logging
import re
import shutil
from collections.abc import Callable, Hashable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfd.app.options import OpenedFile, Opening, SessionOptions, Source, read_shape
from dfd.app.protocol import messages
from dfd.app.protocol.requests import request
from dfd.app.session.preparation import Preparation
from dfd.app.session.state import Editing
from dfd.app.session.surface import mesh_message
from dfd.common.devices import out_of_memory
from dfd.common.preset import Preset
from dfd.editing.deformer import Deformer
from dfd.editing.edit import Edit, band_on
from dfd.editing.edit_file import read_edit
from dfd.mesh.mesh import Mesh
from dfd.symmetry.plane import SymmetryPlane

NO_FIELD = messages.FieldState(status="none", origin=None)
STATUS = {"distill": "distilling", "prepare": "preparing"}  # the status of the field while a task runs
FUNCTION = re.compile(r"^\w+(\.\w+)?: ")  # error messages of the package start with the name of the function: `bind: …`
# Advice in error messages that is only for Python, and its replacement on the page.
REMEDIES = {", other_shape=True accepts it anyway": "", "dfd.editing.transfer": "`dfd deform --made-on`"}

log = logging.getLogger("dfd.app")


Work = Callable[[], None]


class Session:
    """The session of one tab, with files in `folder`. All methods are called on one thread.

    `send` sends a text or binary message to the page, or drops it if no page is connected. `post` runs a function on
    the session's thread, and may be called on any thread.
    """

    def __init__(
        self, folder: Path, options: SessionOptions, send: Callable[[str | bytes], None], post: Callable[[Work], None]
    ) -> None:
        self.folder, self.options, self._send, self.post = folder, options, send, post
        self._preparation: Preparation | None = None
        self._progress: messages.ProgressMessage | None = None  # the last progress message of the running task
        self._warnings: list[str] = []  # warnings from reading the file of the shape
        self.after = 0  # the `id` of the newest request
        self._names: dict[str, str] = {}  # original names of opened files, by path
        self._uploads: list[Path] = []  # folders of the open shape's uploads
        self.exports: dict[str, Path] = {}  # files to download, by the random name in their URLs
        self._pending_edit: Path | None = None  # an edit file that is applied when the field is ready
        self.name = "mesh"  # the name of the shape
        self.mesh: Mesh | None = None
        self.field = NO_FIELD
        self.poses: messages.KeyPoses = ()
        self.editing: Editing | None = None  # None without a field
        if (deformer := options.deformer) is not None:
            self.mesh, self.editing = deformer.mesh, Editing(deformer)
            self.name = deformer.mesh.source.name if deformer.mesh.source else "mesh"
            self.field = messages.FieldState(status="ready", origin="file", parts=self.editing.parts.ways)

    def begin(self) -> None:
        """Open the files in the options. Called when the first page connects."""
        try:
            self.open(self.options)
        finally:
            if self._preparation is None:
                self.attach()

    def open(self, given: Opening) -> None:
        """Open the files in `given`. Without a mesh, the field and the edit belong to the mesh that is already open.

        Raises ValueError or OSError if a file cannot be read; the open shape then stays open.
        """
        for file in (given.mesh, given.field, given.edit):
            if isinstance(file, OpenedFile):
                self._names[str(file.path)] = file.name
        try:
            if given.mesh is not None:
                self._open_mesh(given.mesh, find_field=given.field is None)
            if given.field is not None:
                if self._preparation is None:
                    raise ValueError("Open a mesh before its field")
                self._preparation.cancel()
                self._tell_field("preparing")
                self._preparation.start("prepare", self._preparation.open, given.field.path, "file")
            if given.edit is not None:
                self._open_edit(given.edit.path)
        except BaseException:
            if given.folder is not None:
                shutil.rmtree(given.folder, ignore_errors=True)
            raise
        if given.folder is not None:
            self._uploads.append(given.folder)

    def _open_mesh(self, source: Source, *, find_field: bool) -> None:
        """Replace the open shape. With `find_field`, the new shape's field is found or distilled."""
        name = source.capitalize() if isinstance(source, str) else source.name
        self.tell_progress("open", "read")
        try:
            mesh, warnings = read_shape(source)
            message, arrays = mesh_message(mesh, name=name, warnings=warnings)
        finally:
            self.tell_progress("open", "done")
        self.close_shape()
        self.name, self.mesh, self._warnings = name, mesh, warnings
        self.send(message, **arrays)
        self._preparation = Preparation(self, mesh, source)
        if find_field:
            self._tell_field("preparing")
            self._preparation.start("prepare", self._preparation.find)

    def _open_edit(self, path: Path) -> None:
        """Apply the edit in a file as one step of undo, once the field is ready."""
        if self.mesh is None:
            raise ValueError("Open a mesh before its edit")
        if self.editing is None:
            self._pending_edit = path
            return
        read = read_edit(path, self.mesh)
        self.change(lambda deformer: deformer.apply(read))

    def close_shape(self) -> None:
        """Stop background work, and close the shape with its field, its edit, its key poses and its files."""
        if self._preparation is not None:
            self._preparation.drop()
        self._preparation = self._progress = self._pending_edit = None
        self.mesh = self.editing = None
        self.field, self.poses = NO_FIELD, ()
        while self._uploads:
            shutil.rmtree(self._uploads.pop(), ignore_errors=True)

    @request
    def open_sample(self, name: messages.Text) -> None:
        """Open one of the samples that the message `session` lists."""
        self.open(Opening(mesh=name))

    @request
    def close_mesh(self) -> None:
        """Close the shape and show the start page; the edit is lost."""
        self.close_shape()
        self.send(messages.StartMessage())

    @request
    def distill(self) -> None:
        """Distill the shape's field in the background. The server sends `progress`, then `columns` and `state`."""
        if self._preparation is None:
            raise ValueError("Open a mesh first")
        if self.field.status != "none":
            raise ValueError("The shape has a field, or one is being made")
        self._tell_field("distilling")
        self._preparation.start("distill", self._preparation.distill)

    @request
    def cancel(self) -> None:
        """Stop the distillation."""
        if self._preparation is not None:
            self._preparation.cancel()

    def tell_progress(
        self, task: Any, stage: str, done: int = 0, total: int | None = None, seconds_left: float | None = None
    ) -> None:
        """Send the progress of a task. The last stage of a task is "done", "cancelled" or "failed"."""
        ended, status = stage in ("done", "cancelled", "failed"), STATUS.get(task, self.field.status)
        if not ended and self.field.status != status:
            self._tell_field(status)
        message = messages.ProgressMessage(task=task, stage=stage, done=done, total=total, seconds_left=seconds_left)
        self._progress = None if ended else message
        self.send(message)

    def field_ready(self, deformer: Deformer, origin: str, warnings: list[Warning]) -> None:
        """Start editing, because the field is ready."""
        self.editing = Editing(deformer)
        self.field = messages.FieldState(status="ready", origin=origin)
        self.tell_progress("prepare", "done")
        for warning in warnings:
            self.fail(0, warning)
        pending_edit, self._pending_edit = self._pending_edit, None
        self.tell_state()
        if pending_edit is not None:
            self.guarded(0, lambda: self._open_edit(pending_edit))

    def field_prepared(self, planes: Mapping[Preset, Sequence[SymmetryPlane]]) -> None:
        """Store the planes of symmetry of each preset. Switch on the best plane unless the shape has been edited."""
        editing = self.require()
        deformer, parts = editing.deformer, editing.parts
        editing.planes, parts.ready = planes, True
        self.field = self.field.model_copy(update={"parts": parts.ways})
        if (found := planes.get(deformer.preset)) and deformer.edit == Edit(preset=deformer.preset):
            deformer.set_symmetry(found[0], band=band_on(deformer.mesh, deformer.preset))
            editing.history.begin()
        self.tell_state()

    def field_ended(self, task: str, error: Exception | None) -> None:
        """Report that a task failed or was stopped before it gave a field. An existing field stays in use."""
        self.tell_progress(task, "cancelled" if error is None else "failed")
        if error is not None:
            self.fail(0, error)
        self._tell_field("none" if self.editing is None else "ready")

    def attach(self) -> None:
        """Send the whole state to a page that has just connected."""
        if self.mesh is None:
            self.send(messages.StartMessage())
            return
        message, arrays = mesh_message(self.mesh, name=self.name, warnings=self._warnings)
        self.send(message, **arrays)
        if self.editing is not None:
            self.editing.sent = {}
        self.after = 0
        self.tell_state()
        if self._progress is not None:
            self.send(self._progress)

    def guarded(self, number: int, work: Work) -> None:
        """Call `work`. If it raises an exception, send a `failure` for the request with the `id` `number`."""
        try:
            work()
        except Exception as error:
            self.fail(number, error)

    def fail(self, number: int, error: Exception) -> None:
        """Send a `failure` with the `id` `number`, without paths of this machine; log unexpected exceptions."""
        if out_of_memory(error):
            why = "Memory ran out; nothing was changed. Take a smaller mesh, or close other programs"
        elif isinstance(error, (ValueError, OSError, UserWarning)):
            why = str(error)
        else:
            log.error("a request failed", exc_info=error)
            why = f"Internal error: {type(error).__name__}: {error}"
        for path, name in self._names.items():
            why = why.replace(f"`path` {path}", name).replace(path, name)
        for remedy, possible in REMEDIES.items():
            why = why.replace(remedy, possible)
        why = FUNCTION.sub("", why.replace(f"{self.folder}/", ""))
        self.send(messages.FailureMessage(id=number, message=why))

    def require(self) -> Editing:
        """Return the editing state; raise ValueError if no shape is open, or the shape has no field yet."""
        if self.editing is None:
            raise ValueError("Open a mesh first" if self.mesh is None else "The shape has no field yet: distill one")
        return self.editing

    @property
    def deformer(self) -> Deformer:
        """Return the editing session; raise ValueError if no shape is open, or the shape has no field yet."""
        return self.require().deformer

    def change(self, work: Callable[[Deformer], object], topic: Hashable = None, *, merge: bool = False) -> None:
        """Change the edit and send the result to the page; if anything fails, the edit is unchanged.

        With `merge`, the change becomes part of the newest undo step if that step has the same `topic`.
        """
        with self.deformer.step(topic, merge=merge):
            work(self.deformer)
            self.require().check_drawable()
        self.tell_state()

    @request
    def set_poses(self, poses: messages.KeyPoses) -> None:
        """Replace the key poses. They are not part of the edit, and undo does not change them."""
        self.require()
        self.poses = poses
        self.tell_state()

    def run_deferred(self) -> None:
        """Between requests, send the state if Python code changed the edit, and send the report if the edit is new."""
        editing = self.editing
        if editing is None:
            return
        if editing.deformer.edit is not editing.shown:
            self.tell_state()
        if editing.unreported:
            editing.unreported = False
            text = str(editing.deformer.report())
            self.send(messages.ReportMessage(text=text[:1].upper() + text[1:]))

    def send(self, message: messages.Answer, **arrays: NDArray[Any]) -> None:
        """Send a message, with arrays if there are any."""
        self._send(messages.pack(message, **arrays) if arrays else message.model_dump_json())

    def tell_state(self) -> None:
        """Send the weights that the page does not have yet, then the present state."""
        if self.mesh is None:
            return
        common: Any = {"field": self.field, "poses": self.poses, "after": self.after}
        if self.editing is None:
            self.send(messages.StateMessage(preset="default", **common))
            return
        self.editing.shown, self.editing.unreported = self.editing.deformer.edit, True
        columns, new = self.editing.columns()
        if new:
            self.send(messages.ColumnsMessage(columns=tuple(new)), values=np.stack(list(new.values())))
        self.send(self.editing.state(columns, **common))

    def _tell_field(self, status: str) -> None:
        self.field = self.field.model_copy(update={"status": status})
        self.tell_state()
