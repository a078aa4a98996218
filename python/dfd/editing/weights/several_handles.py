"""Share components among several handles that move: opened only with two or more of them.

A component follows the handle that lies on it. If no handle lies on it, it follows the first handle of which it is a
counterpart. So each component has one owner, and a counterpart never takes weight from a handle. A component inside
another component follows the handles of both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dfd.common.linear_algebra import Bool, Float32, Float64, Int64
from dfd.editing.edit import Edit, Handle
from dfd.editing.weights.fill import Column, Counterpart, filled_at_rest
from dfd.geometry.coarse import nodes_of
from dfd.mesh.mesh import Mesh
from dfd.posing.transforms import Transform

COMPONENT_THRESHOLD = 0.5  # a column's component: the vertices with at least this fraction of its largest weight
LEAST_IOU = 0.5  # two components count as the same if their intersection over union is above this
LEAST_NESTED = 0.8  # component A is nested in component B if more than this fraction of A lies in B
TAKEN_OVER = 0.95  # a new handle takes over the motion of a component if its own has at least this IoU with it


def shared(columns: Sequence[Column], vertex_of: dict[int, int], mesh: Mesh) -> tuple[Column, ...]:
    """Return the columns in which each component follows one of the moving handles, so that all reach their targets.

    `vertex_of` maps the index of each moving handle to its vertex.
    """
    samples, sizes = _samples(mesh)
    at_rest, points = filled_at_rest(columns, mesh).T, mesh.vertices
    among = [i for i, column in enumerate(columns) if column.handle in vertex_of]
    held = supports(at_rest[among][:, samples])
    same, nested = same_and_nested(held, sizes)
    kept = kept_columns([columns[i].handle for i in among], same)
    same, nested = same[np.ix_(kept, kept)], nested[np.ix_(kept, kept)]
    kept = [among[k] for k in kept]
    handle_of = [columns[i].handle for i in kept]
    nested &= np.not_equal.outer(handle_of, handle_of)
    own = {handle_of.index(handle): vertex_of[handle] for handle in dict.fromkeys(handle_of)}
    joined = sharing([columns[i] for i in kept], own, same)
    parts = divided(joined, at_rest[kept], points, own, same, nested)
    order = [i for i, column in enumerate(columns) if i in kept or column.handle not in vertex_of]
    depth = depths(nested, held[[among.index(i) for i in kept]] @ sizes)
    result = list(columns)
    for k, i in enumerate(kept):
        carriers = tuple(order.index(kept[j]) for j in np.flatnonzero(nested[k]))
        result[i] = replace(parts[k], carriers=carriers, depth=int(depth[k]))
    for each in np.unique(depth):
        group = [kept[k] for k in np.flatnonzero(depth == each)]
        count = np.zeros(len(points), np.int32)
        for i in group:
            count[result[i].support] += 1
        if len(vertices := np.flatnonzero(count > 1)):
            result[group[0]] = replace(result[group[0]], crowd=([order.index(i) for i in group], vertices))
    return tuple(result[i] for i in order)


def _samples(mesh: Mesh) -> tuple[Int64, Float64]:
    """Return vertices (N,) that stand for the shape, and how many vertices (N,) each of them stands for."""
    nodes = nodes_of(mesh)
    return nodes.members[nodes.starts].astype(np.int64), (nodes.ends - nodes.starts).astype(np.float64)


def limited(columns: Sequence[Column], weights: Float32) -> Float32:
    """Lower the `weights` (V, C) of `columns` in place where the sum of a crowded group exceeds 1, and return them."""
    for group, vertices in (column.crowd for column in columns if column.crowd is not None):
        among = np.ix_(vertices, np.array(group))
        some = weights[among]
        weights[among] = some / np.maximum(some.sum(axis=1, keepdims=True), np.float32(1.0))
    return weights


def taken_over(own: Column, plan: Sequence[Column], edit: Edit, handle: Handle, mesh: Mesh) -> Transform:
    """Return the motion that the handles of `edit` give to the component at a new `handle`.

    The motion is that of the handle that moves the same component, and none if there is no such handle, or if it bends.
    With the motion of a larger or smaller component, the shape would change at once. `plan` are the columns of `edit`,
    and `own` is the first column of the new handle.
    """
    if edit.rules.overlap != "add":
        return handle.transform
    moving = [i for i, each in enumerate(edit.handles) if not each.transform.rests]
    before = [column for column in plan if column.handle in moving]
    weights, (samples, sizes) = filled_at_rest([own, *before], mesh).T, _samples(mesh)
    held = supports(weights[:, samples])
    same = (held[1:] & held[0]) @ sizes >= TAKEN_OVER * ((held[1:] | held[0]) @ sizes)
    if not same.any():
        return handle.transform
    found = before[int(np.where(same, weights[1:, own.vertex], -1.0).argmax())]
    source = edit.handles[found.handle]
    if source.transform.bends:
        return handle.transform
    return _motion_at(found.counterpart, source.transform, source.place.position)


def _motion_at(counterpart: Counterpart, motion: Transform, position: Sequence[float]) -> Transform:
    """Return the motion of a counterpart, without bend and twist, for that of a handle at `position` (3,)."""
    frame = counterpart.frame
    if not motion.turns:
        return Transform().changed(translation=frame @ motion.translation)
    pivot = np.asarray(position if motion.pivot is None else motion.pivot) - position
    axes = None if motion.axes is None else np.asarray(motion.axes)
    if axes is None and len(set(motion.scale)) > 1:
        axes = np.eye(3)
    return Transform().changed(
        translation=frame @ motion.translation,
        rotation=np.linalg.det(frame) * frame @ motion.rotation,  # rotation vectors are pseudovectors
        scale=motion.scale,
        pivot=counterpart.position + frame @ pivot,
        axes=None if axes is None else axes @ frame.T,
    )


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
        component, sharers = result[first].component, [first]
        for j in others:
            limit = None if component is None else component.limited(vertex_of[j])
            if _is_plain(result[j]) and limit is not None:
                component, sharers = limit, [*sharers, j]
        assert component is not None
        for j in sharers:
            result[j] = result[j].of(component)
    return result


def _is_plain(column: Column) -> bool:
    """Return whether a column moves one component, with weights that only the component determines."""
    return column.component is not None and column.factor is column.component.share


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
