"""Features smoothed along the surface, so that what views agree on stays and what they disagree on evens out.

A patch of the encoder bleeds over outlines and gaps, views contradict each other, and some of the surface no camera
sees. So the pixels' tokens are gathered at points over the whole surface and made smooth *along* it: the targets Z
minimize

    Σ_i c_i ‖Z_i − Ẑ_i‖² + t ∫ ‖∇Z‖²,    t = smoothing² / 2,

a screened diffusion, with Ẑ_i the mean token of the pixels near point i and c_i how well it is seen. Legs that stand
close together do not mix, as they would in a blur through space.

Averages lie closer together, and weights are distances: everything would move with everything. So smooth features are
moved apart about their mean until their mean distance is three quarters of that of the pixels' tokens; the last quarter
is the disagreement of views, not a difference of parts.

One hand may hold a shield and the other a sword. So a point is also linked, weakly, to the points at its mirror image
across the middle plane of the box that suits the shape best, by as much as they look alike.

Smooth features lie in few directions, in which they are smoothed and fitted; the field's last layer leads back from
them: 64 of a DINOv2-small's 384 directions leave out less than one part in ten thousand of the targets' squared length.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial import cKDTree

from dfd.common.linear_algebra import principal_directions
from dfd.common.progress import Stages
from dfd.common.threads import one_blas_thread, share
from dfd.distillation.targets import PAIRS, PixelTargets, PointTargets, TokenGrid, mean_distance, restore_contrast, unit
from dfd.field.component_residuals import apart, boxes_of_components
from dfd.geometry.topology import face_areas, face_components
from dfd.mesh.weld import weld
from dfd.views.render import Views, used_vertices

# Imported where it is needed, by a thread beside others that need no lock of Python's.
if TYPE_CHECKING:
    from scipy.sparse.linalg import SuperLU

__all__ = ["DiffusionProblem", "build_diffusion", "smooth_along_surface"]

SURFACE_SAMPLES = 12_000  # on average 0.02 apart in normalized coordinates
MAX_PIXELS = 400_000  # that are gathered; more change nothing that can be measured
NEIGHBORS = 10
# Of a link within a component, for links to another one nearby: a component that no camera sees takes after those
# around it. With less a body of loose parts falls apart; with more its armor becomes flesh.
GAP_WEIGHT = 0.008
GAP_NEIGHBORS = 4
MIRROR_WEIGHT = 0.02
MIRROR_REACH = 0.06  # between a point's mirror image and what it is linked to, normalized
ALIKE = 0.8  # of the mean distance of features: so far apart, a mirror link has lost all but 1/e of its weight
DIRECTIONS = 128  # that features are smoothed in; as many as there are, where a feature is no wider
ALIKE_DIRECTIONS = 32  # main ones, that decide how alike points look; more change nothing
COLUMNS = 32  # solved for together
# More pixels than this part of the mean do not make a point better seen: faces towards many cameras count no more.
SATURATED_COVERAGE = 0.3
DISTANCE_KEPT = 0.75


@dataclass(frozen=True, eq=False)
class DiffusionProblem:
    """All of the diffusion that is known before the tokens are, over N points on the surface.

    Attributes
    ----------
    points, face, area
        (N, 3) in normalized coordinates, the face of each, and the area that each stands for.
    component
        (F,) the connected component that each face of the surface belongs to.
    gathered
        (N, tokens) the share of each token in the mean at each point.
    confidence
        (N,) how well each point is seen, c_i.
    links
        (N, N) symmetric weights between neighbors along the surface.
    factors
        Those of the system without mirror links.
    generator
        Draws what is still to be drawn.
    """

    points: NDArray[np.float64]
    face: NDArray[np.int64]
    area: float
    component: NDArray[np.int32]
    gathered: sparse.csr_matrix
    confidence: NDArray[np.float64]
    links: sparse.csr_matrix
    factors: SuperLU
    generator: np.random.Generator


def build_diffusion(views: Views, grid: TokenGrid, *, smoothing: float, seed: int) -> DiffusionProblem:
    """Return what `smooth_along_surface` needs besides the tokens that stand in `grid`; arguments as there."""
    generator = np.random.default_rng(seed)
    vertices, faces = views.vertices.astype(np.float64), views.faces
    component = face_components(weld(vertices)[1][faces])
    points, face, area = _draw_points(vertices, faces, SURFACE_SAMPLES, generator)
    chosen, nearest = _gather(views, points, component, face, generator)
    seen = np.bincount(nearest, minlength=len(points)) / (len(chosen) / len(points))
    confidence = np.minimum(seen, SATURATED_COVERAGE) * area
    links = _surface_links(points, component[face], seen > 0, area)
    factors = _factors(confidence, area, smoothing, links)
    gathered = grid.means(chosen, nearest, len(points))
    return DiffusionProblem(points, face, area, component, gathered, confidence, links, factors, generator)


def smooth_along_surface(
    views: Views,
    pixels: PixelTargets,
    *,
    smoothing: float,
    seed: int,
    stages: Stages,
    problem: Callable[[], DiffusionProblem] | None = None,
) -> PointTargets:
    """Gather tokens on the surface and smooth them along it.

    Parameters
    ----------
    views, pixels
        The pictures' surface points with the faces that they lie on, and the tokens, read at those points.
    smoothing
        How far features are smoothed, in normalized coordinates; above 0.
    seed
        Draws the points.
    problem
        Gives what `build_diffusion` returns for the same arguments, where that was done before the tokens were there.

    Returns
    -------
    Targets in the main directions of the features, at points that lie evenly by area over all of the surface that has
    features.
    """
    with stages.stage("smooth"), one_blas_thread():
        on = problem() if problem else build_diffusion(views, pixels.grid, smoothing=smoothing, seed=seed)
        confidence, generator = on.confidence, on.generator
        tokens = pixels.means_by(on.gathered)  # Ẑ
        directions = _main_directions(tokens, confidence)
        main = tokens @ directions.T
        looks = unit(_solve(main[:, :ALIKE_DIRECTIONS], confidence, on.factors))
        mirrored = _mirror_links(_centered(on.points, views), looks, float(np.median(on.links.data)), generator)
        smooth = _solve(main, confidence, _factors(confidence, on.area, smoothing, on.links + mirrored))  # Z
        reached = np.linalg.norm(smooth, axis=1) > 1e-4
        one, other = (pixels.rows(some) for some in generator.integers(0, len(views.points), (2, PAIRS)))
        targets = restore_contrast(unit(smooth[reached]), DISTANCE_KEPT * mean_distance(one, other), generator)
        face, piece, boxes = on.face[reached], None, None
        if on.component.max(initial=0) > 0:
            piece = on.component[face]
            boxes = boxes_of_components(views.vertices.astype(np.float64), views.faces, on.component)
        return PointTargets(on.points[reached].astype(np.float32), targets, directions, piece, boxes, face)


def _gather(
    views: Views,
    points: NDArray[np.float64],  # (N, 3)
    component: NDArray[np.int32],  # (F,)
    face: NDArray[np.int64],  # (N,)
    generator: np.random.Generator,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Choose pixels (P,), and for each the nearest of `points` on its own component of the surface (P,)."""
    chosen = np.arange(len(views.points))
    if len(chosen) > MAX_PIXELS:
        chosen = np.sort(generator.choice(len(chosen), MAX_PIXELS, replace=False))
    tree = cKDTree(apart(points, component[face]))
    _, nearest = tree.query(apart(views.points[chosen], component[views.face[chosen]]), workers=-1)
    return chosen, nearest


def _main_directions(rows: NDArray[np.float32], weight: NDArray[np.floating]) -> NDArray[np.float32]:
    """The directions, orthonormal rows (d, D), of the largest moments of `rows` (N, D) that count by `weight` (N,)."""
    return principal_directions(rows * np.sqrt(weight / weight.max()).astype(np.float32)[:, None], DIRECTIONS)


def _draw_points(
    vertices: NDArray[np.float64], faces: NDArray[np.int32], count: int, generator: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.int64], float]:
    """Draw points evenly by area: (count, 3), the face of each, and the area that each stands for."""
    total = np.cumsum(face_areas(vertices, faces))
    # One draw in each of `count` equal shares of the area, so that they lie more evenly than by chance.
    at = (np.arange(count) + generator.random(count)) / count * total[-1]
    face = np.searchsorted(total, at, side="right").clip(0, len(faces) - 1)
    u, v = generator.random((2, count))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    first, second, third = vertices[faces[face]].transpose(1, 0, 2)
    points = first + u[:, None] * (second - first) + v[:, None] * (third - first)
    return points, face, float(total[-1]) / count


def _factors(confidence: NDArray[np.float64], area: float, smoothing: float, links: sparse.csr_matrix) -> SuperLU:
    """Factors of the system whose solutions have least Σ_i c_i ‖Z_i − Ẑ_i‖² + t Σ_ij w_ij ‖Z_i − Z_j‖².

    `links` are w_ij (N, N); t counts beside points that are seen well enough.
    """
    from scipy.sparse.linalg import splu

    # The last term only keeps the system regular where nothing is seen and nothing is near.
    system = smoothing**2 / 2 * SATURATED_COVERAGE * _laplacian(links) + sparse.diags(confidence + 1e-6 * area)
    # Positive definite: no pivots have to be looked for, and an ordering that stays symmetric fills in half as much.
    return splu(
        sparse.csc_matrix(system),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )


def _laplacian(links: sparse.csr_matrix) -> sparse.csr_matrix:
    """L with Zᵀ L Z = Σ_ij w_ij ‖Z_i − Z_j‖², each link w_ij (N, N) counted once."""
    return sparse.csr_matrix(sparse.diags(np.asarray(links.sum(axis=1)).ravel()) - links)


def _solve(tokens: NDArray[np.float32], confidence: NDArray[np.float64], factors: SuperLU) -> NDArray[np.float32]:
    """The smooth Z (N, D) of tokens Ẑ (N, D)."""
    smooth = np.empty(tokens.shape, np.float32)

    def solve(begin: int, end: int) -> None:
        smooth[:, begin:end] = factors.solve(confidence[:, None] * tokens[:, begin:end])

    share(tokens.shape[1], COLUMNS, solve)
    return smooth


def _surface_links(
    points: NDArray[np.float64],  # (N, 3)
    component: NDArray[np.int32],  # (N,)
    seen: NDArray[np.bool_],  # (N,)
    area: float,  # of each point
) -> sparse.csr_matrix:
    """Symmetric weights (N, N) from the nearest neighbors of each point, for Zᵀ L Z ≈ ∫ ‖∇Z‖² over the surface.

    For a gradient g that does not change near a point, ¼ Σ_j w_ij ‖p_i − p_j‖² g² is its part of the integral, so the
    weights w_ij = 4 area / (k ‖p_i − p_j‖²) give area · g².
    """
    every = np.arange(len(points))
    blind = np.bincount(component, seen)[component] == 0  # on components of which nothing is seen
    links = [
        _links(apart(points, component), every, every, NEIGHBORS, lambda i, j: component[i] == component[j], 1.0),
        _links(points, every, every, GAP_NEIGHBORS, lambda i, j: component[i] != component[j], GAP_WEIGHT),
        _links(points, every[blind], every[~blind], GAP_NEIGHBORS, lambda i, j: i != j, GAP_WEIGHT),
    ]
    one, other, weight = (np.concatenate(parts) for parts in zip(*links, strict=True))
    squared = np.square(points[one] - points[other]).sum(axis=1)
    # Points that fall together would otherwise hold each other infinitely fast.
    squared = np.maximum(squared, max(np.median(squared) / 16, 1e-12))
    return _symmetric(4 * area * weight / squared, one, other, len(points))


def _mirror_links(
    points: NDArray[np.float64],  # (N, 3)
    looks: NDArray[np.float32],  # (N, d) unit rows
    weight: float,  # of a link between neighbors
    generator: np.random.Generator,
) -> sparse.csr_matrix:
    """Symmetric weights (N, N) between each point and those near its mirror image, where they look alike.

    Of the three planes through the center of the box it is the one across which most of the shape does.
    """
    tree = cKDTree(points)
    mean = mean_distance(looks, looks[generator.permutation(len(points))])
    best = sparse.csr_matrix((len(points), len(points)))
    for axis in range(3):
        image = points.copy()
        image[:, axis] *= -1
        distance, near = tree.query(image, GAP_NEIGHBORS, distance_upper_bound=MIRROR_REACH, workers=-1)
        one, rank = np.nonzero(np.isfinite(distance) & (near != np.arange(len(points))[:, None]))
        other = near[one, rank]
        unlike = np.linalg.norm(looks[one] - looks[other], axis=1) / max(ALIKE * mean, 1e-6)
        links = _symmetric(2 * MIRROR_WEIGHT * weight * np.exp(-np.square(unlike)), one, other, len(points))
        best = max(best, links, key=lambda links: float(links.sum()))
    return best


def _centered(points: NDArray[np.float64], views: Views) -> NDArray[np.float64]:
    """Return `points` (N, 3) along the axes of the pictures' frame, from the middle of the shape's box along them."""
    corners = used_vertices(views.vertices, views.faces) @ views.frame.T
    turned: NDArray[np.float64] = points @ views.frame.T - (corners.min(axis=0) + corners.max(axis=0)) / 2
    return turned


def _symmetric(
    weights: NDArray[np.floating], one: NDArray[np.int64], other: NDArray[np.int64], count: int
) -> sparse.csr_matrix:
    """(N, N), half of each weight on either side."""
    links = sparse.csr_matrix((weights, (one, other)), shape=(count, count))
    return sparse.csr_matrix((links + links.T) / 2)


def _links(
    positions: NDArray[np.float64],  # (N, 3 or 4)
    ends: NDArray[np.int64],
    others: NDArray[np.int64],
    neighbors: int,
    linked: Callable[[NDArray[np.int64], NDArray[np.int64]], NDArray[np.bool_]],
    weight: float,
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Links of each of `ends` to its nearest among `others`, itself aside: both ends, and a share of `weight`."""
    wanted = min(neighbors + 1, len(others))
    if len(ends) == 0 or wanted == 0:
        return np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0)
    _, near = cKDTree(positions[others]).query(positions[ends], np.arange(1, wanted + 1), workers=-1)
    one, other = np.repeat(ends, wanted), others[near.ravel()]
    kept = (one != other) & linked(one, other)
    return one[kept], other[kept], np.full(int(kept.sum()), weight / neighbors)
