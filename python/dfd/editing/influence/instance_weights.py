"""The columns of weights for posing: one for each handle, or one for each of its instances."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dfd.common.linear_algebra import Float32, Float64, Int64
from dfd.editing.edit import Edit, Handle
from dfd.editing.influence.allocation import HELD, carriers_of, following, shared
from dfd.editing.influence.instances import LEAST_ALIKE, Instance, InstanceFinder
from dfd.geometry.coarse import Share
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


class Portion(NamedTuple):
    """A portion of a handle's weights: that of one instance, or of all of them."""

    instance: Instance | None
    gain: float  # the weights are the handle's times the instance's share times this gain
    weights: Share


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
            portions: list[Share] = []
            columns: list[Column] = []
            for i, handle in enumerate(edit.handles):
                instances: tuple[Instance, ...] = ()
                if _told_apart(handle, edit):
                    instances = self.instances(handle, rows, edit.symmetry)
                own = self._portions(edit, handle, weights[:, i], instances, rows)
                if instances and _apart(handle):
                    columns += [Column(i, one, gain) for one, gain, _ in own]
                    portions += [part for _, _, part in own]
                else:
                    columns.append(Column(i, None))
                    portions.append(_sum([part for _, _, part in own], len(weights)))
            if self.allocating(edit):
                portions, columns = self._allocated(edit, weights, portions, columns, rows)
            made = np.zeros((len(columns), len(weights)), np.float32)
            for column, (vertices, values) in zip(made, portions, strict=True):
                column[vertices] = values
            self._made, self._key = (made.T, tuple(columns)), key
        return self._made

    @staticmethod
    def allocating(edit: Edit) -> tuple[int, ...]:
        """Return the handles among which components are divided: all that move, if there are several."""
        moving = [i for i, handle in enumerate(edit.handles) if not handle.transform.rests and _apart(handle)]
        return tuple(moving) if len(moving) > 1 and edit.rules.overlap == "add" else ()

    def _allocated(
        self, edit: Edit, weights: Float32, portions: list[Share], columns: list[Column], rows: HandleFeatures
    ) -> tuple[list[Share], list[Column]]:
        """Return `portions` (C) and `columns` after each component was given to one of the moving handles."""
        moving = self.allocating(edit)
        among = [i for i, column in enumerate(columns) if column.handle in moving]
        samples, sizes = self.finder.samples
        on_samples = np.stack([portions[i].dense(len(weights))[samples] for i in among])
        held = (on_samples >= HELD * on_samples.max(axis=1, keepdims=True)) & (on_samples > 0)
        same, nested = carriers_of(held, sizes)
        kept = following([columns[i].handle for i in among], same)
        same, nested = same[np.ix_(kept, kept)], nested[np.ix_(kept, kept)]
        kept = [among[k] for k in kept]
        handle_of = [columns[i].handle for i in kept]
        nested &= np.not_equal.outer(handle_of, handle_of)
        standing = {handle_of.index(i): rows.anchor(edit.handles[i].place) for i in dict.fromkeys(handle_of)}
        result = shared([portions[i] for i in kept], self._mesh.vertices, standing, same, nested)
        order = [i for i, column in enumerate(columns) if i in kept or column.handle not in moving]
        portions, columns = list(portions), list(columns)
        for k, i in enumerate(kept):
            column, (vertices, values) = columns[i], result[k]
            if column.instance is not None and result[k] is not portions[i]:
                whole = weights[vertices, column.handle] * np.float32(column.gain)
                share = np.divide(values, whole, out=np.zeros_like(whole), where=whole > 0)
                column = column._replace(instance=replace(column.instance, share=Share(vertices, share)))
            carriers = tuple(order.index(kept[j]) for j in np.flatnonzero(nested[k]))
            columns[i], portions[i] = column._replace(carriers=carriers), result[k]
        return [portions[i] for i in order], [columns[i] for i in order]

    def share(self, edit: Edit, handle: Handle, weights: Float32, rows: HandleFeatures) -> Float32:
        """(V,) what the instances of a handle that move have of its `weights` (V,), with their gains."""
        found = self._portions(edit, handle, weights, self.instances(handle, rows, edit.symmetry), rows)
        total = np.zeros(len(weights), np.float32)
        for instance, gain, _ in found:
            if instance is None or instance.share is None:
                total += np.float32(gain)
            else:
                total[instance.share.vertices] += np.float32(gain) * instance.share.values
        return total

    def switches(self, handle: Handle, instances: Sequence[Instance], rows: HandleFeatures) -> list[bool]:
        """Return which of a handle's instances are on: off are those at the places of `excluded_instances`.

        An instance is at a place where it has the largest share, or where none has one, if it is the nearest. The
        handle's own is always on.
        """
        on = [True] * len(instances)
        for place in handle.controls.excluded_instances:
            here = rows.anchor(place)
            shares = [one.share_at(here) for one in instances]
            if not any(shares):
                apart = [math.dist(one.position, self._mesh.vertices[here]) for one in instances]
                shares = [-distance for distance in apart]
            most = int(np.argmax(shares))
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
            vertex = rows.anchor(place)
            self._found[key] = self.finder.find(looks, vertex, place.position, held=held, grip=grip, planes=planes)
        return self._found[key]

    def _portions(
        self, edit: Edit, handle: Handle, weights: Float32, instances: Sequence[Instance], rows: HandleFeatures
    ) -> list[Portion]:
        """Return the portions of a handle's weights that move: all, or its instances that are on."""
        controls = handle.controls
        if not instances:
            return [_portion(None, weights)]
        if controls.instances == "only":
            return [_portion(instances[0], weights)]
        found = [_portion(one, weights) for one in instances]
        if edit.rules.equalize:
            near = self._near(edit, handle, np.array([one.vertex for one in instances]))
            found = _leveled(weights, found, near)
        on = self.switches(handle, instances, rows)
        return [portion for portion, is_on in zip(found, on, strict=True) if is_on]

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


def _portion(instance: Instance | None, weights: Float32) -> Portion:
    """Return the portion of an instance of the weights (V,) of a handle."""
    if instance is None or instance.share is None:
        some = np.flatnonzero(weights)
        return Portion(instance, 1.0, Share(some, weights[some]))
    vertices, values = instance.share
    return Portion(instance, 1.0, Share(vertices, weights[vertices] * values))


def _sum(portions: Sequence[Share], count: int) -> Share:
    """Return the sum of portions on `count` vertices, at most 1."""
    if len(portions) == 1:
        return portions[0]
    total = np.zeros(count, np.float32)
    for part in portions:
        total[part.vertices] += part.values
    some = np.flatnonzero(total)
    return Share(some, np.minimum(total[some], np.float32(1.0)))


def _leveled(weights: Float32, portions: Sequence[Portion], near: Float64) -> list[Portion]:
    """Return portions with gains that raise their weights to the handle's own, apart from their falloff `near` (N,).

    Gains compensate for less similar features and not for distance, since locality is meant to exclude what is far.
    Where the sum between two instances would exceed the maximum of `weights`, their shares are reduced.
    """
    found = []
    own = 0.0
    total = np.zeros(len(weights), np.float32)
    for (one, _, (vertices, values)), part in zip(portions, near, strict=True):
        assert one is not None
        top = float(weights[one.vertex]) / part if part > 0 else 0.0
        own = own or top
        alike = one.weight >= LEAST_ALIKE and top >= LEAST_LEVELED * own > 0
        gain = own / top if alike else 1.0
        found.append(Portion(one, gain, Share(vertices, values * np.float32(gain))))
        total[vertices] += found[-1].weights.values
    most = weights.max(initial=0.0)
    if (total <= most).all():
        return found
    less = np.divide(most, total, out=np.ones_like(total), where=total > most)
    result = []
    for one, gain, (vertices, values) in found:
        assert one is not None
        if one.share is None:
            share = Share(vertices, less[vertices])
        else:
            share = Share(one.share.vertices, one.share.values * less[one.share.vertices])
        result.append(Portion(replace(one, share=share), gain, Share(vertices, values * less[vertices])))
    return result
