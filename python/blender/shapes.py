"""Compute the weights, parts and poses of a mesh from its field. Data that all handles share is computed once.

The module does not import bpy or torch. Only edit files need pydantic.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

import dfd
from dfd.common.preset import Preset
from dfd.editing.edit import Edit
from dfd.editing.shape import PosedShape
from dfd.editing.verbs import add, change
from dfd.editing.weights.of_handles import check_targets, weights_of
from dfd.editing.weights.session_weights import SessionWeights
from dfd.export.key_poses import checked_poses, posed_edit
from dfd.field.compatibility import check_compatible

Axes = Literal["AUTO", "SAME", "Y_UP"]


@dataclass(frozen=True)
class Applied:
    """An edit on a mesh: the weights (V,) of each handle by its id, and the posed vertices (V, 3).

    `poses` has the time in seconds, the name and the posed vertices of each key pose.
    """

    weights: dict[int, np.ndarray]
    vertices: np.ndarray
    poses: list[tuple[float, str, np.ndarray]]


SAME_BOX = 1e-3  # two values of `_box_difference` count as equal up to this; simplifying a mesh changes its box


class Shape:
    """A mesh and the field that was distilled from it.

    `vertices` (V, 3) are in the object's own coordinates, and `field` is the path of a `.field.safetensors` file.
    `axes` are the axes of the field. "SAME" means the object's axes. "Y_UP" means the axes of a glTF file, which
    Blender rotates by 90 degrees during import. "AUTO" selects the axes that fit the field's bounding box better.

    Raises ValueError if the field is invalid or of another shape. Raises OSError if the file cannot be read.
    """

    def __init__(self, vertices: np.ndarray, triangles: np.ndarray, field: Path, axes: Axes) -> None:
        self.field = dfd.Field.load(field)
        mesh = dfd.Mesh(vertices, triangles)
        self.axes: Axes = ("Y_UP" if _fits_y_up(self.field, mesh) else "SAME") if axes == "AUTO" else axes
        self.mesh = dfd.Mesh(_y_up(vertices), triangles) if self.axes == "Y_UP" else mesh
        check_compatible(self.field, self.mesh)
        self._weights = SessionWeights(self.mesh, self.field)

    def weights(self, vertex: int, preset: Preset = "default", **controls: Any) -> np.ndarray:
        """Return the weights (V,) float32 in [0, 1] of all vertices for a handle at `vertex`, as in a session of dfd.

        Raises ValueError if `vertex` is not in the mesh, or a control is out of its range.
        """
        edit = add(Edit(preset=preset), self._weights, 1, vertex, name=None, **controls)
        return weights_of(self._weights, edit)[:, 0]

    def read(self, path: Path) -> tuple[Edit, str]:
        """Return the edit in the file `path`, on this mesh, and the text of an edit file from which `edit` reads it.

        Raises OSError if the file cannot be read, and ValueError if it has no edit or an edit of another shape.
        """
        from dfd.editing.edit_file import read_edit, to_document

        edit = read_edit(path, self.mesh)
        return edit, json.dumps(to_document(edit, self.mesh))

    def edit(self, document: str, controls: Mapping[int, Mapping[str, Any]], preset: Preset) -> Edit:
        """Return the edit in the text of an edit file, with other `controls`, by handle id, and another preset.

        Handles without an item in `controls` are removed. Raises ValueError if a control is out of its range.
        """
        from dfd.editing.edit_file import from_document

        edit = replace(from_document(json.loads(document), self.mesh), preset=preset)
        for handle in edit.handles:
            if handle.id in controls:
                edit = change(edit, self._weights, handle.id, None, None, controls[handle.id])
            else:
                edit = edit.removed(handle.id)
        return edit

    def applied(self, edit: Edit) -> Applied:
        """Return the weights and the posed vertices of `edit` and of its key poses, in the object's own coordinates.

        Raises ValueError if two key poses have one time, or fixed points take all weight from a handle.
        """
        if edit.fixed:
            check_targets(self._weights, edit)
        poses, posed = checked_poses("Shape.applied", edit.poses, edit), PosedShape(self._weights)
        weights = weights_of(self._weights, edit)
        return Applied(
            {handle.id: weights[:, column] for column, handle in enumerate(edit.handles)},
            self._in_object(posed.of(edit)),
            [(pose.seconds, pose.name, self._in_object(posed.of(posed_edit(edit, pose)))) for pose in poses],
        )

    def nearest_vertex(self, position: Any) -> int:
        """Return the vertex that is nearest to a position (3,) in the axes of the field."""
        return int(np.square(self.mesh.vertices - np.asarray(position)).sum(axis=1).argmin())

    def _in_object(self, vertices: np.ndarray) -> np.ndarray:
        """Return vertices (V, 3) in the object's coordinates: (x, −z, y) for (x, y, z) in the axes of a glTF file."""
        turned = self.axes == "Y_UP"
        return np.stack([vertices[:, 0], -vertices[:, 2], vertices[:, 1]], axis=1) if turned else vertices

    def parts(self) -> list[np.ndarray]:
        """Return the vertices (N,) of each part of the shape, as `dfd.parts` finds them."""
        return [part.vertices for part in self._weights.parts.cut()]


def _y_up(vertices: np.ndarray) -> np.ndarray:
    """Return vertices (V, 3) in the axes of a glTF file: (x, z, −y) for the vertex (x, y, z) in Blender."""
    return np.stack([vertices[:, 0], vertices[:, 2], -vertices[:, 1]], axis=1)


def _box_difference(field: dfd.Field, mesh: dfd.Mesh) -> float:
    """Return how much the boxes of mesh and field differ, as a fraction of half the longest side of the field's box."""
    low, high = (np.asarray(mesh.bounds) - field.center) * field.scale
    return float(max(np.abs(low + high).max() / 2, abs((high - low).max() / 2 - 1)))


def _fits_y_up(field: dfd.Field, mesh: dfd.Mesh) -> bool:
    """Return whether the mesh, turned to y up, fits the field's box at least as well as the unchanged mesh."""
    same, turned = _box_difference(field, mesh), _box_difference(field, dfd.Mesh(_y_up(mesh.vertices), mesh.faces))
    return turned <= same + SAME_BOX
