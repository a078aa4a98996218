"""Find the parts of a shape. A handle can move such a part, or a mask can limit a handle to the part."""

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfd.app.protocol.messages import LadderStep, PartChange
from dfd.common.kept import Kept
from dfd.common.linear_algebra import Bool
from dfd.editing.deformer import Deformer
from dfd.editing.edit import Handle
from dfd.editing.regions import VertexSet, members
from dfd.editing.report import percent
from dfd.geometry.coarse import nodes_of
from dfd.geometry.topology import scene_parts_and_materials

SAME = 0.98  # two parts count as one if they share at least this fraction of the mesh nodes that either contains
MOST_KEPT = 64  # largest number of parts in the cache


WHOLE = "the whole shape"


class ShapeParts:
    """Find the parts of one shape, and cache the parts that were used last."""

    def __init__(self, deformer: Deformer) -> None:
        self._deformer, self._mesh = deformer, deformer.mesh
        self._found = Kept(MOST_KEPT)
        self._origins: dict[VertexSet, int] = {}  # the vertex at which each region was found

    @property
    def ways(self) -> tuple[PartChange, ...]:
        """Return the changes that this shape allows. For example, "material" needs several materials."""
        several = (name for name, label in self._labels.items() if label.min() < label.max())
        return ("smaller", "larger", "add", "remove", *several)

    @cached_property
    def _labels(self) -> dict[PartChange, NDArray[np.integer[Any]]]:
        """Return the indices of each face's scene part, material and connected component, as three arrays (F,)."""
        mesh, nodes = self._mesh, nodes_of(self._mesh)
        scene_part, material = scene_parts_and_materials(mesh)
        return {
            "scene_part": scene_part,
            "material": material,
            "component": nodes.component[nodes.of_vertex[mesh.faces[:, 0]]],
        }

    def at(self, vertex: int, level: int = 0) -> VertexSet:
        """Return the part at a vertex, with its counterparts."""
        parts = self._deformer.bound.parts
        return self._found.get(
            "part", (vertex, level), lambda: VertexSet.of(self._mesh, parts.part(vertex, level).mask)
        )

    def ladder(self, vertex: int) -> tuple[LadderStep, ...]:
        """Return the parts at a vertex from the smallest to the largest, one for each level.

        Of neighboring levels with the same surface, only one is returned, level 0 if it is among them.
        """
        return self._found.get("ladder", (vertex, self._deformer.edit.symmetry), lambda: self._ladder(vertex))

    def _ladder(self, vertex: int) -> tuple[LadderStep, ...]:
        lowest, highest = self._deformer.bound.parts.levels(vertex)
        scene_part = self._scene_part(vertex)
        steps: list[LadderStep] = []
        before = None
        for level in range(lowest, highest + 1):
            step, inside = self._step(vertex, level, *scene_part)
            if before is None or (inside != before).any():
                steps.append(step)
            elif level == 0:
                steps[-1] = step
            before = inside
        texts = _distinct([(step.text, step.alike, step.share) for step in steps])
        return tuple(step.model_copy(update={"text": text}) for step, text in zip(steps, texts, strict=True))

    def text(self, handle: Handle) -> str:
        """Return the step of a handle's part in the words of the page: "5 of 7: 2 alike, 12 % of the surface"."""
        steps = self.ladder(self.origin(handle))
        index = _step_at(steps, handle.controls.level)
        return f"{index + 1} of {len(steps)}: {steps[index].text}"

    def _step(self, vertex: int, level: int, name: str, own: Bool) -> tuple[LadderStep, Bool]:
        """Return the part of a level, and its mesh nodes (N,). `name` and `own` are the result of `_scene_part`.

        The text is only the name: "the whole shape", the name of the scene part, or empty.
        """
        parts, nodes = self._deformer.bound.parts, nodes_of(self._mesh)
        component = parts.components(vertex, level)
        found = component is not None
        if component is None:  # no part at the vertex has a clear border
            component = np.full(len(nodes.component), -1)
            component[nodes.of_vertex[parts.part(vertex, level).vertices]] = 0
        inside, count = component >= 0, int(component.max()) + 1
        share = float(nodes.area @ inside / max(nodes.area.sum(), np.finfo(float).tiny))
        whole = bool(inside[nodes.used].all())
        same = any((own & part).sum() >= SAME * (own | part).sum() for part in (component == 0, inside))
        text = WHOLE if whole else name if same else ""
        # Edges of `graph` between components bridge small gaps. A component touches the part if a bridge joins them.
        held = np.isin(nodes.component, nodes.component[inside])
        leaves = not held[nodes.graph[inside].indices].all()
        step = LadderStep(level=level, text=text, share=share, alike=count, found=found or whole, leaves=leaves)
        return step, inside

    def _scene_part(self, vertex: int) -> tuple[str, Bool]:
        """Return the name of the scene part at a vertex, empty if there is only one, and its mesh nodes (N,)."""
        nodes, mesh = nodes_of(self._mesh), self._mesh
        own = np.zeros(len(nodes.component), bool)
        on = np.flatnonzero((mesh.faces == vertex).any(axis=1)) if len(mesh.parts) > 1 else np.empty(0, np.int64)
        if len(on) == 0:
            return "", own
        part = mesh.parts[int(self._labels["scene_part"][on[0]])]
        own[nodes.of_vertex[part.vertices]] = True
        return part.name, own

    def taken(self, handle: Handle, how: PartChange, vertex: int | None = None) -> dict[str, Any]:
        """Return the arguments of `Deformer.change` for the change `how` of a handle's part or region.

        "smaller" and "larger" change the level, and set the reach to "part". All others change the region, and set the
        level to 0. "add" and "remove" add or remove the part at `vertex`. If the mask is the handle's part or region,
        it changes too.

        Raises ValueError if there is no such part, `vertex` is missing, or the region would be empty.
        """
        step, origin = {"smaller": -1, "larger": 1}.get(how), self.origin(handle)
        if step is None:
            found = self._region(handle, how, vertex)
            self._origins[found] = origin
            given: dict[str, Any] = {"at": found, "level": 0}
        else:
            given = {"level": self.next_level(origin, handle.controls.level, step), "reach": "part"}
            if isinstance(handle.place.region, VertexSet):
                given["at"] = origin
        if self.limits(handle):
            given["mask"] = given["at"] if step is None else self.at(origin, given["level"])
        return given

    def next_level(self, vertex: int, level: int, step: int) -> int:
        """Return the level of the next step of the ladder. Raises ValueError if there is none."""
        steps = self.ladder(vertex)
        index = _step_at(steps, level) + step
        if not 0 <= index < len(steps):
            raise ValueError(f"There is no {'smaller' if step < 0 else 'larger'} part here")
        return steps[index].level

    def origin(self, handle: Handle) -> int:
        """Return the vertex of a handle, or the vertex at which its region was found."""
        anchor, region = self._deformer.bound.rows.anchor(handle.place), handle.place.region
        return self._origins.get(region, anchor) if isinstance(region, VertexSet) else anchor

    def _region(self, handle: Handle, how: PartChange, vertex: int | None) -> VertexSet:
        """Return a handle's region after the change `how`, which is not "smaller" or "larger"."""
        if how not in ("add", "remove"):
            return self._unit(self.origin(handle), how)
        if vertex is None:
            raise ValueError(f"To {how} a part, give a vertex of the part")
        own, part = members(self._mesh, self.of(handle)), self.at(vertex).indices
        chosen = np.union1d(own, part) if how == "add" else np.setdiff1d(own, part)
        if len(chosen) == 0:
            raise ValueError("The handle would move nothing: remove the handle instead")
        return VertexSet.of(self._mesh, chosen)

    def _unit(self, vertex: int, how: PartChange) -> VertexSet:
        """Return all vertices of the scene part, material or connected component at a vertex."""
        faces, label = self._mesh.faces, self._labels[how]
        on = np.flatnonzero((faces == vertex).any(axis=1))
        if len(on) == 0:
            raise ValueError(f"There is no {how.replace('_', ' ')} here")
        return VertexSet.of(self._mesh, np.unique(faces[label == label[on[0]]]))

    def of(self, handle: Handle) -> VertexSet:
        """Return the handle's region if it is a set of vertices, otherwise the part at the handle."""
        if isinstance(handle.place.region, VertexSet):
            return handle.place.region
        return self.at(self._deformer.bound.rows.anchor(handle.place), handle.controls.level)

    def limits(self, handle: Handle) -> bool:
        """Return whether the handle's mask is the handle's region or part."""
        mask = handle.controls.mask
        if not isinstance(mask, VertexSet):
            return False
        return mask == handle.place.region or mask == self.of(handle)


def _step_at(steps: Sequence[LadderStep], level: int) -> int:
    """Return the index of the step of a level. Levels beyond the ends stand for the last step there."""
    return next((index for index, step in enumerate(steps) if step.level >= level), len(steps) - 1)


def _distinct(steps: Sequence[tuple[str, int, float]]) -> list[str]:
    """Return texts that differ: name, number of components, and share with as few digits as make the text differ."""
    texts = [_described(*step, 0) for step in steps]
    for digits in range(1, 5):
        texts = [
            _described(*step, digits) if texts.count(text) > 1 else text
            for step, text in zip(steps, texts, strict=True)
        ]
    return texts


def _described(name: str, alike: int, share: float, digits: int) -> str:
    if name == WHOLE:
        return WHOLE
    return (
        f"{f'{name}, ' if name else ''}{f'{alike} alike, ' if alike > 1 else ''}{percent(share, digits)} of the surface"
    )
