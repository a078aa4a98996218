"""The columns of weights by which a session poses: one for each handle, or one for each of its counterparts."""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from dfd.common.linear_algebra import Float32, Float64
from dfd.editing.edit import Edit, Handle
from dfd.editing.influence.allocation import HELD, carriers_of, following, shared
from dfd.editing.influence.counterparts import LEAST_ALIKE, Column, Counterpart
from dfd.editing.influence.feature_weights import FeatureWeights
from dfd.editing.influence.grips import Grips
from dfd.editing.influence.handle_features import HandleFeatures
from dfd.editing.influence.held_parts import HeldPart, HeldParts
from dfd.editing.influence.recent import Recent
from dfd.geometry.coarse import Share

if TYPE_CHECKING:
    from dfd.field.field import Field
    from dfd.mesh.mesh import Mesh

LEAST_COUNTED = 0.35  # counterparts below this share of the handle's peak weight are not counted
LEAST_LEVELED = 0.1  # `equalize` leaves counterparts alone that have less than this share of the handle's own weight


class Portion(NamedTuple):
    """A portion of a handle's weights: that of one counterpart, or of all of them."""

    counterpart: Counterpart | None
    gain: float  # the weights are the handle's times the counterpart's share times this gain
    weights: Share


class HandleWeights:
    """Weights of the handles of edits of one mesh.

    Parameters
    ----------
    mesh, field
        The shape, and the field that gives its features.
    features
        (V, D) features of the vertices, in full or compact. None evaluates the field at the first use.

    Attributes
    ----------
    rows
        The features of vertices and places.
    grips
        The parts and counterparts at places.
    by_features
        The weights of Eq. 4 to 7, a column per handle.

    Raises ValueError if `features` is not finite or not one row of the field's width per vertex.
    """

    def __init__(self, mesh: Mesh, field: Field, features: Any = None) -> None:
        self.mesh, self.field = mesh, field
        self.rows = HandleFeatures(mesh, field, features)
        self.grips = Grips(mesh, field, self.rows)
        self.by_features = FeatureWeights(mesh, self.rows, self.grips)
        self._held_parts = HeldParts(mesh)
        self._made: Recent[tuple[Float32, tuple[Column, ...]]] = Recent(1)

    def columns(self, edit: Edit) -> tuple[Float32, tuple[Column, ...]]:
        """Return (V, C) weights, one or more columns per handle, and the handle and counterpart of each column."""
        weights, keys = self.by_features.of(edit)
        if not any(_told_apart(handle, edit) for handle in edit.handles):
            return weights, tuple(Column(i, None) for i in range(len(edit.handles)))
        handles = [(key, *_chosen(handle)) for key, handle in zip(keys, edit.handles, strict=True)]
        key = (edit.fixed, edit.preset, edit.symmetry, tuple(handles), self.allocating(edit))
        return self._made.get(key, lambda: self._columns(edit, weights))

    def _columns(self, edit: Edit, weights: Float32) -> tuple[Float32, tuple[Column, ...]]:
        portions: list[Share] = []
        columns: list[Column] = []
        for i, handle in enumerate(edit.handles):
            found = self._portions(edit, handle, weights[:, i])
            if found[0].counterpart is not None and _apart(handle):
                columns += [Column(i, one, gain) for one, gain, _ in found]
                portions += [part for _, _, part in found]
            else:
                columns.append(Column(i, None))
                portions.append(_sum([part for _, _, part in found], len(weights)))
        if self.allocating(edit):
            portions, columns = self._allocated(edit, weights, portions, columns)
        made = np.zeros((len(columns), len(weights)), np.float32)
        for column, (vertices, values) in zip(made, portions, strict=True):
            column[vertices] = values
        return made.T, tuple(columns)

    def following(self, edit: Edit) -> Float32:
        """Return (V, H) weights, each the sum over all counterparts of a handle."""
        weights, columns = self.columns(edit)
        followed = np.zeros((len(weights), len(edit.handles)), np.float32)
        for index, column in enumerate(columns):
            followed[:, column.handle] += weights[:, index]
        return followed

    def held_parts(self, edit: Edit, handle: Handle) -> list[HeldPart]:
        """Return the connected parts that follow a handle of `edit`, its own part first."""
        weights, columns = self.columns(edit)
        number = next(i for i, each in enumerate(edit.handles) if each.id == handle.id)
        moving = self.allocating(edit)
        others = tuple((each.place, each.controls) for each in edit.handles) if moving else ()
        own_key = self.by_features.of(edit)[1][number], *_chosen(handle)
        key = (own_key, edit.fixed, edit.preset, edit.symmetry, others, moving)
        own = [(weights[:, i], column) for i, column in enumerate(columns) if column.handle == number]
        return self._held_parts.of(key, handle, self.rows.anchor(handle.place), own, edit.symmetry)

    def bent(self, edit: Edit) -> Float64:
        """Return (V, 3) the resting vertices after the bends and twists of the handles of `edit`."""
        bending = {i: self.held_parts(edit, handle) for i, handle in enumerate(edit.handles) if handle.transform.bends}
        return self._held_parts.bent(edit, bending) if bending else self.mesh.vertices

    def counterparts(self, edit: Edit, handle: Handle) -> list[tuple[Counterpart, bool]]:
        """Return the counterparts of a handle, its own first, and whether each moves with the handle."""
        found = self._counterparts(edit, handle)
        return list(zip(found, self._switches(handle, found), strict=True))

    def counterpart_share(self, edit: Edit, handle: Handle) -> Float32:
        """Return (V,) the share of a handle's weight on counterparts that move with it; gains can make it exceed 1."""
        number = next(i for i, each in enumerate(edit.handles) if each.id == handle.id)
        total = np.zeros(len(self.mesh.vertices), np.float32)
        for counterpart, gain, _ in self._portions(edit, handle, self.by_features.of(edit)[0][:, number]):
            if counterpart is None or counterpart.share is None:
                total += np.float32(gain)
            else:
                total[counterpart.share.vertices] += np.float32(gain) * counterpart.share.values
        return total

    def counterpart_counts(self, edit: Edit) -> list[int]:
        """Return (H,) the number of counterparts of each handle whose peak weight is at least `LEAST_COUNTED`."""
        weights, columns = self.columns(edit)
        peaks: list[list[float]] = [[] for _ in edit.handles]
        for column, peak in zip(columns, weights.max(axis=0, initial=0.0).tolist(), strict=True):
            peaks[column.handle].append(peak)
        return [max(sum(peak >= LEAST_COUNTED * max(own) for peak in own), 1) if own else 1 for own in peaks]

    @staticmethod
    def allocating(edit: Edit) -> tuple[int, ...]:
        """Return the handles among which components are divided: all that move, if there are several."""
        moving = [i for i, handle in enumerate(edit.handles) if not handle.transform.rests and _apart(handle)]
        return tuple(moving) if len(moving) > 1 and edit.rules.overlap == "add" else ()

    def _allocated(
        self, edit: Edit, weights: Float32, portions: list[Share], columns: list[Column]
    ) -> tuple[list[Share], list[Column]]:
        """Return `portions` (C) and `columns` after each component was given to one of the moving handles."""
        moving = self.allocating(edit)
        among = [i for i, column in enumerate(columns) if column.handle in moving]
        samples, sizes = self.grips.finder.samples
        on_samples = np.stack([portions[i].dense(len(weights))[samples] for i in among])
        held = (on_samples >= HELD * on_samples.max(axis=1, keepdims=True)) & (on_samples > 0)
        same, nested = carriers_of(held, sizes)
        kept = following([columns[i].handle for i in among], same)
        same, nested = same[np.ix_(kept, kept)], nested[np.ix_(kept, kept)]
        kept = [among[k] for k in kept]
        handle_of = [columns[i].handle for i in kept]
        nested &= np.not_equal.outer(handle_of, handle_of)
        standing = {handle_of.index(i): self.rows.anchor(edit.handles[i].place) for i in dict.fromkeys(handle_of)}
        result = shared([portions[i] for i in kept], self.mesh.vertices, standing, same, nested)
        order = [i for i, column in enumerate(columns) if i in kept or column.handle not in moving]
        portions, columns = list(portions), list(columns)
        for k, i in enumerate(kept):
            column, (vertices, values) = columns[i], result[k]
            if column.counterpart is not None and result[k] is not portions[i]:
                whole = weights[vertices, column.handle] * np.float32(column.gain)
                share = np.divide(values, whole, out=np.zeros_like(whole), where=whole > 0)
                column = column._replace(counterpart=replace(column.counterpart, share=Share(vertices, share)))
            carriers = tuple(order.index(kept[j]) for j in np.flatnonzero(nested[k]))
            columns[i], portions[i] = column._replace(carriers=carriers), result[k]
        return [portions[i] for i in order], [columns[i] for i in order]

    def _counterparts(self, edit: Edit, handle: Handle) -> tuple[Counterpart, ...]:
        everywhere = handle.controls.reach != "part"
        return self.grips.held(handle.place, everywhere=everywhere, plane=edit.symmetry).counterparts

    def _switches(self, handle: Handle, counterparts: Sequence[Counterpart]) -> list[bool]:
        """Return which of a handle's counterparts are on: off are those at the places of `excluded_counterparts`.

        A counterpart is at a place where it has the largest share, or where none has one, if it is the nearest. The
        handle's own is always on.
        """
        on = [True] * len(counterparts)
        for place in handle.controls.excluded_counterparts:
            here = self.rows.anchor(place)
            shares = [one.share_at(here) for one in counterparts]
            if not any(shares):
                shares = [-math.dist(one.position, self.mesh.vertices[here]) for one in counterparts]
            most = int(np.argmax(shares))
            on[most] = most == 0
        return on

    def _portions(self, edit: Edit, handle: Handle, weights: Float32) -> list[Portion]:
        """Return the portions of a handle's weights (V,) that move: all, or its counterparts that are on."""
        if not _told_apart(handle, edit):
            return [_portion(None, weights)]
        counterparts = self._counterparts(edit, handle)
        if handle.controls.counterparts == "only":
            return [_portion(counterparts[0], weights)]
        found = [_portion(one, weights) for one in counterparts]
        if edit.rules.equalize:
            near = self.by_features.near(edit, handle, np.array([one.vertex for one in counterparts]))
            found = _leveled(weights, found, near)
        on = self._switches(handle, counterparts)
        return [portion for portion, is_on in zip(found, on, strict=True) if is_on]


def _chosen(handle: Handle) -> tuple[Hashable, ...]:
    """Return what changes the columns of a handle, besides its weights."""
    return handle.controls.counterparts, handle.controls.excluded_counterparts


def _apart(handle: Handle) -> bool:
    """Return whether each counterpart of a handle has its own column."""
    return handle.controls.counterparts != "shared_pivot"


def _told_apart(handle: Handle, edit: Edit) -> bool:
    """Return whether the counterparts of a handle change its columns."""
    return _apart(handle) or edit.rules.equalize or handle.controls.excluded_counterparts != ()


def _portion(counterpart: Counterpart | None, weights: Float32) -> Portion:
    """Return the portion of a counterpart of the weights (V,) of a handle."""
    if counterpart is None or counterpart.share is None:
        some = np.flatnonzero(weights)
        return Portion(counterpart, 1.0, Share(some, weights[some]))
    vertices, values = counterpart.share
    return Portion(counterpart, 1.0, Share(vertices, weights[vertices] * values))


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
    Where the sum between two counterparts would exceed the maximum of `weights`, their shares are reduced.
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
