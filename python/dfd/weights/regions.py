"""Convert handles and fixed points for the kernels. Each of them is a point, or a region with several members."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfd.common import check, tensors
from dfd.common.errors import ArgumentError
from dfd.common.linear_algebra import Float32, Int64
from dfd.weights.compact import CompactFeatures

MERGED = 1e-3  # a member is left out if its feature is within this distance of a used member's feature
MOST_MEMBERS = 32  # largest number of members of a region that are used
MOST_CONSIDERED = 8_192  # largest number of members from which the used members are chosen, which limits the time

Source = Float32 | CompactFeatures


@dataclass(frozen=True, eq=False)
class Targets:
    """The points from which a kernel measures feature distances."""

    points: Int64 | Float32  # (N,) vertex indices, or (N, d) rows: features, or stored entries of compact features
    offsets: Float32 | None  # (N,) numbers to add to squared distances, for stored entries; None for other points
    members: NDArray[np.uint32] | None  # (H,) how many consecutive points each handle has; None if each has 1

    def __len__(self) -> int:
        return len(self.points if self.members is None else self.members)


def resolve_points(name: str, value: Any, source: Source) -> Targets:
    """Return the points of the argument `name` of `dfd.bind`: "handles" or "fixed".

    Raises ValueError if `value` is not vertices, feature rows or a sequence of regions, or if a region is empty.
    """
    items = items_of(name, value)
    if items is None:
        return _points(name, np.asarray(tensors.shared("bind", name, value)), source)
    regions = [_thinned(_points(f"{name}[{i}]", item, source, region=True), source) for i, item in enumerate(items)]
    members = np.array([len(region.points) for region in regions], np.uint32)
    if all(region.points.ndim == 1 for region in regions):
        return Targets(np.concatenate([region.points for region in regions]).astype(np.int64), None, members)
    regions = [_as_rows(region, source) for region in regions]
    points = np.ascontiguousarray(np.concatenate([region.points for region in regions]), np.float32)
    offsets = [np.zeros(len(each.points), np.float32) if each.offsets is None else each.offsets for each in regions]
    return Targets(points, np.concatenate(offsets) if isinstance(source, CompactFeatures) else None, members)


def items_of(name: str, value: Any) -> list[NDArray[Any]] | None:
    """Return the items of a sequence that contains a region, or None for an array or a sequence of single points."""
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
        return None  # a sequence of feature rows
    return [item[np.newaxis] if item.ndim == 0 or _is_row(item) else item for item in items]


def _is_row(item: NDArray[Any]) -> bool:
    return item.ndim == 1 and item.dtype.kind == "f" and item.size > 0


def _points(name: str, array: NDArray[Any], source: Source, *, region: bool = False) -> Targets:
    """Return the points of an `array` of handles, or the members of a single handle if `region` is True.

    The kernel checks that the vertex indices of handles are distinct.
    """
    if region and len(array) == 0:
        raise ArgumentError(name, "must have at least one member", "bind")
    if array.ndim == 2:
        rows = check.array("bind", name, array, ("N", source.shape[1]))
        if not isinstance(source, CompactFeatures):
            return Targets(rows, None, None)
        stored, offsets = source.project(rows)
        return Targets(np.ascontiguousarray(stored), offsets, None)
    return Targets(check.vertex_indices("bind", name, array, source.shape[0]), None, None)


def _as_rows(region: Targets, source: Source) -> Targets:
    """Return a region with feature rows in place of vertex indices."""
    if region.points.ndim == 2:
        return region
    vertices = region.points.astype(np.int64)
    return replace(region, points=source.stored(vertices) if isinstance(source, CompactFeatures) else source[vertices])


def _thinned(region: Targets, source: Source) -> Targets:
    """Return the region with at most `MOST_MEMBERS` points, whose features differ most (farthest-point sampling)."""
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
    return replace(region, points=region.points[kept], offsets=None if region.offsets is None else region.offsets[kept])
