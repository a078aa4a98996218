"""One tab's work: its shape, its field, its edit, and what the page is told of them. Knows nothing of networks."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Hashable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from dfd.app.options import OpenedFile, SessionOptions, Source
from dfd.app.protocol.answers import Answer, FailureMessage, FieldState, ProgressMessage, StartMessage
from dfd.app.session.autosave import Autosave, Saved
from dfd.app.session.columns import Columns
from dfd.app.session.preparation import Preparation
from dfd.app.session.shapes import read_shape
from dfd.app.session.state import ViewState, check_drawable, report, state_message
from dfd.app.session.surface import mesh_messages
from dfd.editing.edit_file import read_edit

if TYPE_CHECKING:
    from dfd.app.protocol.parts import KeyPose
    from dfd.common.preset import Preset
    from dfd.editing.deformer import Deformer
    from dfd.editing.edit import Edit
    from dfd.mesh.mesh import Mesh
    from dfd.symmetry.plane import SymmetryPlane

__all__ = ["NO_MEMORY", "Session", "sentence", "without_paths"]

Result = TypeVar("Result")


class Session:
    """The work of one tab. All its methods are called on one thread.

    Parameters
    ----------
    folder
        Its own, for what it keeps and makes.
    options
        What it opens first, and how it makes fields.
    send
        Carries a message to the page, text or binary; what is sent while no page listens is lost.
    post
        Carries a call to the session's thread, from any other.
    lock
        A file that one distillation at a time holds.
    deformer
        An editing session that somebody else has begun, in this process.
    """

    def __init__(
        self,
        folder: Path,
        options: SessionOptions,
        send: Callable[[str | bytes], None],
        post: Callable[[Callable[[], None]], None],
        *,
        lock: Path | None = None,
        deformer: Deformer | None = None,
    ) -> None:
        self.folder = folder
        self.options = options
        self._send, self._post, self._lock = send, post, lock
        self._autosave = Autosave(folder)
        self._preparation: Preparation | None = None
        self._progress: ProgressMessage | None = None  # of what the page waits for
        self._number, self._warnings = 0, list[str]()
        self.after = 0  # the number of the newest request
        self._names: dict[str, str] = {}  # the names that people know opened files by, by their paths
        self._saved: Edit | None = None  # what is on disk
        self._shown: Edit | None = None  # what the page was told last
        self._ready = True  # whether instances can be found
        self._unreported = False  # whether the page lacks a report
        self._pending_edit: OpenedFile | None = None  # opened as soon as the field is there
        self.source: Source | None = None
        self.mesh: Mesh | None = None
        self.view_state = ViewState()
        self.deformer: Deformer | None = None
        self.columns: Columns | None = None
        if deformer is not None:
            self._number, self.mesh = 1, deformer.mesh
            self.source = Source(name=deformer.mesh.source.name if deformer.mesh.source else "mesh")
            self.field_ready(deformer, None, "file", [])

    @property
    def name(self) -> str:
        """What people call the shape."""
        return "mesh" if self.source is None else self.source.name

    # --- opening

    def begin(self) -> None:
        """Go on where a session in the same folder ended, or open what new ones open."""
        if self.mesh is not None:
            self.attach()
            return
        saved = self._autosave.saved()
        if saved is None and self.options.mesh is not None:
            self._open_or_start(self.options.mesh, self.options.field, self.options.edit)
        elif saved is None or saved.source is None:
            self.attach()
        else:
            edit = OpenedFile(name="the saved edit", path=self._autosave.edit)
            self._open_or_start(saved.source, saved.field, edit if edit.path.exists() else None)
            self.view_state.poses = self._autosave.poses()
            self.tell_state()

    def _open_or_start(self, source: Source, field: OpenedFile | None, edit: OpenedFile | None) -> None:
        try:
            self.open_shape(source, field=field, edit=edit)
        except BaseException:
            self.attach()  # to the start page
            raise

    def open_shape(self, source: Source, *, field: OpenedFile | None = None, edit: OpenedFile | None = None) -> None:
        """Show another shape; what was open is lost, unless this one cannot be read.

        Raises
        ------
        ValueError, OSError
            As `dfd.load` does.
        """
        if source.path is not None:
            self._names[str(source.path)] = source.name
        self._tell_progress("open", "read")
        try:
            mesh, told = read_shape(source)
            messages = mesh_messages(mesh, number=self._number + 1, name=source.name, warnings=told)
            first = next(messages)
        finally:
            self._tell_progress("open", "done")
        self.close_shape()
        self._number += 1
        self.source, self.mesh, self._warnings, self._pending_edit = source, mesh, told, edit
        self._autosave.save_opened(Saved(source=source, field=field))
        self._send(first)
        self._preparation = Preparation(mesh, source, self.options, self.folder, self._lock, self, self._post)
        self._tell_field("preparing")
        if field is None:
            self._preparation.look()
        else:
            self._names[str(field.path)] = field.name
            self._preparation.open(field.path, "file")
        for message in messages:
            self._send(message)

    def close_shape(self) -> None:
        """Let go of the shape and everything about it."""
        if self._preparation is not None:
            self._preparation.drop()
        self._preparation = self._progress = self._saved = self._shown = self._pending_edit = None
        self.source = self.mesh = self.deformer = self.columns = None
        self.view_state, self._unreported = ViewState(), False

    def show_start(self) -> None:
        """Close the shape and go back to the start page."""
        self.close_shape()
        self._autosave.save_opened(Saved())
        self.send(StartMessage())

    def open_files(self, mesh: Source | None, field: OpenedFile | None, edit: OpenedFile | None) -> None:
        """Open what was uploaded together: a mesh with its field and edit, or those for the mesh that is open."""
        if mesh is not None:
            self.open_shape(mesh, field=field, edit=edit)
            return
        if field is not None:
            self.open_field(field)
        if edit is not None:
            self.open_edit(edit)

    def open_field(self, field: OpenedFile) -> None:
        """Take the field in a file."""
        if self._preparation is None:
            raise ValueError("Open a mesh before its field")
        self._names[str(field.path)] = field.name
        self._preparation.cancel()
        self._tell_field("preparing")
        self._preparation.open(field.path, "file")

    def open_edit(self, edit: OpenedFile) -> None:
        """Take the edit in a file, as one step, once the field is there."""
        if self.mesh is None:
            raise ValueError("Open a mesh before its edit")
        self._names[str(edit.path)] = edit.name
        if self.deformer is None:
            self._pending_edit = edit
            return
        read = read_edit(edit.path, self.mesh)
        self.change(lambda deformer: deformer.apply(read))

    def distill(self) -> None:
        """Begin to make the field."""
        if self._preparation is None:
            raise ValueError("Open a mesh first")
        if self.view_state.field.status != "none":
            raise ValueError("The shape has a field, or one is being made")
        self._tell_field("distilling")
        self._preparation.distill()

    def cancel(self) -> None:
        """Stop making the field."""
        if self._preparation is not None:
            self._preparation.cancel()

    # --- what the background says

    def field_missing(self) -> None:
        """Neither a file nor the cache has a field: make it."""
        self._tell_field("none")
        self.distill()

    def field_progress(self, task: str, stage: str, done: int, total: int | None, seconds_left: float | None) -> None:
        """How far it is."""
        if task == "prepare" and self.view_state.field.status == "distilling":
            self._tell_field("preparing")
        self._tell_progress(task, stage, done, total, seconds_left)

    def field_ready(self, deformer: Deformer, path: Path | None, origin: str, told: list[str]) -> None:
        """The shape can be edited."""
        self.deformer, self.columns = deformer, Columns(deformer)
        self._ready = path is None
        if path is not None:
            self._autosave.save_opened(Saved(source=self.source, field=OpenedFile(name="field", path=path)))
        self.view_state.field = FieldState(status="ready", origin=origin)
        self._tell_progress("prepare", "done")
        for warning in told:
            self.fail(0, warning)
        wanted, self._pending_edit = self._pending_edit, None
        self.tell_state()
        if wanted is not None:
            self.guarded(0, lambda: self.open_edit(wanted))

    def field_planes(self, planes: dict[Preset, list[SymmetryPlane]]) -> None:
        """The planes across which the shape looks alike, by each preset's rules; now instances can be found, too."""
        self.view_state.planes = planes
        self._ready = True
        self.tell_state()

    def field_failed(self, task: str, message: str) -> None:
        """There will be none; the shape can still be looked at, and an earlier field stays."""
        self._ready = True
        self._tell_progress(task, "failed")
        self.fail(0, message)
        self._tell_field("none" if self.deformer is None else "ready")

    def field_cancelled(self) -> None:
        """The distillation was stopped."""
        self._tell_progress("distill", "cancelled")
        self._tell_field("none" if self.deformer is None else "ready")

    # --- what the page says

    def attach(self) -> None:
        """Tell a page that has just come everything there is."""
        if self.mesh is None or self.source is None:
            self.send(StartMessage())
            return
        for message in mesh_messages(self.mesh, number=self._number, name=self.name, warnings=self._warnings):
            self._send(message)
        if self.columns is not None:
            self.columns.forget()
        self.after = 0
        self.tell_state()
        if self._progress is not None:
            self.send(self._progress)
        self._report()

    def guarded(self, number: int, work: Callable[[], None]) -> None:
        """Do `work`; an exception becomes a `failure` that answers request `number`."""
        try:
            work()
        except Exception as error:
            self.fail(number, sentence(error))

    def fail(self, number: int, why: str) -> None:
        """Say that request `number` was not done, without the places of files on this machine."""
        self.send(FailureMessage(id=number, message=without_paths(why, self._names, self.folder)))

    def require_deformer(self) -> Deformer:
        """The editing session; raises ValueError if there is none yet."""
        if self.deformer is None:
            raise ValueError("Open a mesh first" if self.mesh is None else "The shape has no field yet: wait for it")
        return self.deformer

    def change(self, work: Callable[[Deformer], Result], topic: Hashable = None, *, merge: bool = False) -> Result:
        """Change the edit and tell the page what came of it; where that fails, nothing was changed.

        With `merge` it is one step with the newest one, where that was about the same `topic`.
        """
        deformer = self.require_deformer()
        assert self.columns is not None
        with deformer.step(topic, merge=merge):
            result = work(deformer)
            check_drawable(deformer)
            columns = self.columns.message()
            did = None if self.columns.has_pending else report(deformer)
        if columns is not None:
            self._send(columns)
        self.tell_state()
        if did is not None:
            self.send(did)
        return result

    def note_shown(self) -> None:
        """Note that the page has drawn the present edit itself."""
        self._shown = self.require_deformer().edit

    # --- telling

    def send(self, message: Answer | bytes) -> None:
        """Send a message, with arrays where it is packed already."""
        self._send(message if isinstance(message, bytes) else message.model_dump_json())

    def tell_state(self) -> None:
        """Tell the page the present state, and first the columns that it lacks."""
        if self.mesh is None:
            return
        if self.deformer is None or self.columns is None:
            self.send(state_message(self.view_state, after=self.after))
            return
        columns = self.columns.message()
        if columns is not None:
            self._send(columns)
        self._shown = self.deformer.edit
        self.send(state_message(self.view_state, self.deformer, self.columns, after=self.after))
        self._unreported = self._unreported or self.columns.has_pending

    @property
    def has_pending_columns(self) -> bool:
        """Whether there are instances to send, which the page needs less urgently than the columns themselves."""
        return self._ready and self.columns is not None and self.columns.has_pending

    def send_pending_columns(self) -> None:
        """Send the instances of one handle; not of all, so that the next click does not wait for all."""
        instances = None if self.columns is None else self.columns.instances_message()
        if instances is not None:
            self._send(instances)

    def tell_all(self) -> None:
        """Tell the page the present state and what the edit does."""
        self.tell_state()
        self._report()

    def _report(self) -> None:
        """Tell the page what the edit does, unless instances must be found first."""
        if self.deformer is not None and self.columns is not None and not self.columns.has_pending:
            self._unreported = False
            self.send(report(self.deformer))

    def set_poses(self, poses: tuple[KeyPose, ...]) -> None:
        """Take and save the key poses."""
        self.view_state.poses = poses
        self._autosave.save_poses(poses)
        self.tell_state()

    def rest(self) -> None:
        """Use a pause: report, save, and tell the page of an edit that was changed from outside."""
        if self.deformer is None or self.mesh is None:
            return
        edit = self.deformer.edit
        if edit is not self._shown:
            self.tell_all()
        elif self._unreported:
            self._report()
        if edit is not self._saved:
            self._autosave.save_edit(edit, self.mesh)
            self._saved = edit

    def end(self) -> None:
        """Save, and stop background work."""
        self.rest()
        if self._preparation is not None:
            self._preparation.drop()

    def _tell_field(self, status: str) -> None:
        self.view_state.field = self.view_state.field.model_copy(update={"status": status})
        self.tell_state()

    def _tell_progress(
        self, task: Any, stage: str, done: int = 0, total: int | None = None, seconds_left: float | None = None
    ) -> None:
        message = ProgressMessage(task=task, stage=stage, done=done, total=total, seconds_left=seconds_left)
        self._progress = None if stage in ("done", "failed", "cancelled") else message
        self.send(message)


log = logging.getLogger("dfd.app")

# What the package's own messages begin with, for those who call its functions.
_FUNCTION = re.compile(r"^\w+(\.\w+)?: ")

NO_MEMORY = "Memory ran out; nothing was changed. Take a smaller mesh, or close other programs"


def sentence(error: Exception) -> str:
    """Why a request was not done; unexpected exceptions are logged as well."""
    if isinstance(error, MemoryError) or "can't allocate memory" in str(error):  # as torch says it
        return NO_MEMORY
    if isinstance(error, (ValueError, OSError)):
        return str(error)
    log.error("a request failed", exc_info=error)
    return f"That did not work, for a fault of this program: {type(error).__name__}: {error}"


def without_paths(why: str, names: Mapping[str, str], folder: Path) -> str:
    """`why` without the session's `folder`, and with files by the `names` that people know them by."""
    for path, name in names.items():
        why = why.replace(f"`path` {path}", name).replace(path, name)
    return _FUNCTION.sub("", why.replace(f"{folder}/", ""))
