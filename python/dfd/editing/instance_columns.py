"""Columns to pose with: one for each handle, or one for each instance of what it holds."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dfd.editing.edit import Edit, Handle
from dfd.editing.instances import Instance, InstanceFinder
from dfd.posing.transforms import Vector
from dfd.symmetry.search import symmetry_planes
from dfd.weights.bind import bind

if TYPE_CHECKING:
    from dfd.editing.vertex_rows import VertexRows
    from dfd.field.field import Field
    from dfd.mesh.mesh import Mesh
    from dfd.symmetry.plane import SymmetryPlane

__all__ = ["Column", "InstanceColumns"]

Float32 = NDArray[np.float32]


class Column(NamedTuple):
    """What a column of weights belongs to."""

    handle: int  # which of the edit's handles
    instance: Instance | None  # None where the handle's transform acts as it is

    def matrix(self, handle: Handle) -> NDArray[np.float64]:
        """The (3, 4) transform of the column, mesh units: the handle's own, carried into the instance's frame."""
        if self.instance is None:
            return handle.matrix
        return self.instance.transform(handle.matrix, handle.place.position)

    def vertex(self, anchor: int) -> int:
        """The vertex where it is held; `anchor` is that of the handle."""
        return anchor if self.instance is None else self.instance.vertex

    def position(self, handle: Handle) -> Vector:
        """(3,) where what it holds is, mesh units: it tells its side of a plane of symmetry."""
        return handle.place.position if self.instance is None else self.instance.position


class InstanceColumns:
    """The columns of one mesh, kept as long as what they depend on stays."""

    def __init__(self, mesh: Mesh, field: Field) -> None:
        self._mesh = mesh
        self._field = field
        self._finder = InstanceFinder(mesh)
        self._found: dict[Hashable, tuple[Instance, ...]] = {}
        self._key: Hashable = None
        self._made: tuple[Float32, tuple[Column, ...]] | None = None

    @property
    def finder(self) -> InstanceFinder:
        """What finds instances on the mesh."""
        return self._finder

    def prepare(self, planes: Sequence[SymmetryPlane]) -> None:
        """Have ready what the first handle would wait for; `planes` are those that `symmetry_planes` finds."""
        self._planes = list(planes)
        self._finder.prepare()

    def of(
        self, edit: Edit, weights: Float32, keys: Sequence[Hashable], rows: VertexRows
    ) -> tuple[Float32, tuple[Column, ...]]:
        """(V, C) weights to pose with, and what each column is of.

        `weights` (V, H) are those of the handles, `keys` (H) all that these depend on but for the fixed points.
        """
        if all(handle.controls.instances == "together" and not handle.controls.level for handle in edit.handles):
            return weights, tuple(Column(i, None) for i in range(len(edit.handles)))
        about = (edit.fixed, edit.arrive, edit.symmetry)
        wanted = [(handle.controls.instances, handle.controls.level) for handle in edit.handles]
        key = (about, tuple(zip(keys, wanted, strict=True)))
        if self._made is None or key != self._key:
            found: dict[Hashable, tuple[Instance, ...]] = {}
            parts: list[Float32] = []
            columns: list[Column] = []
            for i, handle in enumerate(edit.handles):
                instances: tuple[Instance, ...] = ()
                if wanted[i] != ("together", False):
                    instances = self._instances(handle, rows, edit.symmetry)
                    found[handle.place, edit.symmetry] = instances
                for part, instance in _columns(handle, weights[:, i], instances):
                    parts.append(part)
                    columns.append(Column(i, instance))
            self._found = found
            self._made, self._key = (np.stack(parts).T, tuple(columns)), key
        return self._made

    def _instances(self, handle: Handle, rows: VertexRows, symmetry: SymmetryPlane | None) -> tuple[Instance, ...]:
        """The instances of what a handle holds, by looks alone, mirrored across planes that were chosen or found."""
        key = (handle.place, symmetry)
        if key in self._found:
            return self._found[key]
        looks: Float32 = bind(rows.features, rows.points([handle.place]))[:, 0]
        planes = self._planes if symmetry is None else [symmetry]
        return self._finder.find(looks, rows.anchor(handle.place), handle.place.position, planes=planes)

    @cached_property
    def _planes(self) -> list[SymmetryPlane]:
        return symmetry_planes(self._field, self._mesh)


def _columns(handle: Handle, weights: Float32, instances: Sequence[Instance]) -> list[tuple[Float32, Instance | None]]:
    """The columns of one handle."""
    controls = handle.controls
    if not instances:
        return [(weights, None)]
    parts = [
        _leveled(weights if one.share is None else weights * one.share, weights[one.vertex] if controls.level else 1.0)
        for one in instances
    ]
    if controls.instances == "only":
        return [(parts[0], instances[0])]
    if controls.instances == "own":
        return list(zip(parts, instances, strict=True))
    return [(np.minimum(np.sum(parts, axis=0), np.float32(1.0)), None)]


def _leveled(weights: Float32, top: float) -> Float32:
    """Weights that are 1 where they were `top`."""
    leveled: Float32 = np.minimum(weights / np.float32(top), np.float32(1.0)) if top > 0 else weights
    return leveled
