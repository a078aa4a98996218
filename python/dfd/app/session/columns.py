"""The columns of distances, one per handle, from which the page computes weights; sent only when they change."""

from __future__ import annotations

from collections.abc import Hashable
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dfd.app.protocol.binary_messages import (
    ColumnEntry,
    ColumnsMessage,
    CounterpartEntry,
    CounterpartsEntry,
    CounterpartsMessage,
    HeatMessage,
    pack,
)
from dfd.common.linear_algebra import Float32, Float64
from dfd.editing.presets import PARTLESS_REACH, PRESETS
from dfd.geometry.coarse import Share
from dfd.posing.transforms import Vector
from dfd.weights.bind import bind

if TYPE_CHECKING:
    from dfd.editing.deformer import Deformer
    from dfd.editing.edit import Handle
    from dfd.editing.influence.counterparts import Counterpart
    from dfd.editing.points import Place

MAX_DISTANCE = 2.0  # between unit vectors
UINT16_MAX = 65535  # quantization steps of a column

Arrays = dict[str, NDArray[Any]]


class Whole(NamedTuple):
    """All counterparts of a handle as one: `share` (V,) times its gain is what they have of its weight."""

    position: Vector
    share: Share
    frame: Float64 = np.eye(3)


class Columns:
    """The numbered columns of one session, and which of them (and of their counterparts) the page has received."""

    def __init__(self, deformer: Deformer) -> None:
        self._deformer = deformer
        self._numbers: dict[Hashable, int] = {}
        self._sent: set[int] = set()
        self._shares: dict[int, list[NDArray[np.uint16]]] = {}  # of a column's counterparts, as last sent
        self._complete: dict[
            int, Hashable
        ] = {}  # columns whose counterparts were sent as well, and what they depend on

    def of_handle(self, handle: Handle) -> int:
        """The number of a handle's column."""
        return self._number(self._key(handle))

    def of_fixed(self) -> int:
        """The number of the column of fixed places; 0 where nothing is fixed."""
        fixed = self._deformer.fixed
        return self._number(("fixed", fixed)) if fixed else 0

    def forget(self) -> None:
        """Mark all columns as not sent: a new page has connected."""
        self._sent.clear()
        self._shares.clear()
        self._complete.clear()

    @property
    def has_pending(self) -> bool:
        """Whether there are columns of the present edit whose counterparts were not sent yet."""
        return bool(self._pending())

    def message(self) -> bytes | None:
        """The columns of the present edit that were not sent yet; None if all were.

        Counterparts follow separately, because computing them would delay the heat map.
        """
        deformer = self._deformer
        wanted: dict[int, int | None] = {self.of_handle(handle): i for i, handle in enumerate(deformer.handles)}
        if deformer.fixed:
            wanted[self.of_fixed()] = None
        self._sent &= set(wanted)
        missing = {number: handle for number, handle in wanted.items() if number not in self._sent}
        if not missing:
            return None
        arrays: Arrays = {}
        entries = []
        for number, handle in missing.items():
            if handle is None:
                arrays[f"values{number}"] = _packed(deformer.bound.by_features.held(deformer.edit), 1.0)
                entries.append(_column_entry(number, "weight"))
            else:
                entries.append(self._handle_entry(number, handle, arrays))
        message = pack(ColumnsMessage, arrays, columns=tuple(entries))
        self._sent |= set(missing)
        self._shares = {number: known for number, known in self._shares.items() if number in self._sent - set(missing)}
        self._complete = {number: key for number, key in self._complete.items() if number in self._sent - set(missing)}
        return message

    def counterparts_message(self) -> bytes | None:
        """The counterparts of one pending column; None if nothing is pending."""
        pending = self._pending()
        if not pending:
            return None
        number, index = next(iter(pending.items()))
        handle = self._deformer.handles[index]
        self._complete[number] = self._counterparts_key(handle)  # before computing: a failure is not retried
        arrays: Arrays = {}
        found: list[CounterpartEntry] = []
        known, now = self._shares.get(number, []), list[NDArray[np.uint16]]()
        for counterpart, gain in self._acting(handle, index):
            count = len(self._deformer.mesh.vertices)
            own = np.ones(count, np.float32) if counterpart.share is None else counterpart.share.dense(count)
            now.append(_packed(own, 1.0))
            share = None
            if len(now) > len(known) or not np.array_equal(now[-1], known[len(now) - 1]):
                share = f"share{len(found)}"
                arrays[share] = now[-1]
            frame: Any = tuple(map(tuple, np.asarray(counterpart.frame).tolist()))
            found.append(CounterpartEntry(frame=frame, position=counterpart.position, gain=gain, share=share))
        self._shares[number] = now
        return pack(CounterpartsMessage, arrays, columns=(CounterpartsEntry(column=number, counterparts=tuple(found)),))

    def _acting(self, handle: Handle, index: int) -> list[tuple[Counterpart | Whole, float]]:
        """The counterparts through which the handle at `index` acts, and the gain of each."""
        bound, edit = self._deformer.bound, self._deformer.edit
        controls = handle.controls
        if controls.counterparts == "shared_pivot":
            # All counterparts turn about one pivot: together they are one, whose share is what they add up to.
            share = bound.counterpart_share(edit, handle)
            most = float(share.max(initial=0.0)) or 1.0
            return [(Whole(handle.place.position, Share(np.arange(len(share)), share / most)), most)]
        if controls.counterparts == "own_pivot" and not edit.rules.equalize and not self._allocation():
            # Gains are 1, so the weights of all handles need not be computed.
            return [(counterpart, 1.0) for counterpart, on in bound.counterparts(edit, handle) if on]
        columns = bound.columns(edit)[1]
        return [
            (column.counterpart, column.gain)
            for column in columns
            if column.handle == index and column.counterpart is not None
        ]

    def _pending(self) -> dict[int, int]:
        """Column number to handle index, for counterparts still to be sent."""
        handles = self._deformer.handles
        numbers = {self.of_handle(handle): i for i, handle in enumerate(handles) if self._by_counterparts(handle)}
        return {
            number: i
            for number, i in numbers.items()
            if number in self._sent and self._complete.get(number, self) != self._counterparts_key(handles[i])
        }

    def _counterparts_key(self, handle: Handle) -> Hashable:
        """Return what a handle's counterparts depend on besides its column: gains that level them follow weights."""
        edit = self._deformer.edit
        about = (handle.controls, edit.fixed) if edit.rules.equalize else ()
        return *about, *self._allocation()

    def _allocation(self) -> tuple[Hashable, ...]:
        """Everything that the division of components among handles depends on."""
        edit = self._deformer.edit
        moving = self._deformer.bound.allocating(edit)
        return (moving, *((handle.place, handle.controls) for handle in edit.handles)) if moving else ()

    def _handle_entry(self, number: int, index: int, arrays: Arrays) -> ColumnEntry:
        """The column of the handle at `index`; its buffers go into `arrays`."""
        deformer = self._deformer
        handle = deformer.handles[index]
        kind = column_kind(handle)
        geodesic = None
        if kind == "weight":
            whole = deformer.weights[:, index]
            if not self._by_counterparts(handle):  # the sum over its counterparts
                weights, columns = deformer.bound.columns(deformer.edit)
                whole = weights[:, [column.handle for column in columns].index(index)]
            arrays[f"values{number}"] = _packed(whole, 1.0)
        else:
            arrays[f"values{number}"] = _packed(feature_distances(deformer, handle.place), MAX_DISTANCE)
            _, along, _ = deformer.bound.by_features.locality(deformer.edit, handle)
            if along is not None:
                geodesic = f"geodesic{number}"
                arrays[geodesic] = _packed(along, 1.0)
        return _column_entry(number, kind, geodesic)

    def _key(self, handle: Handle) -> Hashable:
        """Everything the handle's column depends on besides mesh and field; equal keys mean equal columns."""
        edit = self._deformer.edit
        controls = handle.controls
        sources, _, _ = self._deformer.bound.by_features.locality(edit, handle)
        kind = column_kind(handle)
        if kind == "distance":
            # Reach and falloff are the page's own, and change without a new column.
            counterparts = None
            if self._by_counterparts(handle):
                counterparts = (controls.counterparts, controls.excluded_counterparts, edit.symmetry)
            return (kind, handle.place, sources, edit.preset, controls.radius, counterparts)
        # Weights sent as such depend on every control.
        return (kind, handle.place, sources, edit.preset, controls, edit.fixed, edit.symmetry)

    def _by_counterparts(self, handle: Handle) -> bool:
        """Whether the page has to know of the handle's counterparts, to make weights of its column."""
        controls = handle.controls
        told_apart = self._deformer.edit.rules.equalize or bool(controls.excluded_counterparts)
        return controls.counterparts != "shared_pivot" or (told_apart and column_kind(handle) == "distance")

    def _number(self, key: Hashable) -> int:
        return self._numbers.setdefault(key, len(self._numbers) + 1)


def column_kind(handle: Handle) -> Literal["distance", "weight"]:
    """What is sent of a handle: "weight" where weights are not a function of one distance per vertex."""
    controls = handle.controls
    limited = controls.mask is not None or controls.reach == "part"
    return "weight" if handle.place.region is not None or limited else "distance"


def heat_message(weights: Float32, *, request: int, vertex: int | None = None) -> bytes:
    """The message that shows `weights` (V,) as a heat map."""
    return pack(HeatMessage, {"values": _packed(weights, 1.0)}, id=request, vertex=vertex)


def probed(deformer: Deformer, place: Place) -> Float32:
    """(V,) about the weights that a new handle at a place would have: without its counterparts' falloff."""
    rules, bound = PRESETS[deformer.preset], deformer.bound
    grip = bound.grips.grip(place) if rules.reach == "part" else None
    if grip is None:
        reach = PARTLESS_REACH if rules.reach == "part" else rules.reach
        weights: Float32 = bind(deformer.features, bound.rows.points([place]), reach=reach, falloff=rules.falloff)[:, 0]
    else:
        weights = grip.weights
    return weights - bound.by_features.held(deformer.edit) if deformer.fixed else weights


def feature_distances(deformer: Deformer, place: Place) -> Float32:
    """(V,) in [0, 2], the distance of each vertex from `place` in feature space."""
    distances: Float32 = bind(deformer.features, deformer.bound.rows.points([place]), reach=MAX_DISTANCE)[:, 0]
    np.subtract(1.0, distances, out=distances)
    distances *= MAX_DISTANCE
    return distances


def _column_entry(number: int, kind: Literal["distance", "weight"], geodesic: str | None = None) -> ColumnEntry:
    return ColumnEntry(
        column=number,
        kind=kind,
        values=f"values{number}",
        scale=MAX_DISTANCE if kind == "distance" else 1.0,
        geodesic=geodesic,
    )


def _packed(values: NDArray[np.floating[Any]], scale: float) -> NDArray[np.uint16]:
    """Values in [0, `scale`], quantized to 16 bits."""
    scaled = values * np.float32(UINT16_MAX / scale)
    np.rint(scaled, out=scaled)
    return scaled.clip(0, UINT16_MAX, out=scaled).astype(np.uint16)
