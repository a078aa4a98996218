"""Saves a session to disk (shape, field, edit, poses), to restore it after a reload, a crash or idle time."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import BaseModel, ConfigDict, TypeAdapter

from dfd.app.options import OpenedFile, Source
from dfd.app.protocol.parts import KeyPose
from dfd.common.files import atomic_write
from dfd.editing.edit_file import write_edit

if TYPE_CHECKING:
    from dfd.editing.edit import Edit
    from dfd.mesh.mesh import Mesh

_POSES: TypeAdapter[tuple[KeyPose, ...]] = TypeAdapter(tuple[KeyPose, ...])


class Saved(BaseModel):
    """What was open; with `source` None, the start page."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    version: int = 1
    source: Source | None = None
    field: OpenedFile | None = None


class Autosave:
    """The saved files of one session."""

    def __init__(self, folder: Path) -> None:
        self._manifest = folder / "session.json"
        self.edit = folder / "edit.json"
        self._poses = folder / "poses.json"

    def saved(self) -> Saved | None:
        """What was open when the session ended; None if there is no readable file."""
        try:
            return Saved.model_validate_json(self._manifest.read_bytes())
        except (OSError, ValueError):
            return None

    def save_opened(self, saved: Saved) -> None:
        """Save what is open; for another shape, delete the saved edit and poses."""
        before = self.saved()
        if before is None or before.source != saved.source:
            self.edit.unlink(missing_ok=True)
            self._poses.unlink(missing_ok=True)
        with atomic_write(self._manifest) as temporary:
            temporary.write_text(saved.model_dump_json())

    def save_edit(self, edit: Edit, mesh: Mesh) -> None:
        """Write the edit."""
        write_edit(self.edit, edit, mesh)

    def save_poses(self, poses: tuple[KeyPose, ...]) -> None:
        """Write the key poses."""
        with atomic_write(self._poses) as temporary:
            temporary.write_bytes(_POSES.dump_json(poses))

    def poses(self) -> tuple[KeyPose, ...]:
        """The saved key poses; empty if there is no readable file."""
        try:
            return _POSES.validate_json(self._poses.read_bytes())
        except (OSError, ValueError):
            return ()
