"""What the page makes weights of: a column of distances for each handle, sent once and again when it changes."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from dfd.app.framing import pack
from dfd.app.protocol.binaries import ColumnEntry, ColumnsMessage, HeatMessage
from dfd.weights.bind import bind

if TYPE_CHECKING:
    from dfd.editing.deformer import Deformer
    from dfd.editing.edit import Handle, Place

__all__ = ["Columns", "heat_message"]

FARTHEST = 2.0  # unit rows are never farther apart
STEPS = 65535  # that a column's numbers have

UInt16 = NDArray[np.uint16]


@dataclass(frozen=True)
class Key:
    """What a column depends on besides mesh and field; equal keys are the same column."""

    of: Literal["handle", "fixed"]
    places: tuple[Place, ...]
    sources: tuple[int, ...] = ()  # the vertices where distances along the surface start


class Columns:
    """The columns of one session, numbered, and which of them the page has."""

    def __init__(self, deformer: Deformer) -> None:
        self._deformer = deformer
        self._numbers: dict[Hashable, int] = {}
        self._sent: set[int] = set()

    def of_handle(self, handle: Handle) -> int:
        """The number of a handle's column."""
        return self._number(self._key(handle))

    def of_fixed(self) -> int:
        """The number of the column of fixed places; 0 where nothing is fixed."""
        fixed = self._deformer.fixed
        return self._number(Key("fixed", fixed)) if fixed else 0

    def forget(self) -> None:
        """Know of a page that has none."""
        self._sent.clear()

    def message(self) -> bytes | None:
        """The columns of the present edit that the page has not got; None where it has them all."""
        deformer = self._deformer
        keys = [self._key(handle) for handle in deformer.handles]
        if deformer.fixed:
            keys.append(Key("fixed", deformer.fixed))
        wanted = {self._number(key): key for key in keys}
        self._sent &= set(wanted)
        missing = {number: key for number, key in wanted.items() if number not in self._sent}
        if not missing:
            return None
        arrays: dict[str, NDArray[Any]] = {}
        entries = []
        for number, key in missing.items():
            arrays[f"values{number}"] = _packed(nearest(deformer, key.places), FARTHEST)
            geodesic = None
            if key.sources:
                geodesic = f"geodesic{number}"
                arrays[geodesic] = _packed(deformer._weights._distance(key.sources), 1.0)
            entries.append(
                ColumnEntry(
                    column=number,
                    kind="distance",
                    values=f"values{number}",
                    scale=FARTHEST,
                    geodesic=geodesic,
                    instances=(),
                )
            )
        message = pack(ColumnsMessage, arrays, columns=tuple(entries))
        self._sent |= set(missing)
        return message

    def _key(self, handle: Handle) -> Key:
        return Key("handle", (handle.place,), self._deformer._weights._sources(handle, self._deformer.symmetry))

    def _number(self, key: Hashable) -> int:
        return self._numbers.setdefault(key, len(self._numbers) + 1)


def heat_message(deformer: Deformer, place: Place, *, request: int) -> bytes:
    """The answer to `probe`."""
    values = _packed(nearest(deformer, (place,)), FARTHEST)
    return pack(HeatMessage, {"values": values}, id=request, vertex=place.vertex, scale=FARTHEST)


def nearest(deformer: Deformer, places: Sequence[Place]) -> NDArray[np.float32]:
    """(V,) in [0, 2], the distance of each vertex, in feature space, from the nearest of `places`."""
    result: NDArray[np.float32] | None = None
    for place in places:  # one by one, so that there never are V × P numbers
        weights = bind(deformer.features, _point(deformer, place))[:, 0]
        distances = 1.0 - weights
        result = distances if result is None else np.minimum(result, distances, out=result)
    assert result is not None
    return result


def _point(deformer: Deformer, place: Place) -> Any:
    """What `bind` takes for a place: the index of its vertex, or a feature row."""
    if place.vertex is not None:
        return np.array([place.vertex])
    return deformer.field(np.array([place.position]))


def _packed(values: NDArray[np.floating[Any]], scale: float) -> UInt16:
    """Numbers in [0, `scale`] as steps."""
    scaled = values * np.float32(STEPS / scale)
    np.rint(scaled, out=scaled)
    return scaled.clip(0, STEPS, out=scaled).astype(np.uint16)
