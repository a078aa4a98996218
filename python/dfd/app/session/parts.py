"""Parts of the shape at a click: shown under the pointer, held, and what a handle may be limited to."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np

from dfd.app.protocol.binary_messages import PartMessage, pack
from dfd.editing.influence.regions import VertexSet, members

if TYPE_CHECKING:
    from dfd.editing.deformer import Deformer
    from dfd.editing.edit import Handle
    from dfd.segmentation.parts import Level

Combine = Literal["take", "add", "remove"]
# What the same place gives one click after the other: the level, and whether its look-alikes belong to it.
STEPS: tuple[tuple[Level, bool], ...] = (("part", True), ("part", False), ("larger", True), ("smaller", True))
MOST_KEPT = 64  # parts, each of them a set of vertices


class ShapeParts:
    """The parts of one shape, each found once."""

    def __init__(self, deformer: Deformer) -> None:
        self._deformer = deformer
        self.ready = False  # whether what the first part would have to wait for is done
        self._found: dict[tuple[int, Level, bool], VertexSet] = {}

    def at(self, vertex: int, level: Level = "part", *, alike: bool = True) -> VertexSet:
        """The part that a vertex is on."""
        key = (vertex, level, alike)
        if key not in self._found:
            if len(self._found) >= MOST_KEPT:
                self._found.clear()
            self._found[key] = self._deformer.part(vertex, level=level, alike=alike)
        return self._found[key]

    def message(self, vertex: int, *, request: int) -> bytes:
        """The answer to `part`."""
        part = self.at(vertex)
        mask = np.zeros(len(self._deformer.mesh.vertices), bool)
        mask[part.indices] = True
        arrays = {"mask": np.packbits(mask, bitorder="little")}
        return pack(PartMessage, arrays, id=request, vertex=vertex, count=len(part.indices))

    def steps(self, vertex: int) -> list[VertexSet]:
        """What clicks on a vertex take, one after the other."""
        return list(dict.fromkeys(self.at(vertex, level, alike=alike) for level, alike in STEPS))

    def combined(self, vertex: int, held: VertexSet, how: Combine) -> VertexSet:
        """What is held with the part that a vertex is on added to it, or taken away from it.

        Raises ValueError if nothing would be left.
        """
        mesh, part = self._deformer.mesh, self.at(vertex).indices
        own = members(mesh, held)
        chosen = np.union1d(own, part) if how == "add" else np.setdiff1d(own, part)
        if len(chosen) == 0:
            raise ValueError("That is all that the handle holds: remove the handle instead")
        return VertexSet.of(mesh, chosen)

    def of(self, handle: Handle) -> VertexSet:
        """What a handle is limited to by its part: what it holds, or the part that it is on."""
        if isinstance(handle.place.region, VertexSet):
            return handle.place.region
        return self.at(self._deformer.bound.anchor(handle))

    def limits(self, handle: Handle) -> bool:
        """Whether a handle is limited to its part."""
        mask = handle.controls.mask
        if not isinstance(mask, VertexSet):
            return False
        return mask == handle.place.region or (self.ready and mask == self.of(handle))
