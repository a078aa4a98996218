"""Parts of the shape: those that handles hold, and those that they are limited to."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np

from dfd.editing.influence.regions import VertexSet, members

if TYPE_CHECKING:
    from dfd.editing.deformer import Deformer
    from dfd.editing.edit import Handle
    from dfd.segmentation.parts import Level

Change = Literal["smaller", "larger", "add", "remove"]
LEVELS: tuple[Level, ...] = ("smaller", "part", "larger")
MOST_KEPT = 64  # parts, each of them a set of vertices


class ShapeParts:
    """The parts of one shape, each found once."""

    def __init__(self, deformer: Deformer) -> None:
        self._deformer = deformer
        self.ready = False  # whether what the first part would have to wait for is done
        self._found: dict[tuple[int, Level, bool], VertexSet] = {}
        self._origins: dict[VertexSet, int] = {}  # the vertex for which a part was chosen

    def at(self, vertex: int, level: Level = "part", *, alike: bool = True) -> VertexSet:
        """The part that a vertex is on."""
        key = (vertex, level, alike)
        if key not in self._found:
            if len(self._found) >= MOST_KEPT:
                self._found.clear()
            self._found[key] = self._deformer.part(vertex, level=level, alike=alike)
        return self._found[key]

    def resized(self, handle: Handle, how: Change) -> VertexSet:
        """Return the next smaller or larger part at the place that a handle holds.

        Raises ValueError if there is none.
        """
        region = handle.place.region if isinstance(handle.place.region, VertexSet) else None
        vertex = self._deformer.bound.rows.anchor(handle.place)
        alike = handle.controls.counterparts != "only"
        if region is not None:
            vertex = self._origins.get(region, vertex)
        levels = list(dict.fromkeys(self.at(vertex, level, alike=alike) for level in LEVELS))
        present = self.at(vertex, alike=alike) if region is None or region not in levels else region
        wanted = levels.index(present) + (1 if how == "larger" else -1)
        if not 0 <= wanted < len(levels):
            raise ValueError(f"There is no {how} part here")
        self._origins[levels[wanted]] = vertex
        return levels[wanted]

    def combined(self, handle: Handle, how: Change, vertex: int) -> VertexSet:
        """Return what a handle holds with the part at a vertex added to it or removed from it.

        Raises ValueError if nothing would be left.
        """
        mesh, part = self._deformer.mesh, self.at(vertex).indices
        own = members(mesh, self.of(handle))
        chosen = np.union1d(own, part) if how == "add" else np.setdiff1d(own, part)
        if len(chosen) == 0:
            raise ValueError("That is all that the handle holds: remove the handle instead")
        return VertexSet.of(mesh, chosen)

    def of(self, handle: Handle) -> VertexSet:
        """What a handle is limited to by its part: what it holds, or the part that it is on."""
        if isinstance(handle.place.region, VertexSet):
            return handle.place.region
        return self.at(self._deformer.bound.rows.anchor(handle.place))

    def limits(self, handle: Handle) -> bool:
        """Whether a handle is limited to its part."""
        mask = handle.controls.mask
        if not isinstance(mask, VertexSet):
            return False
        return mask == handle.place.region or (self.ready and mask == self.of(handle))
