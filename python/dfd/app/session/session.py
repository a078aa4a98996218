"""The state of one tab: its shape, field, edit and messages. This module does not depend on the web server."""

import logging
import os
import re
import shutil
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from dfd.app.options import SAMPLES, OpenedFile, Opening, SessionOptions, Source, read_shape
from dfd.app.protocol import messages
from dfd.app.protocol.requests import request
from dfd.app.session.kept_edits import (
    KeptEdit,
    delete_kept,
    duplicate_kept,
    find_recent,
    recent_edits,
    rename_kept,
    restore_kept,
    upload_folder,
)
from dfd.app.session.preparation import Preparation
from dfd.app.session.stages import ENDS, OTHERS, STAGES
from dfd.app.session.state import Editing, quantized
from dfd.app.session.summary import details, summary
from dfd.app.session.surface import mesh_message
from dfd.common.devices import out_of_memory
from dfd.common.preset import Preset
from dfd.editing.deformer import Deformer
from dfd.editing.edit import Edit, band_on
from dfd.editing.edit_file import MadeOn, read_edit
from dfd.editing.key_pose import KeyPose
from dfd.mesh.mesh import Mesh
from dfd.posing.transforms import vector
from dfd.segmentation.parts import Part
from dfd.symmetry.plane import SymmetryPlane

NO_FIELD = messages.FieldState(status="none", origin=None)
STATUS = {"distill": "distilling", "prepare": "preparing"}  # the status of the field while a task runs
FUNCTION = re.compile(r"^\w+(\.\w+)?: ")  # error messages of the package start with the name of the function: `bind: …`
# Advice in error messages that is only for Python, and its replacement on the page.
REMEDIES = {", other_shape=True accepts it anyway": "", "dfd.editing.transfer": "`dfd batch --edit`"}
MOST_SUGGESTED = 12  # largest number of suggested places; more markers would hide the shape
MOST_RECENT = 8  # number of shapes in the list of recent shapes
COPY = "This shape is open in another tab. This tab edits a copy."

PICTURE = r"^data:image/(png|jpeg|webp);base64,[A-Za-z0-9+/]+={0,2}$"

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
        self._fresh = False  # whether the open shape begins without its kept edit
        self._kept: KeptEdit | None = None  # the file that keeps the edit; None without a shape, and in a notebook
        self.name = "mesh"  # the name of the shape
        self.mesh: Mesh | None = None
        self.field = NO_FIELD
        self.editing: Editing | None = None  # None without a field
        if (deformer := options.deformer) is not None:
            self.mesh, self.editing = deformer.mesh, Editing(deformer)
            self.name = deformer.mesh.source.name if deformer.mesh.source else "mesh"
            self.field = messages.FieldState(status="ready", origin="file", parts=self.editing.parts.ways)

    def begin(self, key: str = "") -> None:
        """Open the files in the options; without any, the kept edit `key`. Called when the first page connects."""
        try:
            if key and self.options.mesh is None and self.mesh is None:
                self.open_recent(key)
            else:
                self.open(self.options)
        finally:
            if self._preparation is None:
                self.attach()

    def open(self, given: Opening, key: str | None = None) -> None:
        """Open the files in `given`. Without a mesh, the field and the edit belong to the mesh that is already open.

        With `key`, continue this kept edit.

        Raises ValueError or OSError if a file cannot be read; the open shape then stays open.
        """
        for file in (given.mesh, given.field, given.edit):
            if isinstance(file, OpenedFile):
                self._names[str(file.path)] = file.name
        try:
            if given.mesh is not None:
                self._open_mesh(given, key)
            if given.field is not None:
                if self._preparation is None:
                    raise ValueError("Open a mesh before its field")
                if self._kept is not None:
                    self._kept.made_on = replace(self._kept.made_on, field=str(given.field.path))
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

    def _open_mesh(self, given: Opening, key: str | None) -> None:
        """Replace the open shape, and claim its kept edit. Without a given field, find or distill the shape's field."""
        source = given.mesh
        assert source is not None
        name = source.capitalize() if isinstance(source, str) else source.name
        self.tell_progress("open", "read")
        try:
            mesh, warnings = read_shape(source)
            message, arrays = mesh_message(mesh, name=name, warnings=warnings)
        except BaseException:
            self.tell_progress("open", "failed")
            raise
        self.tell_progress("open", "send")  # this stage ends when the page gets the mesh
        self.close_shape()
        self._claim(mesh, source, key)
        if self._kept is not None and self._kept.is_copy:
            warnings = [COPY, *warnings]
            message = message.model_copy(update={"warnings": tuple(warnings)})
        self.name, self.mesh, self._warnings = name, mesh, warnings
        self.send(message.model_copy(update={"recent": self._recent()}), **arrays)
        self._progress = None
        self._preparation = Preparation(self, mesh, source)
        if given.field is None:
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
        self.save()
        if self._kept is not None and self.deformer.handles and read != self.deformer.edit:
            self._kept.set_aside()
        self.change(lambda deformer: deformer.apply(read))

    def _claim(self, mesh: Mesh, source: Source, key: str | None) -> None:
        """Lock the kept edit of `mesh`. If the data folder cannot be used, say so, and keep nothing."""
        made_on = MadeOn(name=source) if isinstance(source, str) else MadeOn(str(source.path), name=source.name)
        try:
            self._kept = KeptEdit(mesh, made_on, uploads=self.folder, key=key)
        except OSError as error:
            self.fail(0, OSError(f"Your edit cannot be stored: {os.strerror(error.errno or 0)}"))

    def save(self) -> None:
        """Store the edit if it has changed since it was stored last, and tell the page."""
        if self._kept is not None and self.editing is not None and self._kept.save(self.deformer.edit):
            self.send(messages.SavedMessage(saved=True, key=self._kept.key))

    def detach(self) -> None:
        """Store the edit, and unlock it for other sessions, because the page has disconnected."""
        try:
            self.save()
        finally:
            if self._kept is not None:
                self._kept.release()

    def _resume(self) -> None:
        """Lock the kept edit again after `detach`. If another session has changed it meanwhile, take its edit over."""
        if self._kept is None:
            return
        found = self._kept.resume()
        if found is not None and self.editing is not None:
            self.deformer.apply(found)
            self._kept.begin(self.deformer.edit)
        if self._kept.is_copy and COPY not in self._warnings:
            self._warnings = [COPY, *self._warnings]

    def close_shape(self) -> None:
        """Store the edit, stop background work, and close the shape with its field, its edit and its files."""
        if self._preparation is not None:
            self._preparation.drop()
        self.guarded(0, self.detach)
        self._preparation = self._progress = self._pending_edit = self._kept = None
        self._fresh = False
        self.mesh = self.editing = None
        self.field = NO_FIELD
        while self._uploads:
            shutil.rmtree(self._uploads.pop(), ignore_errors=True)

    @request
    def open_sample(self, name: messages.Text) -> None:
        """Open one of the samples that the message `session` lists, without its kept edit, which stays in `recent`."""
        self.open(Opening(mesh=name))
        self._fresh = True

    @request
    def start_fresh(self) -> None:
        """Remove everything from the edit, as one step of undo. The edit so far stays in the list `recent`."""
        self.save()
        if self._kept is not None and self.deformer.handles:
            self._kept.set_aside()
        empty = Edit(preset=self.deformer.preset, symmetry=self.deformer.symmetry)
        self.change(lambda deformer: deformer.apply(empty))

    @request
    def keep_picture(self, picture: Annotated[str, Field(max_length=200_000, pattern=PICTURE)]) -> None:
        """Store a small picture of the open shape for the list `recent`: a data: URL."""
        if self._kept is not None:
            self._kept.keep_picture(picture)

    @request
    def change_kept(
        self,
        key: messages.Text,
        how: Literal["rename", "duplicate", "delete", "restore"],
        name: messages.Text | None = None,
    ) -> None:
        """Rename, copy or delete a kept edit, or bring it back. Before the answer, the server sends `start`.

        "rename" needs `name`. A deleted edit can be restored for an hour.
        """
        if how == "rename":
            rename_kept(key, name or key)
        else:
            {"duplicate": duplicate_kept, "delete": delete_kept, "restore": restore_kept}[how](key)
        if self.mesh is None:
            self._tell_start()

    @request
    def open_recent(self, key: messages.Text) -> None:
        """Open a shape of the list `recent`, which `start` and `mesh` contain, and continue its edit."""
        found = find_recent(key)
        sample = found.source if found.source in SAMPLES else None
        mesh = sample if found.mesh is None else OpenedFile(found.source, found.mesh, upload_folder(found.mesh))
        if mesh is None:
            raise ValueError(f"The file of {found.name} is gone. Open the mesh again: its edit is kept")
        field = None if found.field is None else OpenedFile(found.field.name, found.field)
        self.open(Opening(mesh, field), key)

    @request
    def close_mesh(self) -> None:
        """Close the shape and show the start page. The edit is kept."""
        self.close_shape()
        self._tell_start()

    def _tell_start(self) -> None:
        """Tell the page that no shape is open."""
        self.send(messages.StartMessage(recent=self._recent()))

    def _recent(self) -> tuple[messages.RecentShape, ...]:
        """Return the shapes that were edited last, without the open one."""
        here = None if self._kept is None else self._kept.key
        return tuple(
            messages.RecentShape(
                **{name: getattr(each, name) for name in ("key", "name", "handles", "seconds", "picture")},
                present=each.mesh is not None or each.source in SAMPLES,
            )
            for each in recent_edits(MOST_RECENT)
            if each.key != here
        )

    @request
    def distill(self) -> None:
        """Distill the shape's field in the background. The server sends `progress`, then `columns` and `state`."""
        if self._preparation is None:
            raise ValueError("Open a mesh first")
        if self.field.status != "none" and (self.field.origin != "geometry" or self._progress is not None):
            raise ValueError("The shape has a field, or one is being made")
        self._tell_field("distilling")
        self._preparation.start("distill", self._preparation.distill)

    @request
    def cancel(self) -> None:
        """Stop the distillation."""
        if self._preparation is not None:
            self._preparation.cancel()

    def tell_progress(self, task: Any, stage: str, share: float | None = None) -> None:
        """Send the stage of a task, and the `share` of the stage's items that are done.

        The last stage of a task is "done", "cancelled" or "failed".
        """
        ended, status = stage in ENDS, STATUS.get(task, self.field.status)
        if not ended and self.editing is None and self.field.status != status:
            self._tell_field(status)
        text = ENDS[stage] if ended else OTHERS[stage] if stage in OTHERS else STAGES[stage]
        message = messages.ProgressMessage(task=task, stage=stage, text=text, share=share)
        self._progress = None if ended else message
        self.send(message)

    def field_ready(
        self, deformer: Deformer, origin: str, warnings: list[Warning], planes: Mapping[Preset, Sequence[SymmetryPlane]]
    ) -> None:
        """Start editing, because the field is ready. `planes` has those of the session's preset."""
        self._edit_with(deformer, origin, planes)
        for warning in warnings:
            self.fail(0, warning)
        self.tell_progress("prepare", "done")
        self.find_planes()

    def planes_found(self, deformer: Deformer, planes: Mapping[Preset, Sequence[SymmetryPlane]]) -> None:
        """Store the planes of symmetry of further presets."""
        if self.editing is not None and self.editing.deformer is deformer:
            self.editing.planes = planes
            self.tell_state()

    def find_planes(self) -> None:
        """Find the planes of symmetry of the present preset in the background, unless they are known."""
        editing, preset = self.require(), self.deformer.preset
        if self._preparation is not None and editing.planes and preset not in editing.planes:
            editing.planes = {**editing.planes, preset: ()}
            self._preparation.start("prepare", self._preparation.find_planes, editing.deformer, preset)

    def begin_early(self, deformer: Deformer) -> None:
        """Start editing with a session that knows only the geometry, unless the features are learned."""
        if self.editing is None:
            self._edit_with(deformer, "geometry", {})

    def _edit_with(self, deformer: Deformer, origin: str, planes: Mapping[Preset, Sequence[SymmetryPlane]]) -> None:
        """Edit with `deformer`. It continues the edit and the history of the present session, or the kept edit.

        If nothing has been edited, switch on the best of the `planes` of symmetry.
        """
        before, self.editing = self.editing, Editing(deformer)
        self.editing.planes = planes
        self.field = messages.FieldState(status="ready", origin=origin, parts=self.editing.parts.ways)
        if before is None:
            self.guarded(0, self._restore)
        else:
            deformer.continue_from(before.deformer)
        best, untouched = planes.get(deformer.preset), deformer.edit == Edit(preset=deformer.preset)
        if best and untouched and not deformer.can_undo:
            deformer.set_symmetry(best[0], band=band_on(deformer.mesh, deformer.preset))
            self._begin_with(deformer.edit)
        pending_edit, self._pending_edit = self._pending_edit, None
        self.tell_state()
        if pending_edit is not None:
            self.guarded(0, lambda: self._open_edit(pending_edit))

    def _restore(self) -> None:
        """Start with the kept edit, if there is one; undo cannot go behind it."""
        fresh, self._fresh = self._fresh, False
        found = None if self._kept is None else self._kept.read()
        if fresh and found is not None and self._kept is not None:
            if found.handles and not self._kept.is_copy:
                self._kept.set_aside(move=True)
            found = None
        self._begin_with(found or self.deformer.edit)

    def _begin_with(self, edit: Edit) -> None:
        """Make `edit` the first state, which needs not be stored."""
        self.deformer.start_with(edit)
        self.require().history.begin()
        if self._kept is not None:
            self._kept.begin(edit)

    @request
    def suggest(self) -> None:
        """Suggest places for handles: a vertex far inside each of the largest parts. The server sends `suggestions`.

        They are found once for each shape, in the background.
        """
        editing = self.require()
        if editing.suggested is not None:
            self.send(messages.SuggestionsMessage(suggestions=editing.suggested))
        elif self._preparation is None:
            self.suggested(editing.deformer, editing.deformer.bound.parts.cut())
        elif not editing.suggesting:
            editing.suggesting = True
            self.tell_progress("suggest", "cut")
            self._preparation.start("suggest", self._preparation.cut, editing.deformer)

    def suggested(self, deformer: Deformer, found: Sequence[Part]) -> None:
        """Send the places in the parts that were found, and keep them."""
        editing = self.editing
        if editing is None or editing.deformer is not deformer:
            return
        editing.suggested = tuple(
            messages.Suggestion(
                vertex=part.vertex,
                position=vector("position", deformer.mesh.vertices[part.vertex]),
                name=f"Part {number}, {part.components} alike" if part.components > 1 else f"Part {number}",
            )
            for number, part in enumerate(found[:MOST_SUGGESTED], start=1)
        )
        if self._progress is not None and self._progress.task == "suggest":
            self.tell_progress("suggest", "done")
        self.send(messages.SuggestionsMessage(suggestions=editing.suggested))

    def field_ended(self, task: str, error: Exception | None) -> None:
        """Report that a task failed or was stopped before it gave a field. An existing field stays in use."""
        self.tell_progress(task, "cancelled" if error is None else "failed")
        if error is not None:
            self.fail(0, error)
        self._tell_field("none" if self.editing is None else "ready")

    def attach(self) -> None:
        """Send the whole state to a page that has just connected."""
        if self.mesh is None:
            self._tell_start()
            return
        self.guarded(0, self._resume)
        message, arrays = mesh_message(self.mesh, name=self.name, warnings=self._warnings)
        self.send(message.model_copy(update={"recent": self._recent()}), **arrays)
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
        self.find_planes()
        self.tell_state()

    @request
    def set_poses(self, poses: messages.KeyPoses) -> None:
        """Replace the key poses, as one step of undo."""
        found = (
            KeyPose(each.seconds, {own.handle: own.motion for own in each.transforms}, each.name, each.ease)
            for each in poses
        )
        self.change(lambda deformer: deformer.set_poses(found))

    def run_deferred(self) -> None:
        """Between requests, store a new edit, send its report, and send the exact weights of the latest probe.

        If Python code changed the edit, or a drag rests that has changed blend bands, send the state.
        """
        editing = self.editing
        if editing is None:
            return
        if editing.deformer.edit is not editing.shown or editing.has_stale_bands():
            self.tell_state()
        self.save()
        if editing.unreported:
            editing.unreported = False
            report = editing.deformer.report()
            text = summary(report, editing.deformer.edit)
            handles = zip(report.handles, editing.deformer.edit.handles, strict=True)
            steps = {each.id: editing.parts.text(each) for told, each in handles if told.step}
            self.send(messages.ReportMessage(text=text, details=details(report, steps)))
        if (probed := editing.exact_probe()) is not None:
            vertex, level, weights = probed
            self.send(messages.HeatMessage(vertex=vertex, level=level, exact=True), values=quantized(weights))

    def send(self, message: messages.Answer, **arrays: NDArray[Any]) -> None:
        """Send a message, with arrays if there are any."""
        self._send(messages.pack(message, **arrays) if arrays else message.model_dump_json())

    def tell_state(self) -> None:
        """Send the weights that the page does not have yet, then the present state."""
        if self.mesh is None:
            return
        common: Any = {"field": self.field, "after": self.after}
        if self.editing is None:
            self.send(messages.StateMessage(preset="default", poses=(), **common))
            return
        self.editing.shown, self.editing.unreported = self.editing.deformer.edit, True
        if self._kept is not None and self._kept.changed(self.editing.shown):
            self.send(messages.SavedMessage(saved=False, key=self._kept.key))
        columns, new = self.editing.columns()
        if new:
            self.send(messages.ColumnsMessage(columns=tuple(new)), values=np.stack(list(new.values())))
        self.send(self.editing.state(columns, **common))
        if self._kept is not None and self._kept.overdue:
            self.save()

    def _tell_field(self, status: str) -> None:
        self.field = self.field.model_copy(update={"status": status})
        self.tell_state()
