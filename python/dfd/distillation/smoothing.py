"""Smooths features along the surface, which averages out contradictions between views.

At outlines and gaps a patch of the encoder covers more than one part. Views contradict each other, and no camera sees
some of the surface. So tokens are averaged at sample points over the whole surface and diffused *along* it: the targets
Z minimize

    Σ_i c_i ‖Z_i − Ẑ_i‖² + t ∫ ‖∇Z‖²,    t = distance² / 2,

a screened diffusion. Ẑ_i is the mean token of the pixels near point i, and c_i is the visibility of point i. Unlike a
blur in space, diffusion does not mix legs that are close together.

Averaging reduces feature distances, and weights are computed from distances. Unscaled, every handle would move
everything. So smooth features are scaled about their mean until their mean distance is three quarters of that of the
pixels' tokens. The remaining quarter is disagreement between views, not a difference between parts.

Left and right parts can get different features. So a weak link, in proportion to similarity, joins each point to the
points near its mirror image. The mirror plane is the best of the three middle planes of the box.

Smooth features are low-rank. So their main directions are smoothed and fitted, and the field's last layer maps back to
full width. 64 of a DINOv2-small's 384 directions lose less than 1e-4 of the targets' squared length.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial import cKDTree

from dfd.common.linear_algebra import Bool, Float32, Float64, Int32, Int64, principal_directions
from dfd.common.progress import Stages
from dfd.common.threads import one_blas_thread, parallel_ranges
from dfd.distillation.targets import PAIRS, PixelTargets, PointTargets, TokenGrid, mean_distance, restore_contrast, unit
from dfd.field.component_residuals import apart, boxes_of_components
from dfd.geometry.topology import face_areas, face_components, sample_surface
from dfd.mesh.weld import weld
from dfd.views.render import Views, used_vertices

# SciPy is imported where it is used, on a thread that runs while the encoder works.
if TYPE_CHECKING:
    from scipy.sparse.linalg import SuperLU

SURFACE_SAMPLES = 12_000  # samples are on average 0.02 apart in normalized coordinates
MAX_PIXELS = 400_000  # a higher number changes no result measurably
NEIGHBORS = 10
# Weight of links between nearby components, relative to links within one. Through them a component that no camera sees
# gets features from its neighbors. With less, a body of loose parts separates; with more, armor gets body features.
GAP_WEIGHT = 0.008
GAP_NEIGHBORS = 4
MIRROR_WEIGHT = 0.02
MIRROR_REACH = 0.06  # from a point's mirror image to its linked points, of half the longest side of the box
SIMILARITY_SCALE = 0.8  # feature distance, relative to the mean, at which a mirror link's weight is 1/e
DIRECTIONS = 128  # main directions that are smoothed, or all if features are narrower
SIMILARITY_DIRECTIONS = 32  # main directions that decide similarity; a higher number changes no result
COLUMNS_PER_SOLVE = 32
SATURATED_COVERAGE = 0.3  # pixels per point, relative to the mean, beyond which visibility does not grow
DISTANCE_KEPT = 0.75


@dataclass(frozen=True, eq=False)
class DiffusionProblem:
    """The part of the diffusion that does not depend on the tokens, over N points on the surface."""

    views: Views
    distance: float  # distance over which features are smoothed, in normalized coordinates
    # points, face, area: (N, 3) in normalized coordinates, (N,) the face of each, and the area that each represents
    points: Float64
    face: Int64
    area: float
    size: float  # half the longest side of the box along the pictures' frame
    component: Int32  # (F,) the connected component of each face of the surface
    gathered: sparse.csr_matrix  # (N, tokens) the weight of each token in the mean at each point
    confidence: Float64  # (N,) visibility c_i of each point
    links: sparse.csr_matrix  # (N, N) symmetric weights between neighbors along the surface
    factors: SuperLU  # LU factors of the system without mirror links
    generator: np.random.Generator  # the source of the remaining random numbers


def build_diffusion(views: Views, grid: TokenGrid, *, smoothing: float, seed: int) -> DiffusionProblem:
    """Return the part of `smooth_along_surface` that needs no tokens of `grid`.

    Parameters
    ----------
    views
        The pictures' surface points with their faces.
    smoothing
        Diffusion distance relative to half the longest side of the box along the pictures' frame; above 0.
    seed
        Seed of the random points.
    """
    generator = np.random.default_rng(seed)
    vertices, faces = views.vertices.astype(np.float64), views.faces
    component = face_components(weld(vertices)[1][faces])
    points, face = sample_surface(vertices, faces, SURFACE_SAMPLES, generator)
    area = float(np.cumsum(face_areas(vertices, faces))[-1]) / SURFACE_SAMPLES
    chosen, nearest = _gather(views, points, component, face, generator)
    seen = np.bincount(nearest, minlength=len(points)) / (len(chosen) / len(points))
    confidence = np.minimum(seen, SATURATED_COVERAGE) * area
    links = _surface_links(points, component[face], seen > 0, area)
    # The size is that of the box along the pictures' frame: along the mesh's axes, a rotated shape has another box.
    size = float(np.ptp(used_vertices(views.vertices, faces) @ views.frame.T, axis=0).max()) / 2
    distance = smoothing * size
    factors = _factors(confidence, area, distance, links)
    gathered = grid.means(chosen, nearest, len(points))
    return DiffusionProblem(
        views, distance, points, face, area, size, component, gathered, confidence, links, factors, generator
    )


def smooth_along_surface(pixels: PixelTargets, on: DiffusionProblem, *, stages: Stages) -> PointTargets:
    """Average the tokens of `pixels` at points on the surface and smooth them along it. Solve `on` only once.

    Return targets in the main directions of the features. Their points are uniform by area over the surface that
    diffusion reaches.
    """
    with stages.stage("smooth"), one_blas_thread():
        confidence, generator = on.confidence, on.generator
        tokens = pixels.means_by(on.gathered)  # Ẑ
        directions = _main_directions(tokens, confidence)
        main = tokens @ directions.T
        appearance = unit(_solve(main[:, :SIMILARITY_DIRECTIONS], confidence, on.factors))
        alike = float(np.median(on.links.data))
        mirrored = _mirror_links(_centered(on.points, on.views) / on.size, appearance, alike, generator)
        links = on.links + mirrored
        smooth = _solve(main, confidence, _factors(confidence, on.area, on.distance, links))  # Z
        reached = np.linalg.norm(smooth, axis=1) > 1e-4
        one, other = (pixels.rows(some) for some in generator.integers(0, len(pixels.points), (2, PAIRS)))
        targets = restore_contrast(unit(smooth[reached]), DISTANCE_KEPT * mean_distance(one, other), generator)
        face, component, boxes = on.face[reached], None, None
        if on.component.max(initial=0) > 0:
            component = on.component[face]
            boxes = boxes_of_components(on.views.vertices.astype(np.float64), on.views.faces, on.component)
        return PointTargets(on.points[reached].astype(np.float32), targets, directions, component, boxes, face)


def _gather(
    views: Views,
    points: Float64,  # (N, 3)
    component: Int32,  # (F,)
    face: Int64,  # (N,)
    generator: np.random.Generator,
) -> tuple[Int64, Int64]:
    """Choose pixels (P,), and return for each the nearest of `points` on its component of the surface (P,)."""
    chosen = np.arange(len(views.points))
    if len(chosen) > MAX_PIXELS:
        chosen = np.sort(generator.choice(len(chosen), MAX_PIXELS, replace=False))
    tree = cKDTree(apart(points, component[face]))
    _, nearest = tree.query(apart(views.points[chosen], component[views.face[chosen]]), workers=-1)
    return chosen, nearest


def _main_directions(rows: Float32, weight: NDArray[np.floating]) -> Float32:
    """Return principal directions, orthonormal rows (d, D), of `rows` (N, D) weighted by `weight` (N,)."""
    return principal_directions(rows * np.sqrt(weight / weight.max()).astype(np.float32)[:, None], DIRECTIONS)


def _factors(confidence: Float64, area: float, distance: float, links: sparse.csr_matrix) -> SuperLU:
    """Return LU factors of the system that minimizes Σ_i c_i ‖Z_i − Ẑ_i‖² + t Σ_ij w_ij ‖Z_i − Z_j‖².

    `links` (N, N) are the w_ij. t is scaled by `SATURATED_COVERAGE`, the c_i of a fully visible point per area.
    """
    from scipy.sparse.linalg import splu

    # The last term keeps the system regular at points without visibility and links.
    system = distance**2 / 2 * SATURATED_COVERAGE * _laplacian(links) + sparse.diags(confidence + 1e-6 * area)
    # The matrix is positive definite, so it needs no pivoting, and a symmetric ordering halves the fill-in.
    return splu(
        sparse.csc_matrix(system), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )


def _laplacian(links: sparse.csr_matrix) -> sparse.csr_matrix:
    """Return L (N, N) with Zᵀ L Z = Σ_ij w_ij ‖Z_i − Z_j‖²; each link w_ij of `links` (N, N) counts once."""
    return sparse.csr_matrix(sparse.diags(np.asarray(links.sum(axis=1)).ravel()) - links)


def _solve(tokens: Float32, confidence: Float64, factors: SuperLU) -> Float32:
    """Return the smooth Z (N, D) of `tokens` Ẑ (N, D)."""
    smooth = np.empty(tokens.shape, np.float32)

    def solve(begin: int, end: int) -> None:
        smooth[:, begin:end] = factors.solve(confidence[:, None] * tokens[:, begin:end])

    parallel_ranges(tokens.shape[1], COLUMNS_PER_SOLVE, solve)
    return smooth


def _surface_links(
    points: Float64,  # (N, 3)
    component: Int32,  # (N,)
    seen: Bool,  # (N,)
    area: float,  # of each point
) -> sparse.csr_matrix:
    """Return symmetric weights (N, N) from the k nearest neighbors of each point, so that Zᵀ L Z ≈ ∫ ‖∇Z‖².

    For a constant gradient g near a point, the point's part of the integral is ¼ Σ_j w_ij ‖p_i − p_j‖² g². So the
    weights w_ij = 4 area / (k ‖p_i − p_j‖²) give area · g².
    """
    every = np.arange(len(points))
    blind = np.bincount(component, seen)[component] == 0  # points on components that no camera sees
    links = [
        _links(apart(points, component), every, every, NEIGHBORS, lambda i, j: component[i] == component[j], 1.0),
        _links(points, every, every, GAP_NEIGHBORS, lambda i, j: component[i] != component[j], GAP_WEIGHT),
        _links(points, every[blind], every[~blind], GAP_NEIGHBORS, lambda i, j: i != j, GAP_WEIGHT),
    ]
    one, other, weight = (np.concatenate(parts) for parts in zip(*links, strict=True))
    squared = np.square(points[one] - points[other]).sum(axis=1)
    # Without this bound, coincident points would have infinite weights.
    squared = np.maximum(squared, max(np.median(squared) / 16, 1e-12))
    return _symmetric(4 * area * weight / squared, one, other, len(points))


def _mirror_links(
    points: Float64,  # (N, 3)
    features: Float32,  # (N, d) unit rows
    weight: float,  # of a link between neighbors
    generator: np.random.Generator,
) -> sparse.csr_matrix:
    """Return symmetric weights (N, N) between each point and those near its mirror image, by feature similarity.

    The three candidate planes pass through the center of the box. The plane with the largest sum of weights is used.
    """
    tree = cKDTree(points)
    mean = mean_distance(features, features[generator.permutation(len(points))])
    best = sparse.csr_matrix((len(points), len(points)))
    for axis in range(3):
        image = points.copy()
        image[:, axis] *= -1
        distance, near = tree.query(image, GAP_NEIGHBORS, distance_upper_bound=MIRROR_REACH, workers=-1)
        one, rank = np.nonzero(np.isfinite(distance) & (near != np.arange(len(points))[:, None]))
        other = near[one, rank]
        unlike = np.linalg.norm(features[one] - features[other], axis=1) / max(SIMILARITY_SCALE * mean, 1e-6)
        links = _symmetric(2 * MIRROR_WEIGHT * weight * np.exp(-np.square(unlike)), one, other, len(points))
        best = max(best, links, key=lambda links: float(links.sum()))
    return best


def _centered(points: Float64, views: Views) -> Float64:
    """Return `points` (N, 3) in the axes of the pictures' frame, relative to the center of the shape's box there."""
    corners = used_vertices(views.vertices, views.faces) @ views.frame.T
    return points @ views.frame.T - (corners.min(axis=0) + corners.max(axis=0)) / 2


def _symmetric(weights: NDArray[np.floating], one: Int64, other: Int64, count: int) -> sparse.csr_matrix:
    """Return a symmetric matrix (N, N) with half of each weight in either direction."""
    links = sparse.csr_matrix((weights, (one, other)), shape=(count, count))
    return sparse.csr_matrix((links + links.T) / 2)


def _links(
    positions: Float64,  # (N, 3 or 4)
    ends: Int64,
    others: Int64,
    neighbors: int,
    linked: Callable[[Int64, Int64], Bool],
    weight: float,
) -> tuple[Int64, Int64, Float64]:
    """Return links of each of `ends` to its nearest `others`, not itself: both ends, and `weight` / `neighbors`."""
    wanted = min(neighbors + 1, len(others))
    if len(ends) == 0 or wanted == 0:
        return np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0)
    _, near = cKDTree(positions[others]).query(positions[ends], np.arange(1, wanted + 1), workers=-1)
    one, other = np.repeat(ends, wanted), others[near.ravel()]
    kept = (one != other) & linked(one, other)
    return one[kept], other[kept], np.full(int(kept.sum()), weight / neighbors)
