"""Handles and fixed points as the kernels take them: single points, or regions that weigh by their nearest member."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfd.common import check, tensors
from dfd.common.errors import ArgumentError
from dfd.common.linear_algebra import Float32, Int64
from dfd.weights.compact import CompactFeatures

# What a region is thinned to: what lies closer to a kept member than this changes no weight that anyone sees, and so
# many members that lie as far apart as they can leave little between them.
MERGED = 1e-3
MOST_MEMBERS = 32
MOST_CONSIDERED = 8_192  # of a region, spread evenly over it; more would take longer than binding

Source = Float32 | CompactFeatures


@dataclass(frozen=True, eq=False)
class Targets:
    """What a kernel measures distances to."""

    # points: (N,) int64 vertices, or (N, d) float32 rows: of compact features what is stored, in steps
    points: Int64 | Float32
    missed: Float32 | None  # (N,) squared distance that stored rows miss; None for vertices and for full features
    # members: (H,) uint32 how many of the points, in their order, make each handle; None where each is one
    members: NDArray[np.uint32] | None

    def __len__(self) -> int:
        return len(self.points if self.members is None else self.members)


def resolve_points(name: str, value: Any, source: Source) -> Targets:
    """What `dfd.bind` was given as `name`, "handles" or "fixed".

    Raises ValueError if it is neither vertices, nor feature rows, nor a sequence of such with at least one member each.
    """
    items = _items(name, value)
    if items is None:
        return _points(name, np.asarray(tensors.shared("bind", name, value)), source)
    regions = [_thinned(_region(f"{name}[{i}]", item, source), source) for i, item in enumerate(items)]
    members = np.array([len(region.points) for region in regions], np.uint32)
    if all(region.points.ndim == 1 for region in regions):
        return Targets(np.concatenate([region.points for region in regions]).astype(np.int64), None, members)
    regions = [_as_rows(region, source) for region in regions]
    points = np.ascontiguousarray(np.concatenate([region.points for region in regions]), np.float32)
    if not isinstance(source, CompactFeatures):
        return Targets(points, None, members)
    missed = [
        np.zeros(len(region.points), np.float32) if region.missed is None else region.missed for region in regions
    ]
    return Targets(points, np.concatenate(missed), members)


def _items(name: str, value: Any) -> list[NDArray[Any]] | None:
    """The items of a sequence of which some are regions; None for an array, and for what would be one."""
    if not isinstance(value, Sequence) or isinstance(value, str):
        return None
    items = []
    for i, item in enumerate(value):
        try:
            items.append(np.asarray(tensors.shared("bind", f"{name}[{i}]", item)))
        except ValueError:
            if not isinstance(item, Sequence):
                raise
            raise ValueError(f"bind: `{name}[{i}]` must be a vertex, vertices or feature rows of one length") from None
    if all(item.ndim == 0 for item in items):
        return None
    if len({item.shape for item in items}) == 1 and _is_row(items[0]):
        return None  # feature rows, one by one
    return [item[np.newaxis] if item.ndim == 0 or _is_row(item) else item for item in items]


def _is_row(item: NDArray[Any]) -> bool:
    return item.ndim == 1 and item.dtype.kind == "f" and item.size > 0


def _points(name: str, array: NDArray[Any], source: Source) -> Targets:
    """Vertices or rows, each a handle; the kernel checks where vertices lie and that single handles differ."""
    if array.ndim == 2:
        rows = check.array("bind", name, array, ("N", source.shape[1]))
        if not isinstance(source, CompactFeatures):
            return Targets(rows, None, None)
        stored, missed = source.project(rows)
        return Targets(np.ascontiguousarray(stored), missed, None)
    if array.ndim == 1 and array.dtype == np.int64:
        return Targets(np.ascontiguousarray(array), None, None)
    return Targets(check.vertex_indices("bind", name, array, source.shape[0]), None, None)


def _region(name: str, array: NDArray[Any], source: Source) -> Targets:
    """The members of one handle, which lie in the shape: their features are looked at here."""
    if len(array) == 0:
        raise ArgumentError(name, "must have at least one member", "bind")
    if array.ndim == 2:
        return _points(name, array, source)
    return Targets(check.vertex_indices("bind", name, array, source.shape[0]), None, None)


def _as_rows(region: Targets, source: Source) -> Targets:
    """Vertices of a region as the rows that they have."""
    if region.points.ndim == 2:
        return region
    vertices = region.points.astype(np.int64)
    rows = source.stored(vertices) if isinstance(source, CompactFeatures) else source[vertices]
    return replace(region, points=rows)


def _thinned(region: Targets, source: Source) -> Targets:
    """At most `MOST_MEMBERS` of a region's points, the farthest from all before it next, from the first one on."""
    count = len(region.points)
    if count <= 1:
        return region
    considered = np.arange(count)
    if count > MOST_CONSIDERED:
        considered = np.linspace(0, count - 1, MOST_CONSIDERED).astype(np.int64)
    rows = _as_rows(replace(region, points=region.points[considered]), source).points.astype(np.float64)
    rows *= source.step if isinstance(source, CompactFeatures) else 1.0
    chosen = [0]
    distances = np.linalg.norm(rows - rows[0], axis=1)
    while len(chosen) < MOST_MEMBERS and distances.max() > MERGED:
        chosen.append(int(distances.argmax()))
        np.minimum(distances, np.linalg.norm(rows - rows[chosen[-1]], axis=1), out=distances)
    kept = considered[chosen]
    return replace(region, points=region.points[kept], missed=None if region.missed is None else region.missed[kept])
