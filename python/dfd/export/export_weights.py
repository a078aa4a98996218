"""Export the weights of a session as plain arrays, with the names of the handles and the settings."""

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
from safetensors.numpy import save as save_safetensors

from dfd.common import check
from dfd.common.errors import ArgumentError
from dfd.common.files import atomic_write
from dfd.editing.deformer import Deformer
from dfd.editing.edit_file import to_document
from dfd.editing.shape import blend_of, resting
from dfd.mesh.file.text import UniqueNames

ENDINGS = (".npz", ".safetensors")
FORMAT = "dfd-weights"
VERSION = 1


def export_weights(session: Deformer, path: str | os.PathLike[str]) -> None:
    """Write the weights of a session as arrays, with everything that `dfd.pose` needs to compute the posed shape.

    Raises ValueError if the file ending is not supported, or the session has no handle. Raises OSError if the file
    cannot be written; an existing file stays unchanged.

    Parameters
    ----------
    session
        The shape with its handles.
    path
        An .npz or .safetensors file. `vertices` (V, 3) float64 is the resting shape with bends and twists. `weights`
        (V, C) float32 has a column for each counterpart of each handle. `transforms` (C, 3, 4) float64 in mesh units,
        `handles` (C, 3), the positions, and `handle_ids` (C,) belong to these columns. `pivots` and `rotations`
        (C + 1, 3) are those of `dfd.pose`. `faces` is (F, 3), and `default` (3, 4) is D₀. The texts are `format`,
        `version`, `names` (JSON, for each column), `edit` (JSON of an edit file), `field` (JSON of settings) and `mesh`
        (the mesh's `content_hash`). In safetensors, they are metadata.
    """
    ending = check.ending("export_weights", "path", path, ENDINGS)
    target, edit, mesh = Path(path), session.edit, session.mesh
    if not edit.handles:
        raise ArgumentError("session", "must have a handle, got none: there would be no weights", "export_weights")
    weights, columns = session.bound.columns(edit)
    rest, held = resting(session.bound, edit), [edit.handles[column.handle] for column in columns]
    blend = blend_of(mesh, edit, weights, columns, rest)
    names = UniqueNames()  # further counterparts get the handle's name and a number
    arrays: dict[str, np.ndarray[Any, Any]] = {
        "vertices": rest.copy(),
        "faces": mesh.faces.copy(),
        "weights": np.ascontiguousarray(weights, np.float32),
        "transforms": blend["transforms"],
        "handles": blend["handles"],
        "pivots": blend["pivots"],
        "rotations": blend["rotations"],
        "handle_ids": np.array([handle.id for handle in held], np.int64),
        "default": np.eye(3, 4) if blend["default"] is None else np.ascontiguousarray(blend["default"]),
    }
    texts = {
        "format": FORMAT,
        "version": str(VERSION),
        "edit": json.dumps(to_document(edit, mesh)),
        "field": json.dumps(session.field.settings, default=str),
        "mesh": mesh.content_hash,
        "names": json.dumps([names.unique(handle.name or f"handle {handle.id}") for handle in held]),
    }
    with atomic_write(target) as temporary, temporary.open("wb") as stream:
        if ending == ".safetensors":
            stream.write(save_safetensors(arrays, metadata=texts))
        else:
            np.savez_compressed(stream, **arrays, **{name: np.array(text) for name, text in texts.items()})  # type: ignore[arg-type]
