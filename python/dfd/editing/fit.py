"""Fit the motions of handles, so that chosen vertices, or the surface, arrive at given positions.

The unknowns of a handle are a translation and a rotation about its pivot, and, if wanted, a scale or a linear map. They
minimize the sum of the squared distances from the targets, plus `STIFFNESS`² times the squares of the unknowns. So a
motion that the targets do not determine is as small as possible. Steps of the method of Levenberg and Marquardt pose
only the target vertices. Weights in blend bands depend on the motion, so they are computed again between rounds, and
the last steps estimate how they change.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from dfd.common import check
from dfd.common.errors import ArgumentError
from dfd.common.linear_algebra import Float64, Int64
from dfd.editing import verbs
from dfd.editing.edit import Edit
from dfd.editing.points import nearest_vertex, place_on
from dfd.editing.shape import PosedShape, blend_of, blends_nested, resting
from dfd.editing.weights.session_weights import SessionWeights
from dfd.mesh.mesh import Mesh
from dfd.posing.pose import pose

Motion = Literal["rigid", "scale", "affine"]
TRANSLATION, ROTATION = {"translation": slice(0, 3)}, {"rotation": slice(3, 6)}
GROUPS = {  # the unknowns of a handle
    "rigid": TRANSLATION | ROTATION,
    "scale": TRANSLATION | ROTATION | {"scale": slice(6, 7)},
    "affine": TRANSLATION | {"linear": slice(3, 12)},
}
COUNTS = {motion: max(which.stop for which in groups.values()) for motion, groups in GROUPS.items()}
STIFFNESS = 1e-4  # weight of the unknowns; exact targets are then missed by about 1e-8 of the motion
STEP = 1e-4  # difference of an unknown for the central difference quotients of the Jacobian
NULL = 1e-5  # singular values of the Jacobian below this fraction of the largest count as 0
ROUNDS, SCAN_ROUNDS = 3, 30  # largest numbers of rounds for vertices and for a scan
REFINEMENTS = 100  # largest number of steps after the rounds
DONE = 1e-3  # steps end if one lowers the sum of squares by less than this fraction
SETTLED = 1e-7  # the rounds end if no unknown changes by more than this
SLOW = 0.01  # a round ends if a step lowers the sum of squares by less than this fraction, before weights change anyway


@dataclass(frozen=True)
class Fit:
    """The result of `Deformer.fit`. Distances are in mesh units."""

    mean: float  # mean distance between the posed shape and the targets
    largest: float  # largest distance
    before: float  # mean distance before the fit
    undetermined: Mapping[int, tuple[str, ...]]  # motions that the targets do not determine, by the handle's id

    def __str__(self) -> str:
        """Return one line with the distances."""
        return f"mean distance {self.mean:.3g} (before: {self.before:.3g}), largest {self.largest:.3g}"


@dataclass(frozen=True)
class Targets:
    """Points of the surface, and the positions at which they should arrive."""

    corners: Int64  # (N, 3) vertices
    shares: Float64  # (N, 3) barycentric coordinates
    goals: Float64  # (N, 3) mesh units

    def points(self, vertices: Float64) -> Float64:
        """Return the points (N, 3) of the surface for `vertices` (V, 3)."""
        return np.einsum("nk,nkd->nd", self.shares, vertices[self.corners])


def fit(
    edit: Edit, weights: SessionWeights, targets: Any, handles: Sequence[int] | None, motion: Motion
) -> tuple[Edit, Fit]:
    """Return `edit` with fitted motions; `Deformer.fit` explains the arguments and the errors."""
    check.choice(None, "motion", motion, Motion)
    chosen = [handle.id for handle in edit.handles] if handles is None else list(handles)
    if not chosen:
        raise ArgumentError("handles", "must have at least one handle to move")
    numbers = {handle.id: i for i, handle in enumerate(edit.handles)}
    order = [numbers[edit.handle(each).id] for each in chosen]
    scan = _scan(targets)
    start = _with_pivots(edit, weights, chosen)
    fitted, offset = start, np.zeros(len(chosen) * COUNTS[motion])
    at_first = _posed(edit, weights)
    found = _at_vertices(weights.mesh, targets) if scan is None else _on_surface(weights.mesh, at_first, scan)
    before = _distances(found, at_first)
    for number in range(ROUNDS if scan is None else SCAN_ROUNDS):
        problem = _Problem(fitted, weights, order, motion)
        if scan is not None and number:
            found = _on_surface(weights.mesh, _posed(fitted, weights), scan)
        last, offset = offset, problem.solved(found, offset, 30 if scan is None else 4)
        fitted = problem.edit_of(offset)
        if np.abs(offset - last).max() <= SETTLED:
            break
    problem = _Problem(fitted, weights, order, motion)
    if scan is None:
        problem, offset = _refined(problem, found, offset)
    open_motions = problem.undetermined(found, offset)
    after = _distances(found, _posed(problem.edit, weights))
    missing = {chosen[k]: names for k, names in open_motions.items()}
    if missing:
        told = ", ".join(f"handle {handle}: {' and '.join(names)}" for handle, names in missing.items())
        least = f"`targets` do not determine all motions ({told}); these are as small as possible"
        check.warn(f"Deformer.fit: {least}", UserWarning)
    return problem.edit, Fit(float(after.mean()), float(after.max()), float(before.mean()), missing)


def _refined(problem: _Problem, targets: Targets, unknowns: Float64) -> tuple[_Problem, Float64]:
    """Return the problem and the unknowns after steps that take into account that weights depend on the motion.

    The Jacobian is the one for constant weights, plus a correction that each step improves (Broyden, "A class of
    methods for solving nonlinear simultaneous equations", 1965).
    """
    damping, residuals = 1e-6, problem.residuals(targets, unknowns[None])[0]
    fixed, correction = problem.jacobian(targets, unknowns), np.zeros((len(residuals), len(unknowns)))
    for _ in range(REFINEMENTS):
        jacobian = fixed + correction
        curvature = jacobian.T @ jacobian
        step = -np.linalg.solve(curvature + damping * np.diag(curvature.diagonal() + 1e-12), jacobian.T @ residuals)
        if np.abs(step).max() <= SETTLED:
            break
        trial = _Problem(problem.edit_of(unknowns + step), problem.weights, problem.order, problem.motion)
        found = trial.residuals(targets, (unknowns + step)[None])[0]
        correction += np.outer(found - residuals - jacobian @ step, step) / (step @ step)
        before, after = residuals @ residuals, found @ found
        if after >= before:
            damping = min(10 * damping, 1e3)
            continue
        problem, unknowns, residuals = trial, unknowns + step, found
        fixed, damping = problem.jacobian(targets, unknowns), max(damping / 10, 1e-9)
        if before - after < DONE * before:
            break
    return problem, unknowns


class _Problem:
    """The least squares problem for the weights of one edit. `order` has the indices of the fitted handles."""

    def __init__(self, edit: Edit, weights: SessionWeights, order: Sequence[int], motion: Motion) -> None:
        self.edit, self.weights, self.order, self.motion = edit, weights, order, motion
        self.count, self.size = COUNTS[motion], weights.mesh.diagonal
        self.rest = resting(weights, edit)
        self.values, self.columns = weights.columns(edit)
        self.how = blend_of(weights.mesh, edit, self.values, self.columns, self.rest)
        del self.how["rotations"]  # each fitted motion has the smallest rotation
        if edit.rules.blend == "auto":
            self.how["blend"] = "dual_quaternion"  # a fitted motion rotates
        self.nested = blends_nested(edit, self.columns)

    def matrices(self, unknowns: Float64) -> Float64:
        """Return the transforms (B, H, 3, 4) of the fitted handles for `unknowns` (B, H · n)."""
        from scipy.spatial.transform import Rotation

        each = unknowns.reshape(len(unknowns), len(self.order), self.count)
        if self.motion == "affine":
            linear = np.eye(3) + each[..., 3:].reshape(*each.shape[:2], 3, 3)
        else:
            turns = Rotation.from_rotvec(each[..., 3:6].reshape(-1, 3)).as_matrix().reshape(*each.shape[:2], 3, 3)
            linear = turns * np.exp(each[..., 6:7, None]) if self.motion == "scale" else turns
        pivots = np.array([self.edit.handles[i].pivot for i in self.order])
        shift = pivots + self.size * each[..., :3] - np.einsum("bhij,hj->bhi", linear, pivots)
        return np.concatenate([linear, shift[..., None]], axis=-1)

    def edit_of(self, unknowns: Float64) -> Edit:
        """Return the edit with the motions of `unknowns` (H · n)."""
        edit = self.edit
        for i, matrix in zip(self.order, self.matrices(unknowns[None])[0], strict=True):
            held = edit.handles[i]
            edit = edit.changed(held, transform=held.transform.with_matrix(matrix, held.place.position))
        return edit

    def points(self, targets: Targets, unknowns: Float64, exact: bool = True) -> Float64:
        """Return the posed points (B, N, 3) of `targets` for `unknowns` (B, H · n).

        If not `exact`, parts in other parts are carried as in the present edit, which is enough for derivatives.
        """
        used, corners = np.unique(targets.corners, return_inverse=True)
        subset = Targets(corners.reshape(targets.corners.shape), targets.shares, targets.goals)
        matrices = self.matrices(unknowns)
        transforms = np.repeat(self.how["transforms"][None], len(unknowns), axis=0)
        for column, one in enumerate(self.columns):
            if one.handle in self.order:
                position = self.edit.handles[one.handle].place.position
                transforms[:, column] = one.counterpart.transform(matrices[:, self.order.index(one.handle)], position)
        if self.nested and exact:
            for b, each in enumerate(unknowns):
                found = blend_of(self.weights.mesh, self.edit_of(each), self.values, self.columns, self.rest)
                transforms[b] = found["transforms"]
        how = {**self.how, "transforms": transforms}
        posed = pose(self.rest[used], np.ascontiguousarray(self.values[used]), **how)
        return np.stack([subset.points(each) for each in posed])

    def solved(self, targets: Targets, unknowns: Float64, steps: int) -> Float64:
        """Return the `unknowns` (H · n) after about `steps` steps of the method of Levenberg and Marquardt."""
        from scipy.optimize import least_squares

        found = least_squares(
            lambda each: self.residuals(targets, each[None])[0],
            unknowns,
            lambda each: self.jacobian(targets, each),
            method="lm",
            ftol=SLOW,
            xtol=SETTLED,
            max_nfev=2 * steps,
        )
        return np.asarray(found.x, np.float64)

    def residuals(self, targets: Targets, unknowns: Float64, exact: bool = True) -> Float64:
        """Return the distances from the targets, as fractions of the diagonal, and the weighted unknowns."""
        apart = (self.points(targets, unknowns, exact) - targets.goals) / self.size
        return np.concatenate([apart.reshape(len(unknowns), -1), STIFFNESS * unknowns], axis=1)

    def jacobian(self, targets: Targets, unknowns: Float64) -> Float64:
        """Return the derivatives (R, H · n) of the residuals, by central differences."""
        steps = STEP * np.eye(len(unknowns))
        found = self.residuals(targets, np.concatenate([unknowns + steps, unknowns - steps]), exact=False)
        return (found[: len(unknowns)] - found[len(unknowns) :]).T / (2 * STEP)

    def undetermined(self, targets: Targets, unknowns: Float64) -> dict[int, tuple[str, ...]]:
        """Return the motions that the targets do not determine, by the position in `order`.

        Raises ValueError if no handle moves a target.
        """
        jacobian = self.jacobian(targets, unknowns)[: targets.goals.size]
        sizes, directions = np.linalg.svd(jacobian, full_matrices=True)[1:]
        sizes = np.concatenate([sizes, np.zeros(len(unknowns) - len(sizes))])
        if sizes[0] < 1e-9:
            raise ArgumentError("targets", "must be at places that the handles move: all their weights are 0 there")
        free = directions[sizes <= NULL * sizes[0]]
        result = {}
        for k in range(len(self.order)):
            own, groups = np.abs(free[:, k * self.count : (k + 1) * self.count]), GROUPS[self.motion].items()
            if names := tuple(name for name, which in groups if own[:, which].max(initial=0.0) > 0.05):
                result[k] = names
        return result


def _posed(edit: Edit, weights: SessionWeights) -> Float64:
    """Return the posed vertices (V, 3) of `edit`."""
    return PosedShape(weights).of(edit)


def _with_pivots(edit: Edit, weights: SessionWeights, chosen: Sequence[int]) -> Edit:
    """Return `edit` with the default pivots of the `chosen` handles, at which they rest, but for a tiny motion.

    The motion makes them moving handles, which share counterparts and parts as they will after the fit.
    """
    rest = {"translation": (1e-9 * weights.mesh.diagonal, 0, 0), "rotation": (0, 0, 0), "scale": 1, "axes": "auto"}
    for handle in chosen:
        if not edit.handle(handle).transform.turns:
            edit = verbs.move(edit, weights, handle, {"rotation": (0.0, 0.0, 1.0)})
        edit = verbs.move(edit, weights, handle, rest)
    return edit


def _distances(targets: Targets, vertices: Float64) -> Float64:
    return np.asarray(np.linalg.norm(targets.points(vertices) - targets.goals, axis=1), np.float64)


def _scan(targets: Any) -> Float64 | None:
    """Return the points (N, 3) of a scan, or None for other targets."""
    if isinstance(targets, Mapping | tuple):
        return None
    points: Float64 = check.array(None, "targets", targets, ("N", 3), dtype=np.float64)
    if not len(points):
        raise ArgumentError("targets", "must have at least one point")
    return points


def _at_vertices(mesh: Mesh, targets: Any) -> Targets:
    """Return the targets for a mapping of places to positions, or a pair of vertices (N,) and positions (N, 3)."""
    if isinstance(targets, Mapping):
        places = [place_on(mesh, at) for at in targets]
        if any(place.region is not None for place in places):
            raise ArgumentError("targets", "must be at vertices or points, not regions")
        vertices = np.array(
            [nearest_vertex(mesh, each.position)[0] if each.vertex is None else each.vertex for each in places],
            np.int64,
        )
        positions: Any = list(targets.values())
    else:
        if len(targets) != 2:
            raise ArgumentError("targets", f"must be a pair of vertices and positions, got {len(targets)} items")
        vertices = check.vertex_indices(None, "targets[0]", targets[0], len(mesh.vertices))
        positions = targets[1]
    if not len(vertices):
        raise ArgumentError("targets", "must have at least one target")
    goals = check.array(None, "targets", positions, (len(vertices), 3), dtype=np.float64)
    shares = np.tile(np.array([1.0, 0.0, 0.0]), (len(vertices), 1))
    return Targets(np.repeat(vertices[:, None], 3, axis=1), shares, goals)


def _on_surface(mesh: Mesh, vertices: Float64, scan: Float64) -> Targets:
    """Return the points of the posed surface that are nearest to the points of a scan, among faces at near vertices."""
    from scipy.spatial import cKDTree
    from trimesh.triangles import closest_point

    used = np.unique(mesh.faces)
    if not len(used):
        raise ArgumentError("targets", "must be vertices and positions: the mesh has no faces")
    first = used[cKDTree(vertices[used]).query(scan)[1]]
    order = np.argsort(mesh.faces, axis=None, kind="stable")
    begins = np.searchsorted(mesh.faces.ravel()[order], np.arange(len(vertices) + 1))
    counts = np.diff(begins)[first]
    owner = np.repeat(np.arange(len(scan)), counts)
    within = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
    faces = order[np.repeat(begins[first], counts) + within] // 3
    triangles = vertices[mesh.faces[faces]]
    nearest = closest_point(triangles, scan[owner])
    apart = np.linalg.norm(nearest - scan[owner], axis=1)
    best = np.lexsort((apart, owner))[np.cumsum(counts) - counts]
    return Targets(mesh.faces[faces[best]].astype(np.int64), _barycentric(triangles[best], nearest[best]), scan)


def _barycentric(triangles: Float64, points: Float64) -> Float64:
    """Return the barycentric coordinates (N, 3) of points in triangles (N, 3, 3), in [0, 1]."""
    u, v, w = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0], points - triangles[:, 0]
    uu, uv, vv = (u * u).sum(axis=1), (u * v).sum(axis=1), (v * v).sum(axis=1)
    wu, wv = (w * u).sum(axis=1), (w * v).sum(axis=1)
    area = np.maximum(uu * vv - uv * uv, 1e-300)
    second, third = (vv * wu - uv * wv) / area, (uu * wv - uv * wu) / area
    shares = np.clip(np.stack([1 - second - third, second, third], axis=1), 0.0, 1.0)
    return np.asarray(shares / shares.sum(axis=1, keepdims=True), np.float64)
