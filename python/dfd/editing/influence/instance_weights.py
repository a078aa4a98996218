"""The columns of weights for posing: one for each handle, or one for each of its instances."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dfd.common.linear_algebra import Float32, Float64, Int64
from dfd.editing.edit import Edit, Handle
from dfd.editing.influence.allocation import HELD, carriers_of, following, shared
from dfd.editing.influence.instances import LEAST_ALIKE, Instance, InstanceFinder
from dfd.geometry.coarse import SliceWeights
from dfd.posing.transforms import Vector
from dfd.symmetry.search import symmetry_planes
from dfd.weights.bind import bind

if TYPE_CHECKING:
    from dfd.editing.influence.handle_features import HandleFeatures
    from dfd.editing.points import Place
    from dfd.field.field import Field
    from dfd.mesh.mesh import Mesh
    from dfd.segmentation.parts import Grip
    from dfd.symmetry.plane import SymmetryPlane

MOST_FOUND = 16  # places in the cache of instances
LEAST_LEVELED = 0.1  # `equalize` leaves instances alone that have less than this share of the handle's own weight

Portion = tuple[Instance | None, float]  # an instance, or None for all of them, and the gain of its weights


class Column(NamedTuple):
    """The handle and the instance of a column of weights."""

    handle: int  # the number of the handle in the edit
    instance: Instance | None  # None if the handle's own transform applies
    gain: float = 1.0  # the column is the handle's weights times the instance's share times this gain
    carriers: tuple[int, ...] = ()  # the columns of other handles in whose components its own is nested

    def matrix(self, handle: Handle) -> Float64:
        """Return the (3, 4) transform of the column, mesh units: the handle's own in the instance's frame."""
        if self.instance is None:
            return handle.matrix
        return self.instance.transform(handle.matrix, handle.place.position)

    @property
    def image(self) -> Float64 | None:
        """(3, 4) the isometry from the handle's own component, if they are mirror images."""
        return None if self.instance is None else self.instance.image

    def vertex(self, anchor: int) -> int:
        """Return the vertex of the instance, or `anchor`, the vertex of the handle."""
        return anchor if self.instance is None else self.instance.vertex

    def position(self, handle: Handle) -> Vector:
        """Return the position (3,) of the instance or the handle, mesh units. It has a side of a mirror plane."""
        return handle.place.position if self.instance is None else self.instance.position


class InstanceColumns:
    """Make the columns of one mesh, and keep them as long as their inputs do not change."""

    def __init__(
        self,
        mesh: Mesh,
        field: Field,
        grip: Callable[[Place], Grip | None],
        near: Callable[[Edit, Handle, Int64], Float64],
    ) -> None:
        """`grip` finds the part that a handle at a place holds, `near` its falloff (1 − G)^λ at vertices."""
        self._mesh = mesh
        self._field = field
        self._grip = grip
        self._near = near
        self.finder = InstanceFinder(mesh)
        self._found: dict[Hashable, tuple[tuple[Instance, ...], Float32 | None]] = {}
        self._key: Hashable = None
        self._made: tuple[Float32, tuple[Column, ...]] | None = None

    def prepare(self, planes: Sequence[SymmetryPlane], finder: InstanceFinder) -> None:
        """Take a prepared finder, and the planes that `symmetry_planes` finds."""
        self._planes, self.finder = list(planes), finder

    def of(
        self, edit: Edit, weights: Float32, keys: Sequence[Hashable], rows: HandleFeatures
    ) -> tuple[Float32, tuple[Column, ...]]:
        """Return (V, C) weights, and the handle and instance of each column.

        `weights` (V, H) are those of the handles, `keys` (H) are their cache keys.
        """
        if not any(_told_apart(handle, edit) for handle in edit.handles):
            return weights, tuple(Column(i, None) for i in range(len(edit.handles)))
        about = (edit.fixed, edit.preset, edit.symmetry)
        wanted = [wanted_of(handle) for handle in edit.handles]
        key = (about, tuple(zip(keys, wanted, strict=True)), self.allocating(edit))
        if self._made is None or key != self._key:
            self._made = None  # free its memory first
            parts: list[list[Portion]] = []
            columns: list[Column] = []
            for i, handle in enumerate(edit.handles):
                instances: tuple[Instance, ...] = ()
                if _told_apart(handle, edit):
                    instances = self.instances(handle, rows, edit.symmetry)
                own = self._parts(edit, handle, weights[:, i], instances, rows)
                apart = bool(instances) and _apart(handle)
                parts += [[part] for part in own] if apart else [own]
                columns += [Column(i, *part) for part in own] if apart else [Column(i, None)]
            made = np.zeros((len(columns), len(weights)), np.float32)
            for out, column, added in zip(made, columns, parts, strict=True):
                for part in added:
                    out += _weights_of(part, weights[:, column.handle])
                if column.instance is None:
                    np.minimum(out, np.float32(1.0), out=out)
            if self.allocating(edit):
                made, columns = self._allocated(edit, weights, made, columns, rows)
            self._made, self._key = (made.T, tuple(columns)), key
        return self._made

    @staticmethod
    def allocating(edit: Edit) -> tuple[int, ...]:
        """Return the handles among which components are divided: all that move, if there are several."""
        moving = [i for i, handle in enumerate(edit.handles) if not handle.transform.rests and _apart(handle)]
        return tuple(moving) if len(moving) > 1 and edit.rules.overlap == "add" else ()

    def _allocated(
        self, edit: Edit, weights: Float32, made: Float32, columns: list[Column], rows: HandleFeatures
    ) -> tuple[Float32, list[Column]]:
        """Return `made` (C, V) and `columns` after each component was given to one of the moving handles."""
        among = [i for i, column in enumerate(columns) if column.handle in self.allocating(edit)]
        own = made[among]
        samples, sizes = self.finder.samples
        on_samples = own[:, samples]
        held = (on_samples >= HELD * on_samples.max(axis=1, keepdims=True)) & (on_samples > 0)
        same, nested = carriers_of(held, sizes)
        handle_of = [columns[i].handle for i in among]
        kept = following(handle_of, same)
        same, nested = same[np.ix_(kept, kept)], nested[np.ix_(kept, kept)]
        left = [handle_of[i] for i in kept]
        nested &= np.not_equal.outer(left, left)
        standing = {left.index(handle): handle for handle in dict.fromkeys(left)}
        anchors = np.array([rows.anchor(handle.place) for handle in edit.handles], np.int64)
        result = shared(own[kept], self._mesh.vertices, standing, anchors, same, nested)
        others = [i for i in range(len(columns)) if i not in among]
        places = {k: len(others) + k for k in range(len(kept))}
        found = [columns[i] for i in others]
        for k, i in enumerate(kept):
            column = columns[among[i]]
            carriers = tuple(places[int(j)] for j in np.flatnonzero(nested[k]))
            whole = weights[:, column.handle] * np.float32(column.gain)
            if column.instance is not None and not np.array_equal(result[k], own[i]):
                part = np.divide(result[k], whole, out=np.zeros_like(whole), where=whole > 0)
                column = column._replace(instance=replace(column.instance, share_of=part.__getitem__))
            found.append(column._replace(carriers=carriers))
        order = sorted(range(len(found)), key=lambda i: found[i].handle)  # stable: a handle's own column is its first
        at = {before: after for after, before in enumerate(order)}
        made = np.concatenate([made[others], result])[order]
        return made, [found[i]._replace(carriers=tuple(at[carrier] for carrier in found[i].carriers)) for i in order]

    def share(self, edit: Edit, handle: Handle, weights: Float32, rows: HandleFeatures) -> Float32:
        """(V,) what the instances of a handle that move have of its `weights` (V,), with their gains."""
        total = np.zeros(len(weights), np.float32)
        ones = np.ones(len(weights), np.float32)
        for part in self._parts(edit, handle, weights, self.instances(handle, rows, edit.symmetry), rows):
            total += _weights_of(part, ones)
        return total

    def switches(self, handle: Handle, instances: Sequence[Instance], rows: HandleFeatures) -> list[bool]:
        """Which of a handle's instances are on: off are those that have the most of a place in `excluded_instances`.

        Its own always is.
        """
        on = [True] * len(instances)
        for place in handle.controls.excluded_instances:
            here = rows.anchor(place)
            most = int(np.argmax([one.share_at(here) for one in instances]))
            on[most] = most == 0
        return on

    def instances(self, handle: Handle, rows: HandleFeatures, symmetry: SymmetryPlane | None) -> tuple[Instance, ...]:
        """Return the instances of a handle by features alone, mirrored across the chosen plane or found planes."""
        return self._looked_up(handle.place, handle.controls.reach == "part", symmetry, rows)[0]

    def part(self, place: Place, rows: HandleFeatures) -> Float32 | None:
        """Return (V,) 1 on the part at a place, equal on mirror images, falling to 0; None if there is no part."""
        return None if self._grip(place) is None else self._looked_up(place, True, None, rows)[1]

    def _looked_up(
        self, place: Place, by_part: bool, symmetry: SymmetryPlane | None, rows: HandleFeatures
    ) -> tuple[tuple[Instance, ...], Float32 | None]:
        """Return the instances at a place, and (V,) the weights of the part if `by_part` and there is one."""
        key = (place, by_part, symmetry)
        if key not in self._found:
            while len(self._found) >= MOST_FOUND:
                del self._found[next(iter(self._found))]
            grip = self._grip(place) if by_part else None
            looks: Float32 = bind(rows.features, rows.points([place]))[:, 0]
            planes = self._planes if symmetry is None else [symmetry]
            held = None if place.region is None else rows.members(place)
            vertex, pieces = rows.anchor(place), None if grip is None else grip.pieces
            found = self.finder.find(looks, vertex, place.position, held=held, pieces=pieces, planes=planes)
            self._found[key] = (found, None) if grip is None else self.finder.as_images(found, grip.weights)
        return self._found[key]

    def _parts(
        self, edit: Edit, handle: Handle, weights: Float32, instances: Sequence[Instance], rows: HandleFeatures
    ) -> list[Portion]:
        """Return the portions of a handle's weights that move: all, or its instances that are on."""
        controls = handle.controls
        if not instances:
            return [(None, 1.0)]
        if controls.instances == "only":
            return [(instances[0], 1.0)]
        gains = [1.0] * len(instances)
        if edit.rules.equalize:
            near = self._near(edit, handle, np.array([one.vertex for one in instances]))
            instances, gains = _leveled(weights, instances, near)
        on = self.switches(handle, instances, rows)
        return [(one, gain) for one, gain, is_on in zip(instances, gains, on, strict=True) if is_on]

    @cached_property
    def _planes(self) -> list[SymmetryPlane]:
        return symmetry_planes(self._field, self._mesh)


def followed_by(weights: Float32, columns: tuple[Column, ...], count: int) -> Float32:
    """Return (V, H) weights of `count` handles, the sums of their columns among (V, C)."""
    followed = np.zeros((len(weights), count), np.float32)
    for index, column in enumerate(columns):
        followed[:, column.handle] += weights[:, index]
    return followed


def wanted_of(handle: Handle) -> Hashable:
    """Return what changes the columns of a handle, besides its weights."""
    controls = handle.controls
    return controls.instances, controls.excluded_instances


def _apart(handle: Handle) -> bool:
    """Return whether each instance of a handle has its own column."""
    return handle.controls.instances != "shared_pivot"


def _told_apart(handle: Handle, edit: Edit) -> bool:
    """Return whether the instances of a handle change its columns."""
    controls = handle.controls
    return _apart(handle) or edit.rules.equalize or controls.excluded_instances != ()


def _weights_of(part: Portion, weights: Float32) -> Float32:
    """Return the portion of the weights (V,) of a handle."""
    instance, gain = part
    share = None if instance is None else instance.share
    own = weights if share is None else weights * share
    return own if gain == 1.0 else own * np.float32(gain)


def _leveled(weights: Float32, instances: Sequence[Instance], near: Float64) -> tuple[list[Instance], list[float]]:
    """Return instances, and gains that raise their weights to the handle's own, apart from their falloff `near` (N,).

    Gains compensate for less similar features and not for distance, since locality is meant to exclude what is far.
    Where the sum between two instances would exceed the maximum of `weights`, their shares are reduced.
    """
    tops = [float(weights[one.vertex]) / part if part > 0 else 0.0 for one, part in zip(instances, near, strict=True)]
    alike = [one.weight >= LEAST_ALIKE and tops[i] >= LEAST_LEVELED * tops[0] > 0 for i, one in enumerate(instances)]
    gains = [tops[0] / top if is_alike else 1.0 for top, is_alike in zip(tops, alike, strict=True)]
    total = np.zeros(len(weights), np.float32)
    for part in zip(instances, gains, strict=True):
        total += _weights_of(part, weights)
    most = weights.max(initial=0.0)
    if (total <= most).all():
        return list(instances), gains
    less = np.divide(most, total, out=np.ones_like(total), where=total > most)

    def lessened(share_of: SliceWeights | None) -> SliceWeights:
        return lambda some: less[some] if share_of is None else share_of(some) * less[some]

    return [replace(one, share_of=lessened(one.share_of)) for one in instances], gains
