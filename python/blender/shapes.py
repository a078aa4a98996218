"""A mesh of Blender with its features: what is computed once per shape, and the weights that come of it.

It imports nothing of Blender's, and of dfd what needs neither torch nor pydantic.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np

import dfd
from dfd.common.preset import Preset
from dfd.editing.edit import Edit
from dfd.editing.influence.handle_weights import HandleWeights
from dfd.editing.verbs import add
from dfd.field.compatibility import check_compatible

Axes = Literal["AUTO", "SAME", "Y_UP"]

SAME_BOX = 1e-3  # of the longest side: boxes of one shape, once simplified, differ by less


class Shape:
    """A mesh and the field that was distilled from it.

    `vertices` (V, 3) are in the object's own coordinates, `field` is the path of a `.field.safetensors`. `axes` says
    how the field's coordinates lie: "SAME" as the object's, "Y_UP" as those of a glTF file, which Blender turns by a
    quarter when it imports one, or "AUTO" for whichever of the two the field's shape fits better.

    Raises ValueError if the field cannot be read, or is that of a shape of another size or place. Raises OSError if
    there is no such file.
    """

    def __init__(self, vertices: np.ndarray, triangles: np.ndarray, field: Path, axes: Axes) -> None:
        self.field = dfd.Field.load(field)
        mesh = dfd.Mesh(vertices, triangles)
        self.axes: Axes = ("Y_UP" if _fits_turned(self.field, mesh) else "SAME") if axes == "AUTO" else axes
        self.mesh = dfd.Mesh(_turned(vertices), triangles) if self.axes == "Y_UP" else mesh
        check_compatible(self.field, self.mesh)
        self._weights = HandleWeights(self.mesh, self.field)

    def weights(self, vertex: int, preset: Preset = "default", **controls: Any) -> np.ndarray:
        """Weights (V,) float32 in [0, 1] of all vertices for a handle at `vertex`, as a session of dfd has them.

        Raises ValueError if `vertex` is none of the mesh, or a control is out of its range.
        """
        edit = add(Edit(preset=preset), self._weights, 1, vertex, name=None, **controls)
        return self._weights.by_features.of(edit)[0][:, 0]

    def parts(self) -> list[np.ndarray]:
        """(N,) vertices of each part that the shape is cut into, see `dfd.parts`."""
        return [part.vertices for part in self._weights.grips.parts.cut()]


def _turned(vertices: np.ndarray) -> np.ndarray:
    """What was (x, −z, y) in Blender is (x, y, z) in the file."""
    return np.stack([vertices[:, 0], vertices[:, 2], -vertices[:, 1]], axis=1)


def _miss(field: dfd.Field, mesh: dfd.Mesh) -> float:
    """How far the mesh's box is from the one that the field knows, of the field's half longest side."""
    low, high = (np.asarray(mesh.bounds) - field.center) * field.scale
    return float(max(np.abs(low + high).max() / 2, abs((high - low).max() / 2 - 1)))


def _fits_turned(field: dfd.Field, mesh: dfd.Mesh) -> bool:
    """Whether the mesh lies as the field's shape does once it is turned; in doubt it does, as files have y up."""
    same, turned = _miss(field, mesh), _miss(field, dfd.Mesh(_turned(mesh.vertices), mesh.faces))
    return turned <= same + SAME_BOX
