"""Columns of numbers that come, go and change places, in memory where each is contiguous and all lie side by side."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["Columns"]

LEAST_CAPACITY = 32

Float32 = NDArray[np.float32]


class Columns:
    """Room for columns of V float32 numbers.

    Memory that no column was written to yet costs nothing on systems that give it page by page, so there is plenty.
    """

    def __init__(self, length: int, count: int = 0) -> None:
        """Make room for `count` columns of `length` numbers and as many again."""
        self._rows = np.empty((max(LEAST_CAPACITY, 2 * count), length), np.float32)
        self._given = 0  # so many columns from the first on were given out, and stay as they are

    def between(self, first: int, last: int) -> Float32:
        """(V, last − first) the columns from `first` on and before `last`, to be read and written."""
        return self._rows[first:last].T

    def given(self, count: int) -> Float32:
        """(V, count) the first columns, read-only; from then on `rearranged` leaves them as they are."""
        self._given = max(self._given, count)
        columns = self.between(0, count)
        columns.flags.writeable = False
        return columns

    def rearranged(self, sources: Sequence[int | None]) -> Columns:
        """These columns with what was column `sources[i]` at i, or with room for a new one where that is None.

        New columns behind those that stay go into the same memory; all else is a copy.
        """
        stay = 0
        while stay < len(sources) and sources[stay] == stay:
            stay += 1
        roomy = len(sources) <= len(self._rows) <= 4 * max(LEAST_CAPACITY, len(sources))
        if roomy and stay >= self._given and all(source is None for source in sources[stay:]):
            return self
        columns = Columns(self._rows.shape[1], len(sources))
        for to, source in enumerate(sources):
            if source is not None:
                columns._rows[to] = self._rows[source]
        return columns
