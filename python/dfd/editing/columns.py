"""Columns of numbers that come, go and change places, in memory where each is contiguous and all lie side by side."""

from __future__ import annotations

import weakref
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["Columns"]

LEAST_CAPACITY = 32

Float32 = NDArray[np.float32]


class Columns:
    """Room for columns of V float32 numbers, in front of which lies one more, column 0, that is nobody's.

    Memory that no column was written to yet costs nothing on systems that give it page by page, so there is plenty.
    """

    def __init__(self, length: int, count: int = 0) -> None:
        """Make room for `count` columns of `length` numbers and as many again."""
        self._rows = np.empty((1 + max(LEAST_CAPACITY, 2 * count), length), np.float32)
        self._lender: weakref.ref[Float32] | None = None
        self._lent = 0

    def between(self, first: int, last: int) -> Float32:
        """(V, last − first) the columns from `first` on and before `last`, to be read and written."""
        return self._rows[first:last].T

    def lend(self, first: int, last: int) -> Float32:
        """The same, read-only, and as long as somebody holds them `rearranged` leaves them as they are."""
        lender = None if self._lender is None else self._lender()
        if lender is None:
            # All views of it hold it, and not what it is a view of: it lives as long as they do.
            lender = np.asarray(self._rows.data)
            lender.flags.writeable = False
            self._lender, self._lent = weakref.ref(lender), 0
        self._lent = max(self._lent, last)
        return lender[first:last].T

    def rearranged(self, sources: Sequence[int | None]) -> Columns:
        """These columns with what was column `sources[i]` at 1 + i, or with room for a new one where that is None.

        They stay in their memory, and those whose place stays are not touched, unless columns that are lent would
        change, or there is too little room or far too much.
        """
        moves = [(to, source) for to, source in enumerate(sources, start=1) if source != to]
        kept = [source for source in sources if source is not None]
        roomy = len(sources) < len(self._rows) <= 4 * max(LEAST_CAPACITY, len(sources))
        lent = self._lent if self._lender is not None and self._lender() is not None else 1
        if roomy and kept == sorted(kept) and all(to >= lent for to, _ in moves):
            # As their order stays, none is written over before it has moved, nor by one that moves the other way.
            down = [(to, source) for to, source in moves if source is not None and source > to]
            up = [(to, source) for to, source in reversed(moves) if source is not None and source < to]
            for to, source in down + up:
                self._rows[to] = self._rows[source]
            return self
        columns = Columns(self._rows.shape[1], len(sources))
        for to, kept_at in enumerate(sources, start=1):
            if kept_at is not None:
                columns._rows[to] = self._rows[kept_at]
        return columns
