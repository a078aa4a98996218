"""Plan which handle moves which component, for all handles together, before any motion is known.

A component follows the handle that lies on it. If no handle lies on it, it follows the first handle of which it is a
counterpart. So each component has one owner, and a counterpart never takes weight from a handle. A component inside
another component follows the handles of both.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dfd.common.linear_algebra import Bool, Float32, Float64, Int64
from dfd.editing.edit import Edit
from dfd.editing.influence.counterparts import Counterpart
from dfd.editing.influence.hold import Component
from dfd.geometry.coarse import Share

COMPONENT_THRESHOLD = 0.5  # a column's component: the vertices with at least this fraction of its largest weight
LEAST_IOU = 0.5  # two components count as the same if their intersection over union is above this
LEAST_NESTED = 0.8  # component A is nested in component B if more than this fraction of A lies in B


@dataclass(frozen=True, eq=False)
class Piece:
    """A component that a column moves, and the factors of its weights, which do not depend on the motion."""

    component: Component
    core: Share  # the weights beyond the inner end of every band
    factor: Float32  # (M,) factor of the weights at `Component.vertices`

    def scaled(self, factor: Callable[[NDArray[np.integer]], Float64]) -> Piece:
        """Return the piece with all weights multiplied by `factor`, a function of vertices (N,)."""
        inside = Share(self.component.vertices, self.factor)
        return Piece(self.component, _scaled(self.core, factor), _scaled(inside, factor).values)


@dataclass(frozen=True, eq=False)
class Column:
    """One column of the weights (V, C): the handle and the counterpart to which it belongs."""

    handle: int  # index of the handle in the edit
    counterpart: Counterpart  # the handle itself if all of its counterparts share one pivot and this column
    pieces: tuple[Piece, ...] = ()  # components whose weights depend on the motion, because they have bands
    still: Share | None = None  # weights that do not depend on the motion; None if there are pieces
    carriers: tuple[int, ...] = ()  # columns of other handles whose components contain this column's component
    depth: int = 0  # 0 without carriers; otherwise, above the depth of each carrier

    def matrix(self, edit: Edit, most: float = np.inf) -> Float64:
        """Return the transform (3, 4) of the column, mesh units: the handle's transform, mapped to the counterpart.

        Rotations by more than `most` degrees are reduced to this angle.
        """
        handle = edit.handles[self.handle]
        matrix, angle = handle.matrix, float(np.linalg.norm(handle.transform.rotation))
        if angle > most:
            x, y, z = (part * most / angle for part in handle.transform.rotation)
            matrix = replace(handle.transform, rotation=(x, y, z)).matrix(handle.place.position)
        return self.counterpart.transform(matrix, handle.place.position)

    def turn(self, edit: Edit) -> tuple[Float64, Float64]:
        """Return the pivot (3,) of the column, mesh units, and the rotation vector (3,) of its transform, degrees."""
        handle, frame = edit.handles[self.handle], self.counterpart.frame
        place, pivot = np.asarray(handle.place.position), handle.transform.pivot
        offset = np.zeros(3) if pivot is None else pivot - place
        turned = np.linalg.det(frame) * frame  # rotation vectors are pseudovectors
        return self.counterpart.position + frame @ offset, turned @ handle.transform.rotation

    def scaled(self, factor: Callable[[NDArray[np.integer]], Float64]) -> Column:
        """Return the column with all weights multiplied by `factor`, a function of vertices (N,)."""
        pieces = tuple(each.scaled(factor) for each in self.pieces)
        return replace(self, pieces=pieces, still=None if self.still is None else _scaled(self.still, factor))

    @cached_property
    def support(self) -> Int64:
        """Return the vertices (N,) whose weight can be above 0, in any order; some are repeated."""
        if self.still is not None:
            return np.asarray(self.still.vertices, np.int64)
        found = [part for each in self.pieces for part in (each.core.vertices, each.component.vertices)]
        return np.concatenate(found).astype(np.int64) if found else np.empty(0, np.int64)


@dataclass(frozen=True, eq=False)
class Plan:
    """The columns of an edit, and the vertices at which the weights of several handles may have a sum above 1."""

    columns: tuple[Column, ...]
    crowded: tuple[tuple[tuple[int, ...], Int64], ...] = ()  # groups of columns, and vertices (N,) of each group


def _scaled(share: Share, factor: Callable[[NDArray[np.integer]], Float64]) -> Share:
    return Share(share.vertices, share.values * factor(share.vertices).astype(np.float32))


def allocated(
    columns: Sequence[Column],
    moving: Sequence[int],
    at_rest: Float32,
    points: Float64,
    samples: Int64,
    sizes: Float64,
    vertex_of: dict[int, int],
) -> Plan:
    """Assign each component to one of the `moving` handles, so that every handle reaches its target.

    `at_rest` (C, V) are the weights of all columns if no handle moves. `points` (V, 3) are the vertices. `samples` (N,)
    are vertices that stand for `sizes` (N,) vertices each. `vertex_of` maps each moving handle to its vertex.
    """
    among = [i for i, column in enumerate(columns) if column.handle in moving]
    held = supports(at_rest[among][:, samples])
    same, nested = same_and_nested(held, sizes)
    kept = kept_columns([columns[i].handle for i in among], same)
    same, nested = same[np.ix_(kept, kept)], nested[np.ix_(kept, kept)]
    kept = [among[k] for k in kept]
    handle_of = [columns[i].handle for i in kept]
    nested &= np.not_equal.outer(handle_of, handle_of)
    own = {handle_of.index(handle): vertex_of[handle] for handle in dict.fromkeys(handle_of)}
    joined = sharing([columns[i] for i in kept], own, same)
    divided_columns = divided(joined, at_rest[kept], points, own, same, nested)
    order = [i for i, column in enumerate(columns) if i in kept or column.handle not in moving]
    depth = depths(nested, held[[among.index(i) for i in kept]] @ sizes)
    result = list(columns)
    for k, i in enumerate(kept):
        carriers = tuple(order.index(kept[j]) for j in np.flatnonzero(nested[k]))
        result[i] = replace(divided_columns[k], carriers=carriers, depth=int(depth[k]))
    crowded = []
    for each in np.unique(depth):
        group = [kept[k] for k in np.flatnonzero(depth == each)]
        count = np.zeros(len(points), np.int32)
        for i in group:
            count[result[i].support] += 1
        if len(vertices := np.flatnonzero(count > 1)):
            crowded.append((tuple(order.index(i) for i in group), vertices))
    return Plan(tuple(result[i] for i in order), tuple(crowded))


def supports(weights: Float32) -> Bool:
    """Return which samples belong to the component of each column, (C, N), for its `weights` (C, N) at the samples."""
    return (weights >= COMPONENT_THRESHOLD * weights.max(axis=1, keepdims=True)) & (weights > 0)


def same_and_nested(held: Bool, sizes: Float64) -> tuple[Bool, Bool]:
    """Return two masks (C, C): whether components i and j are the same, and whether component i is nested in j.

    `held` (C, N) says which of N surface samples a component contains. Sample n stands for `sizes[n]` vertices.
    """
    common = (held * sizes.astype(np.float32)) @ held.T.astype(np.float32)
    own = np.diag(common).copy()
    union: Float32 = own[:, None] + own - common
    same = common > LEAST_IOU * union
    nested = (common > LEAST_NESTED * own[:, None]) & ~same
    return same, nested


def depths(nested: Bool, size: Float64) -> Int64:
    """Return the largest number of components (C,) in which each is nested one inside the other.

    `nested` (C, C) is as in `same_and_nested`. A component is smaller (`size`, (C,)) than those in which it is nested.
    """
    depth = np.zeros(len(nested), np.int64)
    for k in np.argsort(-size, kind="stable"):
        depth[k] = (depth[nested[k]] + 1).max(initial=0)
    return depth


def kept_columns(handle_of: Sequence[int], same: Bool) -> list[int]:
    """Return the indices of the columns that remain of each component: those of handles on it, or else the first one.

    `handle_of` (C,) is the handle of each column. A handle lies on the component of its first column.
    """
    handles = np.asarray(handle_of)
    first = np.zeros(len(handles), bool)
    first[np.unique(handles, return_index=True)[1]] = True
    kept = first.copy()  # the components of handles come first: a counterpart never takes their place
    for i in np.flatnonzero(~first):
        kept[i] = not (same[i] & kept & (handles != handles[i])).any()
    return np.flatnonzero(kept).tolist()


def sharing(columns: Sequence[Column], vertex_of: dict[int, int], same: Bool) -> list[Column]:
    """Return `columns`, in which handles on one component use the same bands, so that their weights have the sum 1.

    The component is that of the first of these handles, with bands that end before each handle. `vertex_of` and `same`
    are as in `divided`. A handle outside the first handle's component, or with weights by features, keeps its own.
    """
    result = list(columns)
    for first in vertex_of:
        others = [j for j in vertex_of if j > first and same[first, j]]
        if not others or not _is_plain(result[first]):
            continue
        component = result[first].pieces[0].component
        sharers = [first]
        for j in others:
            limited = component.limited(vertex_of[j])
            if _is_plain(result[j]) and limited is not None:
                component, sharers = limited, [*sharers, j]
        for j in sharers:
            piece = Piece(component, component.core, component.share)
            result[j] = replace(result[j], pieces=(piece,))
    return result


def _is_plain(column: Column) -> bool:
    """Return whether a column moves one component, with weights that only the component determines."""
    return len(column.pieces) == 1 and column.pieces[0].factor is column.pieces[0].component.share


def divided(
    columns: Sequence[Column], at_rest: Float32, points: Float64, vertex_of: dict[int, int], same: Bool, nested: Bool
) -> list[Column]:
    """Return `columns`, scaled so that at each handle the columns of other handles are 0.

    Handles on one component divide it: the weights are inverse to the squared distances. `at_rest` (C, V) are the
    weights at rest. `vertex_of` maps the first column of each handle to the vertex of the handle. `same` and `nested`
    (C, C) are the results of `same_and_nested`.
    """
    own, at = np.array(list(vertex_of)), np.array(list(vertex_of.values()))
    places = points[at]
    apart = np.linalg.norm(places[:, None] - places, axis=2) + np.diag(np.full(len(at), np.inf))
    radius = apart.min(axis=1) / 2  # with radius 0, two handles are at one point
    result = []
    for j, column in enumerate(columns):
        rivals = own[same[j, own] & (own != j)] if j in vertex_of else own[:0]
        beside = np.isin(at, column.support) & (own != j) & ~nested[own, j] & (radius > 0)

        def factor(vertices: NDArray[np.integer], j: int = j, rivals: Int64 = rivals, beside: Bool = beside) -> Float64:
            here, left = points[vertices], np.ones(len(vertices))
            if len(rivals):
                near = [1 / np.maximum(_squares(here, points[vertex_of[i]]), 1e-300) for i in (j, *rivals.tolist())]
                left *= near[0] / np.sum(near, axis=0)
            for i in np.flatnonzero(beside):
                squares = _squares(here, places[i]) / radius[i] ** 2
                close = np.flatnonzero(squares < 1.0)
                left[close] *= 1.0 - np.square(1.0 - squares[close]) * at_rest[own[i], vertices[close]]
            return left

        result.append(column.scaled(factor) if len(rivals) or beside.any() else column)
    return result


def _squares(points: Float64, place: Float64) -> Float64:
    """Return the squared distances (N,) of `points` (N, 3) from `place` (3,)."""
    apart = points - place
    return np.asarray(np.einsum("ni,ni->n", apart, apart), np.float64)
