"""Compute the weights of a session's handles, and keep them as long as their inputs do not change."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from dfd.common.errors import ArgumentError
from dfd.common.linear_algebra import Float32, Float64, Int64
from dfd.editing.controls import Controls
from dfd.editing.edit import Edit, Fixed, Handle
from dfd.editing.influence.distances import Distances
from dfd.editing.influence.handle_features import HandleFeatures
from dfd.editing.influence.held_parts import HeldPart, HeldParts
from dfd.editing.influence.instance_weights import Column, InstanceColumns, followed_by, wanted_of
from dfd.editing.influence.instances import Instance
from dfd.editing.points import Place
from dfd.editing.presets import PARTLESS_REACH, WITHIN_PART
from dfd.weights.bind import bind
from dfd.weights.compact import CompactFeatures

if TYPE_CHECKING:
    from dfd.editing.influence.instances import InstanceFinder
    from dfd.field.field import Field
    from dfd.mesh.mesh import Mesh
    from dfd.segmentation.parts import Grip, Parts
    from dfd.symmetry.plane import SymmetryPlane

# Weights are divided by the weight that fixed points leave at the handle. Below this value only noise would be scaled.
LEAST_LEFT = 0.01
LEAST_COUNTED = 0.35  # counterparts below this share of the handle's peak weight are not counted
# The reach "part" as a number: AROUND_PART times the MOST_OF_PART quantile of feature distances inside the part, and
# at least LEAST_REACH.
LEAST_REACH, MOST_OF_PART, AROUND_PART = 0.1, 0.9, 2.0

MOST_GRIPS = 32  # grips in the cache


class Key(NamedTuple):
    """Cache key: everything that changes a column of weights, besides the fixed points."""

    place: Place
    controls: Controls  # the controls that change the column
    sources: tuple[int, ...]  # the vertices where geodesic distances start; empty without locality
    bridges: bool  # whether these distances cross small gaps


class HandleWeights:
    """Weights on one mesh, a contiguous column per handle.

    A handle that only moves keeps its column. A new handle costs one column, new fixed points cost all columns.

    Parameters
    ----------
    mesh, field
        The shape, and the field that gives its features.
    features
        (V, D) features of the vertices, in full or compact. None evaluates the field at the first use.

    Raises ValueError if `features` is not finite or not one row of the field's width per vertex.
    """

    def __init__(self, mesh: Mesh, field: Field, features: Any = None) -> None:
        self.mesh = mesh
        self._rows = HandleFeatures(mesh, field, features)
        self._distances = Distances(mesh)
        self._instances = InstanceColumns(mesh, field, self._grip, self._near)
        self._limbs = HeldParts(mesh)
        self._columns = np.empty((0, len(mesh.vertices)), np.float32)  # (H, V), replaced whenever one changes
        self._keys: list[Key] = []
        self._fixed: tuple[Fixed, ...] = ()
        self._reach_targets = True
        self._held: Float32 | None = None  # (V,) what the fixed points take away, as long as they stay
        self._reaches: dict[Place, float] = {}
        self._grips: dict[Place, Grip | None] = {}
        self.field = field

    @property
    def features(self) -> Float32 | CompactFeatures:
        """(V, D) features of the vertices: those given, else in full up to 16,384 vertices and compact beyond."""
        return self._rows.features

    def prepare(self, progress: Callable[[int], object] | None = None) -> None:
        """Evaluate the field, unless that was done; `progress` is called with the number of rows after each block."""
        self._rows.prepare(progress)

    def asked(self, place: Place) -> Any:
        """Return what `dfd.bind` takes for a place: a vertex, a row of features, or a region."""
        return self._rows.points([place])

    @cached_property
    def parts(self) -> Parts:
        """The parts of the mesh."""
        from dfd.segmentation.parts import Parts  # slow to import, and not every session needs it

        return Parts(self.mesh, self._rows.of_vertices)

    @property
    def finder(self) -> InstanceFinder:
        """The finder of instances on the mesh."""
        return self._instances.finder

    def prepare_instances(
        self, planes: Sequence[SymmetryPlane], found: tuple[InstanceFinder, Parts] | None = None
    ) -> tuple[InstanceFinder, Parts]:
        """Compute and return what the first handle with instances needs, seconds for a million faces.

        `planes` are those that `symmetry_planes` finds. It may run on another thread than the rest. With `found`, what
        another session of the same mesh and field returned is taken instead.
        """
        if found is None:
            found = self.finder, self.parts
            for each in found:
                each.prepare()
        finder, self.parts = found
        self._instances.prepare(planes, finder)
        return found

    def of(self, edit: Edit) -> Float32:
        """Return (V, H) weights of the handles of `edit`, in their order. The array is read-only and never changes."""
        self._follow(edit)
        return self._columns.T

    def columns(self, edit: Edit) -> tuple[Float32, tuple[Column, ...]]:
        """Return (V, C) weights, one or more columns per handle, and the handle and instance of each column."""
        self._follow(edit)
        return self._instances.of(edit, self._columns.T, self._keys, self._rows)

    def held_parts(self, edit: Edit, handle: Handle) -> list[HeldPart]:
        """Return the connected parts that follow a handle of `edit`, its own part first."""
        weights, columns = self.columns(edit)
        number = next(i for i, each in enumerate(edit.handles) if each.id == handle.id)
        moving = self.allocating(edit)
        others = tuple((each.place, each.controls) for each in edit.handles) if moving else ()
        key = (self._keys[number], wanted_of(handle), edit.fixed, edit.preset, edit.symmetry, others, moving)
        own = [(weights[:, i], column) for i, column in enumerate(columns) if column.handle == number]
        return self._limbs.of(key, handle, self.anchor(handle), own, edit.symmetry)

    def bent(self, edit: Edit) -> Float64:
        """Return (V, 3) the resting vertices after the bends and twists of the handles of `edit`."""
        bending = {i: self.held_parts(edit, handle) for i, handle in enumerate(edit.handles) if handle.transform.bends}
        return self._limbs.bent(edit, bending) if bending else self.mesh.vertices

    def following(self, edit: Edit) -> Float32:
        """Return (V, H) weights, each the sum over all instances of a handle."""
        weights, columns = self.columns(edit)
        return followed_by(weights, columns, len(edit.handles))

    def allocating(self, edit: Edit) -> tuple[int, ...]:
        """Return the handles among which components are divided: all that move, if there are several."""
        return self._instances.allocating(edit)

    def instances(self, edit: Edit, handle: Handle) -> list[tuple[Instance, bool]]:
        """Return the instances of a handle, its own first, and whether each moves with the handle."""
        found = self._instances.instances(handle, self._rows, edit.symmetry)
        return list(zip(found, self._instances.switches(handle, found, self._rows), strict=True))

    def instance_share(self, edit: Edit, handle: Handle) -> Float32:
        """Return (V,) the share of a handle's weight on instances that move with it; gains can make it exceed 1."""
        self._follow(edit)
        number = next(i for i, each in enumerate(edit.handles) if each.id == handle.id)
        return self._instances.share(edit, handle, self._columns[number], self._rows)

    def instance_counts(self, edit: Edit) -> list[int]:
        """Return (H,) the number of instances of each handle whose peak weight is at least `LEAST_COUNTED`."""
        weights, columns = self.columns(edit)
        most = weights.max(axis=0, initial=0.0)
        own = [
            max((most[i] for i, column in enumerate(columns) if column.handle == h), default=0.0)
            for h in range(len(edit.handles))
        ]
        follows = [
            column.handle
            for column, top in zip(columns, most, strict=True)
            if top >= LEAST_COUNTED * own[column.handle]
        ]
        return [max(follows.count(h), 1) for h in range(len(edit.handles))]

    def anchor(self, handle: Handle) -> int:
        """Return the vertex that stands for a handle: its own, the nearest one, or the middle of its region."""
        return self._rows.anchor(handle.place)

    def reach(self, handle: Handle) -> float:
        """Return the handle's `reach` as a number; for "part" the number that comes nearest to it."""
        place = handle.place
        if handle.controls.reach != "part":
            return handle.controls.reach
        if place not in self._reaches and (part := self.part(place)) is not None:
            within = self._apart(place)[part > 0.5]
            widest = float(np.quantile(within, MOST_OF_PART)) if len(within) else 0.0
            self._reaches[place] = min(max(AROUND_PART * widest, LEAST_REACH), 2.0)
        return self._reaches.get(place, PARTLESS_REACH)

    def locality(self, edit: Edit, handle: Handle) -> tuple[tuple[int, ...], Float32 | None, float]:
        """Return where geodesic distances of a handle start, (V,) distances in [0, 1] or None, and λ of Eq. 7."""
        key = self._key(handle, edit)
        distances, power = self._distances.falloff(key.sources, key.controls, key.bridges)
        return key.sources, None if distances is None else distances[0], power

    def _near(self, edit: Edit, handle: Handle, vertices: Int64) -> Float64:
        """Return (N,) the falloff (1 − G)^λ of a handle at vertices (N,)."""
        _, distances, power = self.locality(edit, handle)
        return np.ones(len(vertices)) if distances is None else (1.0 - distances[vertices].astype(np.float64)) ** power

    def held(self, edit: Edit) -> Float32:
        """Return (V,) max_p s_p W_p of Eq. 6: the weight that the fixed points of `edit` subtract."""
        self._follow(edit)
        return self._held_weights()

    def gain(self, edit: Edit, handle: Handle) -> float:
        """Return the factor of a handle's weights by which the handle arrives despite fixed points."""
        if not edit.fixed or not edit.rules.reach_targets:
            return 1.0
        vertex = handle.place.vertex
        left = self.left(edit, handle) if vertex is None else 1.0 - float(self.held(edit)[vertex])
        return 1.0 / left if left >= LEAST_LEFT else 1.0

    def left(self, edit: Edit, handle: Handle) -> float:
        """Return the weight, in [0, 1], that the fixed points of `edit` leave `handle` at the handle itself (Eq. 6)."""
        held = 0.0
        own = self._rows.of([handle.place])
        for fixed in edit.fixed:
            if self._rows.holds(fixed.place, handle.place):
                held = max(held, fixed.strength)
            apart = np.linalg.norm(own[:, None] - self._rows.of([fixed.place])[None], axis=2)
            held = max(held, fixed.strength * (1.0 - float(apart.min(axis=1).max())))
        return 1.0 - held

    def check_arrivals(self, edit: Edit) -> None:
        """Raise ValueError if fixed points leave a handle no weight at the handle itself."""
        if not edit.rules.reach_targets or not edit.fixed:
            return
        for handle in edit.handles:
            left = self.left(edit, handle)
            if left < LEAST_LEFT:
                raise ArgumentError(
                    "fixed",
                    f"must leave something of handle {handle.id} at {handle.place}, but leaves {left:.2g}: "
                    "what is fixed looks just like it; lower its strength, or fix something else",
                )

    def _follow(self, edit: Edit) -> None:
        """Make `_columns` the columns of the handles of `edit`, in their order."""
        if (edit.fixed, edit.rules.reach_targets) != (self._fixed, self._reach_targets):
            self._keys, self._held, self._fixed, self._reach_targets = [], None, edit.fixed, edit.rules.reach_targets
            self._columns = self._columns[:0]
        keys = [self._key(handle, edit) for handle in edit.handles]
        if keys == self._keys:
            return
        row_of = {key: row for row, key in enumerate(self._keys)}
        columns = np.empty((len(keys), len(self.mesh.vertices)), np.float32)
        for key, row in zip(keys, columns, strict=True):
            if key in row_of:
                row[:] = self._columns[row_of[key]]
            else:
                self._bind(key, row)
        columns.flags.writeable = False
        self._keys, self._columns = keys, columns
        self._distances.keep({source for key in keys for source in key.sources})

    def _key(self, handle: Handle, edit: Edit) -> Key:
        controls = handle.controls.of_column
        near = controls.locality > 0 or controls.radius is not None
        plane = edit.symmetry if edit.rules.mirrored_locality else None
        sources = self._distances.sources(self._rows.vertices(handle.place), handle.place, plane) if near else ()
        return Key(handle.place, controls, sources, edit.rules.bridges and near)

    def _bind(self, key: Key, column: Float32) -> None:
        """Write the weights (V,) of a handle to `column` (Eq. 4 to 7)."""
        geodesic, locality = self._distances.falloff(key.sources, key.controls, key.bridges)
        bind(
            self.features,
            self._rows.points([key.place]),
            fixed=self._rows.points([fixed.place for fixed in self._fixed]) if self._fixed else None,
            strength=[fixed.strength for fixed in self._fixed] if self._fixed else None,
            geodesic=geodesic,
            locality=locality,
            reach=self._reach(key.place, key.controls),
            falloff=key.controls.falloff,
            out=column[None].T,
        )
        self._finish(key, column)

    def _finish(self, key: Key, column: Float32) -> None:
        """Apply the part, regions, arrival, strength and mask to a column.

        Samples of a region stood for it in Eq. 4; here all of its vertices get the weight of the nearest sample.
        """
        if key.controls.reach == "part" and (part := self._instances.part(key.place, self._rows)) is not None:
            column *= part
        if key.place.region is not None:
            own = self._rows.members(key.place)
            free = 1.0 - self._held_weights()[own] if self._fixed else np.float32(1.0)
            column[own] = np.maximum(column[own], free)
        for fixed in self._fixed:
            if fixed.place.region is not None:
                held = self._rows.members(fixed.place)
                column[held] = np.minimum(column[held], 1.0 - fixed.strength)
        if self._fixed and self._reach_targets:
            left = self._left_of(key, column)
            if left >= LEAST_LEFT:
                np.minimum(column / np.float32(left), 1.0, out=column)
        if key.controls.strength < 1.0:
            column *= np.float32(key.controls.strength)
        if key.controls.mask is not None:
            column *= self._rows.inside(key.controls.mask, key.controls.mask_feather)

    def part(self, place: Place) -> Float32 | None:
        """Return (V,) 1 on the part at a place and its counterparts, falling to 0; None if there is no part."""
        grip = self._grip(place)
        return None if grip is None else grip.weights

    def _grip(self, place: Place) -> Grip | None:
        if place not in self._grips:
            while len(self._grips) >= MOST_GRIPS:  # hovering asks for many
                del self._grips[next(iter(self._grips))]
            self._grips[place] = self.parts.grip(self._rows.anchor(place))
        return self._grips[place]

    def _left_of(self, key: Key, column: Float32) -> float:
        """Return the weight of a column at its own handle."""
        if key.place.vertex is not None:
            return float(column[key.place.vertex])
        if key.place.region is not None:
            return float(column[self._rows.members(key.place)].max())
        return self.left(Edit(fixed=self._fixed), Handle(1, key.place))

    def _held_weights(self) -> Float32:
        """Return (V,) max_p s_p W_p of Eq. 6: the weight that the fixed points subtract."""
        if self._held is None:
            self._held = np.zeros(len(self.mesh.vertices), np.float32)
            one = np.empty((len(self._held), 1), np.float32, order="F")
            for fixed in self._fixed:
                bind(self.features, self._rows.points([fixed.place]), out=one)
                np.maximum(self._held, np.float32(fixed.strength) * one[:, 0], out=self._held)
                if fixed.place.region is not None:
                    held = self._rows.members(fixed.place)
                    self._held[held] = np.maximum(self._held[held], np.float32(fixed.strength))
        return self._held

    def _reach(self, place: Place, controls: Controls) -> float:
        if controls.reach != "part":
            return controls.reach
        return WITHIN_PART if self.part(place) is not None else PARTLESS_REACH

    def _apart(self, place: Place) -> Float32:
        """Return (V,) feature distances from a place. Unit features differ by at most 2, so a reach of 2 cuts none."""
        return 2.0 * (1.0 - bind(self.features, self._rows.points([place]), reach=2.0)[:, 0])
