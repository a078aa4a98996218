"""Parts of the shape: those that handles hold, and those that they are limited to."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dfd.editing.influence.recent import Recent
from dfd.editing.influence.regions import VertexSet, members
from dfd.geometry.coarse import nodes_of

if TYPE_CHECKING:
    from dfd.app.protocol.parts import PartChange
    from dfd.editing.deformer import Deformer
    from dfd.editing.edit import Handle
    from dfd.segmentation.parts import Level

LEVELS: tuple[Level, ...] = ("smaller", "part", "larger")
MOST_KEPT = 64  # parts, each of them a set of vertices


class ShapeParts:
    """The parts of one shape, each found once."""

    def __init__(self, deformer: Deformer) -> None:
        self._deformer, self._mesh = deformer, deformer.mesh
        self.ready = False  # whether what the first part would have to wait for is done
        self._found: Recent[VertexSet] = Recent(MOST_KEPT)
        self._origins: dict[VertexSet, int] = {}  # the vertex for which a part was chosen

    @property
    def ways(self) -> tuple[PartChange, ...]:
        """The ways to hold another part: "material" only where there are several, and so on."""
        several = (name for name, label in self._labels.items() if label.min() < label.max())
        return ("smaller", "larger", "add", "remove", *several)

    @cached_property
    def _labels(self) -> dict[PartChange, NDArray[np.integer[Any]]]:
        """By each way to take what the file makes one thing, (F,) the number of that thing for each face."""
        mesh, nodes = self._mesh, nodes_of(self._mesh)
        scene_part = np.zeros(len(mesh.faces), np.int64)
        for number, part in enumerate(mesh.parts):
            scene_part[part.faces] = number
        material = mesh.appearance.face_material if mesh.appearance is not None else np.zeros_like(scene_part)
        return {
            "scene_part": scene_part,
            "material": material,
            "component": nodes.component[nodes.of_vertex[mesh.faces[:, 0]]],
        }

    def at(self, vertex: int, level: Level = "part", *, alike: bool = True) -> VertexSet:
        """The part that a vertex is on."""
        return self._found.get((vertex, level, alike), lambda: self._deformer.part(vertex, level=level, alike=alike))

    def taken(self, handle: Handle, how: PartChange, vertex: int | None = None) -> VertexSet:
        """Return what a handle holds after it took another part; `vertex` is where the part of "add" and "remove" is.

        Raises ValueError if there is no such part, or nothing would be left.
        """
        mesh = self._mesh
        if how in ("add", "remove"):
            if vertex is None:
                raise ValueError(f"To {how} a part, say at which vertex it is")
            own, part = members(mesh, self.of(handle)), self.at(vertex).indices
            chosen = np.union1d(own, part) if how == "add" else np.setdiff1d(own, part)
            if len(chosen) == 0:
                raise ValueError("That is all that the handle holds: remove the handle instead")
            return VertexSet.of(mesh, chosen)
        region, origin = handle.place.region, self._deformer.bound.rows.anchor(handle.place)
        if isinstance(region, VertexSet):
            origin = self._origins.get(region, origin)
        found = self._resized(handle, origin, how) if how in ("smaller", "larger") else self._unit(origin, how)
        self._origins[found] = origin
        return found

    def _resized(self, handle: Handle, vertex: int, how: PartChange) -> VertexSet:
        """Return the part at a vertex that is the next smaller or larger one than what a handle holds."""
        alike = handle.controls.counterparts != "only"
        levels = [self.at(vertex, level, alike=alike) for level in LEVELS]
        region = handle.place.region
        now = len(levels[1].indices if region is None else members(self._mesh, region))
        sign = 1 if how == "larger" else -1
        others = [each for each in levels if sign * (len(each.indices) - now) > 0]
        if not others:
            raise ValueError(f"There is no {how} part here")
        return min(others, key=lambda each: sign * len(each.indices))

    def _unit(self, vertex: int, how: PartChange) -> VertexSet:
        """Return the scene part, material or component that a vertex is on."""
        faces, label = self._mesh.faces, self._labels[how]
        on = np.flatnonzero((faces == vertex).any(axis=1))
        if len(on) == 0:
            raise ValueError(f"There is no {how.replace('_', ' ')} here")
        return VertexSet.of(self._mesh, np.unique(faces[label == label[on[0]]]))

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
