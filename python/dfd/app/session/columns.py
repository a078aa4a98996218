"""The columns of weights with which the page poses. Each column is sent once."""

from __future__ import annotations

from hashlib import sha256
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dfd.app.protocol.answers import ColumnState
from dfd.app.protocol.binary_messages import ColumnsMessage, HeatMessage, pack
from dfd.common.linear_algebra import Float32
from dfd.editing.presets import PARTLESS_REACH, PRESETS
from dfd.weights.bind import bind

if TYPE_CHECKING:
    from dfd.editing.deformer import Deformer
    from dfd.editing.points import Place

UINT16_MAX = 65535  # number of steps of a quantized weight


class Columns:
    """The numbered columns of one session, and which of them the page has received."""

    def __init__(self, deformer: Deformer) -> None:
        self._deformer = deformer
        self._count = 0
        self._known: dict[bytes, int] = {}  # the number of each column that the page has, by the hash of its values
        self._of_handle: list[tuple[ColumnState, ...]] = []

    def forget(self) -> None:
        """Mark all columns as not sent: a new page has connected."""
        self._known = {}

    def of_handle(self, index: int) -> tuple[ColumnState, ...]:
        """Return the columns of the handle at `index` at the time of the last `message`."""
        return self._of_handle[index]

    def message(self) -> bytes | None:
        """Return the columns of the present edit that the page has not received; None if it has all."""
        deformer = self._deformer
        weights, columns = deformer.bound.columns(deformer.edit)
        packed = _packed(weights.T)
        before, self._known, new = self._known, {}, []
        self._of_handle = [() for _ in deformer.handles]
        for values, column in zip(packed, columns, strict=True):
            key = sha256(values.tobytes()).digest()
            if key not in before and key not in self._known:
                self._count += 1
                new.append(values)
            number = self._known.setdefault(key, before.get(key, self._count))
            own = column.counterpart
            frame: Any = tuple(map(tuple, own.frame.tolist()))
            self._of_handle[column.handle] += (ColumnState(column=number, frame=frame, position=own.position),)
        if not new:
            return None
        numbers = tuple(range(self._count - len(new) + 1, self._count + 1))
        return pack(ColumnsMessage(columns=numbers), values=np.stack(new))


def heat_message(weights: Float32, *, request: int, vertex: int | None = None) -> bytes:
    """Return the message that shows `weights` (V,) as a heat map."""
    return pack(HeatMessage(id=request, vertex=vertex), values=_packed(weights))


def probed(deformer: Deformer, place: Place) -> Float32:
    """Return approximate weights (V,) of a new handle at a place, without the falloff on its counterparts."""
    rules, bound = PRESETS[deformer.preset], deformer.bound
    grip = bound.grips.grip(place) if rules.reach == "part" else None
    if grip is None:
        reach = PARTLESS_REACH if rules.reach == "part" else rules.reach
        weights: Float32 = bind(deformer.features, bound.rows.points([place]), reach=reach, falloff=rules.falloff)[:, 0]
    else:
        weights = grip.weights
    return weights - bound.by_features.held(deformer.edit) if deformer.fixed else weights


def _packed(weights: Float32) -> NDArray[np.uint16]:
    """Return weights in [0, 1] quantized to 16 bits."""
    return np.rint(weights * np.float32(UINT16_MAX)).clip(0, UINT16_MAX).astype(np.uint16)
