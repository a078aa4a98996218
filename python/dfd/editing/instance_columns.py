"""Columns to pose with: one for each handle, or one for each instance of what it holds."""

from __future__ import annotations

import importlib
from collections.abc import Hashable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from dfd.editing.edit import Edit, Handle

if TYPE_CHECKING:
    from dfd.editing.vertex_rows import VertexRows
    from dfd.mesh.mesh import Mesh
    from dfd.symmetry.plane import SymmetryPlane

__all__ = ["Column", "Instance", "InstanceColumns"]

Float32 = NDArray[np.float32]


class Instance(Protocol):
    """One of several alike places of a shape, as `dfd.editing.instances` finds them; the handle's own is the first."""

    @property
    def vertex(self) -> int:
        """The vertex there that is the handle's counterpart."""

    @property
    def pivot(self) -> NDArray[np.float64]:
        """(3,) about which it turns, mesh units."""

    @property
    def frame(self) -> NDArray[np.float64]:
        """(3, 3) rotation or reflection that turns the handle's frame into its own."""

    @property
    def share(self) -> Float32:
        """(V,) its share of the handle's weight."""


class Column(NamedTuple):
    """What a column of weights belongs to."""

    handle: int  # which of the edit's handles
    instance: Instance | None  # None where the handle's transform acts as it is

    def matrix(self, handle: Handle, mesh: Mesh) -> NDArray[np.float64]:
        """The (3, 4) transform of the column, mesh units: the handle's own, carried into the instance's frame."""
        if self.instance is None:
            return handle.matrix
        frame, transform = np.asarray(self.instance.frame, np.float64), handle.transform
        pivot = np.asarray(self.instance.pivot, np.float64)
        if transform.pivot is not None:  # it lies from the counterpart as the handle's own lies from the handle
            offset = np.subtract(transform.pivot, handle.place.position)
            pivot = mesh.vertices[self.instance.vertex] + frame @ offset
        linear = frame @ transform.linear @ frame.T
        return np.column_stack([linear, pivot + frame @ np.asarray(transform.translation) - linear @ pivot])

    def vertex(self, anchor: int) -> int:
        """The vertex where it is held; `anchor` is that of the handle."""
        return anchor if self.instance is None else self.instance.vertex

    def position(self, handle: Handle, mesh: Mesh) -> NDArray[np.float64]:
        """(3,) where what it holds is, mesh units: it tells its side of a plane of symmetry."""
        at = handle.place.position if self.instance is None else mesh.vertices[self.instance.vertex]
        return np.asarray(at, np.float64)


class InstanceColumns:
    """The columns of one mesh, kept as long as what they depend on stays."""

    def __init__(self, mesh: Mesh) -> None:
        self._mesh = mesh
        self._found: dict[Hashable, list[Instance]] = {}
        self._key: Hashable = None
        self._made: tuple[Float32, tuple[Column, ...]] | None = None

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
            found: dict[Hashable, list[Instance]] = {}
            parts: list[Float32] = []
            columns: list[Column] = []
            for i, handle in enumerate(edit.handles):
                if wanted[i] == ("together", False):
                    instances = []
                else:
                    instances = self._instances((about, keys[i]), handle, weights[:, i], rows, edit.symmetry)
                    found[about, keys[i]] = instances
                for part, instance in _columns(handle, weights[:, i], instances):
                    parts.append(part)
                    columns.append(Column(i, instance))
            self._found = found
            self._made, self._key = (np.stack(parts).T, tuple(columns)), key
        return self._made

    def _instances(
        self, key: Hashable, handle: Handle, weights: Float32, rows: VertexRows, symmetry: SymmetryPlane | None
    ) -> list[Instance]:
        if key in self._found:
            return self._found[key]
        find: Any = importlib.import_module("dfd.editing.instances").find_instances
        found: list[Instance] = find(self._mesh, rows.features, rows.anchor(handle.place), weights, symmetry=symmetry)
        if not found:
            raise ValueError(f"`instances` of handle {handle.id} at {handle.place} cannot be told apart: there is none")
        return found


def _columns(handle: Handle, weights: Float32, instances: Sequence[Instance]) -> list[tuple[Float32, Instance | None]]:
    """The columns of one handle."""
    controls = handle.controls
    if not instances:
        return [(weights, None)]
    parts = [_leveled(weights * one.share, weights[one.vertex] if controls.level else 1.0) for one in instances]
    if controls.instances == "only":
        return [(parts[0], instances[0])]
    if controls.instances == "own":
        return list(zip(parts, instances, strict=True))
    return [(np.minimum(np.sum(parts, axis=0), np.float32(1.0)), None)]


def _leveled(weights: Float32, top: float) -> Float32:
    """Weights that are 1 where they were `top`."""
    leveled: Float32 = np.minimum(weights / np.float32(top), np.float32(1.0)) if top > 0 else weights
    return leveled
