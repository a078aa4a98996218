"""Convert handles and fixed points for the kernels: single points, or regions with weights by the nearest member."""

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

MERGED = 1e-3  # members within this feature distance of a kept one are left out; weights differ by as much at most
MOST_MEMBERS = 32  # largest number of members of a region that are kept, as far apart as possible
MOST_CONSIDERED = 8_192  # largest number of members from which these are chosen; more would take longer than binding

Source = Float32 | CompactFeatures


@dataclass(frozen=True, eq=False)
class Targets:
    """The points from which a kernel measures feature distances."""

    # points: (N,) int64 vertices, or (N, d) float32 rows; rows of compact features are stored entries, in steps
    points: Int64 | Float32
    missed: Float32 | None  # (N,) squared distance that stored rows miss; None for vertices and for full features
    # members: (H,) uint32 number of consecutive points of each handle; None if each handle is one point
    members: NDArray[np.uint32] | None

    def __len__(self) -> int:
        return len(self.points if self.members is None else self.members)


def resolve_points(name: str, value: Any, source: Source) -> Targets:
    """Return the points of the argument `name` of `dfd.bind`, "handles" or "fixed".

    Raises ValueError if `value` is neither vertices, nor feature rows, nor a sequence of regions with at least one
    member each.
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
    """Return the items of a sequence that contains regions; None for an array or a sequence of single points."""
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
    """Return vertices or rows, one per handle; the kernel checks that vertices exist and are distinct."""
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
    """Return the members of one handle, after checking vertices, because their features are read here."""
    if len(array) == 0:
        raise ArgumentError(name, "must have at least one member", "bind")
    if array.ndim == 2:
        return _points(name, array, source)
    return Targets(check.vertex_indices("bind", name, array, source.shape[0]), None, None)


def _as_rows(region: Targets, source: Source) -> Targets:
    """Return a region with the feature rows of its vertices."""
    if region.points.ndim == 2:
        return region
    vertices = region.points.astype(np.int64)
    rows = source.stored(vertices) if isinstance(source, CompactFeatures) else source[vertices]
    return replace(region, points=rows)


def _thinned(region: Targets, source: Source) -> Targets:
    """Return at most `MOST_MEMBERS` of a region's points: the first one, then always the point farthest from these."""
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
