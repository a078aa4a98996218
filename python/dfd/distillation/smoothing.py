"""Smooth features along the surface, to average the differences between pictures.

A token is the feature that the encoder gives to one patch of a picture. At outlines and gaps, a patch shows more than
one part. Tokens of the same surface point differ between pictures, and some of the surface is in no picture. So tokens
are averaged at surface samples, and diffused *along* the surface. The results are the targets Z that minimize

    Σ_i c_i ‖Z_i − Ẑ_i‖² + t ∫ ‖∇Z‖²,    t = (smoothing distance)² / 2.

Ẑ_i is the mean token of the pixels near sample i. The visibility c_i grows with the number of these pixels. Unlike a
blur in space, diffusion does not mix legs that are close together.

Diffusion reduces the distances between features, so handle weights would be large everywhere. So smooth features are
scaled about their mean until the mean distance of two features is three quarters of the mean distance of two tokens.
The missing quarter is due to differences between pictures, not between parts.

An encoder can give different features to a left part and a right part. So weak links (further terms w ‖Z_i − Z_j‖²)
connect each sample i with samples j near its mirror image. The weight w of a link is higher for similar samples. The
mirror plane is that middle plane of the bounding box for which the sum of these weights is largest.

Smooth features vary mainly along a few directions. So only these principal directions are smoothed and fitted. The
field's last layer maps the fitted values back to features of full dimension.
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
from dfd.geometry.topology import are_distinct, face_areas, face_components, sample_surface
from dfd.mesh.weld import weld
from dfd.views.render import Views, used_vertices

if TYPE_CHECKING:  # scipy.sparse.linalg loads slowly, so `_factors` loads it on another thread while the encoder runs
    from scipy.sparse.linalg import SuperLU

SURFACE_SAMPLES = 12_000  # number of surface samples; their mean spacing is about 0.02 in normalized coordinates
MAX_PIXELS = 400_000  # largest number of pixels that are averaged; more pixels do not change results measurably
NEIGHBORS = 10  # number of nearest samples on the same connected component to which a sample is linked
# Weight of links between components, relative to links within a component. These links give features to components
# that no camera sees. A higher weight would give armor the features of the body inside it.
GAP_WEIGHT = 0.008
GAP_NEIGHBORS = 4  # number of nearest samples that are candidates for a link between components or a mirror link
MIRROR_WEIGHT = 0.02  # weight of mirror links, divided by the median weight of links along the surface
MIRROR_REACH = 0.06  # longest distance of a mirror image from a linked sample, divided by half of the longest box side
SIMILARITY_SCALE = 0.8  # feature distance, divided by the mean feature distance, at which a mirror link's weight is 1/e
DIRECTIONS = 128  # number of principal directions that are smoothed
SIMILARITY_DIRECTIONS = 32  # number of principal directions that decide similarity; more do not change results
COLUMNS_PER_SOLVE = 32  # number of directions for which a thread solves the linear system at a time
SATURATED_COVERAGE = 0.3  # a sample's pixel count, divided by the mean pixel count, above which visibility is constant
DISTANCE_KEPT = 0.75  # mean distance of smooth features, divided by the mean distance of the pixels' tokens


@dataclass(frozen=True, eq=False)
class DiffusionProblem:
    """All data of the diffusion over N surface samples, except the tokens."""

    views: Views
    distance: float  # distance over which features are smoothed, in normalized coordinates
    points: Float64  # (N, 3) the samples, in normalized coordinates
    centered: Float64  # (N, 3) the samples in the axes of `views.frame`, scaled so that the shape fits in [−1, 1]³
    face: Int64  # (N,) the face of each sample
    area: float  # area of the surface per sample
    component: Int32  # (F,) the connected component of each face of the surface
    gathered: sparse.csr_matrix  # (N, tokens) the weight of each token in the mean Ẑ_i of each sample
    confidence: Float64  # (N,) visibility c_i of each sample
    links: sparse.csr_matrix  # (N, N) symmetric weights between neighbors along the surface
    factors: SuperLU  # LU factors of the linear system (see `_factors`) without mirror links
    generator: np.random.Generator  # the source of the random numbers of `smooth_along_surface`


def build_diffusion(views: Views, grid: TokenGrid, *, smoothing: float, seed: int) -> DiffusionProblem:
    """Return all data of the diffusion except the tokens.

    Parameters
    ----------
    grid
        The positions of the tokens at the surface points of `views`.
    smoothing
        Diffusion distance divided by half the longest side of the box along the axes of `views.frame`; above 0.
    seed
        Seed of the surface samples.
    """
    generator = np.random.default_rng(seed)
    vertices, faces = views.vertices.astype(np.float64), views.faces
    welded = weld(vertices)[1][faces]
    component = face_components(welded)
    points, face = sample_surface(vertices, faces, SURFACE_SAMPLES, generator)
    area = float(np.cumsum(face_areas(vertices, faces[are_distinct(welded)]))[-1]) / SURFACE_SAMPLES
    chosen = np.arange(len(views.points))
    if len(chosen) > MAX_PIXELS:
        chosen = np.sort(generator.choice(len(chosen), MAX_PIXELS, replace=False))
    # Find for each pixel the nearest sample on the same connected component.
    tree = cKDTree(apart(points, component[face]))
    nearest = tree.query(apart(views.points[chosen], component[views.face[chosen]]), workers=-1)[1]
    seen = np.bincount(nearest, minlength=len(points)) / (len(chosen) / len(points))
    confidence = np.minimum(seen, SATURATED_COVERAGE) * area
    links = _surface_links(points, component[face], seen > 0, area)
    # The box along the axes of the frame does not depend on the orientation of the shape in its file.
    corners = used_vertices(views.vertices, faces) @ views.frame.T
    size = float(np.ptp(corners, axis=0).max()) / 2
    centered = (points @ views.frame.T - (corners.min(axis=0) + corners.max(axis=0)) / 2) / size
    distance = smoothing * size
    factors = _factors(confidence, area, distance, links)
    gathered = grid.means(chosen, nearest, len(points))
    return DiffusionProblem(
        views, distance, points, centered, face, area, component, gathered, confidence, links, factors, generator
    )


def smooth_along_surface(pixels: PixelTargets, on: DiffusionProblem, *, stages: Stages) -> PointTargets:
    """Return the tokens of `pixels`, averaged at surface samples and smoothed along the surface.

    The targets are coordinates along the principal directions of the features. Samples that diffusion does not reach
    are left out. The call draws from `on.generator`, so a second call with the same `on` gives another result.
    """
    with stages.stage("smooth"), one_blas_thread():
        confidence, generator = on.confidence, on.generator
        tokens = pixels.means_by(on.gathered)  # Ẑ
        weighted = tokens * np.sqrt(confidence / confidence.max()).astype(np.float32)[:, None]
        directions = principal_directions(weighted, DIRECTIONS)
        main = tokens @ directions.T
        appearance = unit(_solve(main[:, :SIMILARITY_DIRECTIONS], confidence, on.factors))
        weight = float(np.median(on.links.data))
        links = on.links + _mirror_links(on.centered, appearance, weight, generator)
        smooth = _solve(main, confidence, _factors(confidence, on.area, on.distance, links))  # Z
        reached = np.linalg.norm(smooth, axis=1) > 1e-4
        one, other = (pixels.rows(some) for some in generator.integers(0, len(pixels.points), (2, PAIRS)))
        targets = restore_contrast(unit(smooth[reached]), DISTANCE_KEPT * mean_distance(one, other), generator)
        face, component, boxes = on.face[reached], None, None
        if on.component.max(initial=0) > 0:
            component = on.component[face]
            boxes = boxes_of_components(on.views.vertices.astype(np.float64), on.views.faces, on.component)
        return PointTargets(on.points[reached].astype(np.float32), targets, directions, component, boxes, face)


def _factors(confidence: Float64, area: float, distance: float, links: sparse.csr_matrix) -> SuperLU:
    """Return LU factors of the system whose solution Z minimizes Σ_i c_i ‖Z_i − Ẑ_i‖² + t Σ_i<j w_ij ‖Z_i − Z_j‖².

    `links` (N, N) are the w_ij. The c_i in `confidence` (N,) are areas times at most `SATURATED_COVERAGE`. Therefore t
    also has this factor: t = `distance`² / 2 × `SATURATED_COVERAGE`.
    """
    from scipy.sparse.linalg import splu

    # The term 1e-6 · area makes the system regular at invisible samples without links.
    system = distance**2 / 2 * SATURATED_COVERAGE * _laplacian(links) + sparse.diags(confidence + 1e-6 * area)
    # The matrix is positive definite, so it needs no pivoting. A symmetric ordering halves the fill-in.
    options = {"SymmetricMode": True}
    return splu(sparse.csc_matrix(system), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)


def _laplacian(links: sparse.csr_matrix) -> sparse.csr_matrix:
    """Return L (N, N) with Zᵀ L Z = Σ_i<j w_ij ‖Z_i − Z_j‖², for the weights w_ij in `links` (N, N)."""
    return sparse.csr_matrix(sparse.diags(np.asarray(links.sum(axis=1)).ravel()) - links)


def _solve(tokens: Float32, confidence: Float64, factors: SuperLU) -> Float32:
    """Return the smooth features Z (N, D) for the mean `tokens` Ẑ (N, D)."""
    smooth = np.empty(tokens.shape, np.float32)

    def solve(begin: int, end: int) -> None:
        smooth[:, begin:end] = factors.solve(confidence[:, None] * tokens[:, begin:end])

    parallel_ranges(tokens.shape[1], COLUMNS_PER_SOLVE, solve)
    return smooth


def _surface_links(points: Float64, component: Int32, seen: Bool, area: float) -> sparse.csr_matrix:
    """Return symmetric weights (N, N) of links between nearby samples, so that Zᵀ L Z ≈ ∫ ‖∇Z‖² (L: see `_laplacian`).

    For a constant gradient g near sample i, its k links contribute ¼ Σ_j w_ij ‖p_i − p_j‖² g² to Zᵀ L Z: half of each
    term is for sample j, and the mean of cos² over directions is ½. So the weights w_ij = 4 area / (k ‖p_i − p_j‖²)
    give area · g². `area` is the surface area per sample. For each sample, `points` (N, 3) is the position,
    `component` (N,) the connected component, and `seen` (N,) whether a pixel shows it.
    """
    every = np.arange(len(points))
    hidden = np.bincount(component, seen)[component] == 0  # samples on components that no camera sees
    links = [
        _links(apart(points, component), every, every, NEIGHBORS, lambda i, j: component[i] == component[j], 1.0),
        _links(points, every, every, GAP_NEIGHBORS, lambda i, j: component[i] != component[j], GAP_WEIGHT),
        _links(points, every[hidden], every[~hidden], GAP_NEIGHBORS, lambda i, j: i != j, GAP_WEIGHT),
    ]
    one, other, weight = (np.concatenate(each) for each in zip(*links, strict=True))
    squared = np.square(points[one] - points[other]).sum(axis=1)
    # The bound prevents infinite weights between coincident samples.
    squared = np.maximum(squared, max(np.median(squared) / 16, 1e-12))
    return _symmetric(4 * area * weight / squared, one, other, len(points))


def _mirror_links(
    points: Float64, features: Float32, weight: float, generator: np.random.Generator
) -> sparse.csr_matrix:
    """Return symmetric weights (N, N) between each of `points` (N, 3) and the points near its mirror image.

    The weights increase with the similarity of the `features` (N, d), and are proportional to `weight`, the weight of a
    link along the surface. The mirror plane is perpendicular to the axis that gives the largest sum of weights.
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


def _symmetric(weights: NDArray[np.floating], one: Int64, other: Int64, count: int) -> sparse.csr_matrix:
    """Return a symmetric matrix (N, N), N = `count`, with half of each weight at (one, other) and at (other, one)."""
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
    """Return those links from samples in `ends` to the nearest other samples in `others` for which `linked` is True.

    The result is the samples at both ends of each link, and the weights, which all equal `weight` / `neighbors`.
    """
    wanted = min(neighbors + 1, len(others))
    if len(ends) == 0 or wanted == 0:
        return np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0)
    _, near = cKDTree(positions[others]).query(positions[ends], np.arange(1, wanted + 1), workers=-1)
    one, other = np.repeat(ends, wanted), others[near.ravel()]
    kept = (one != other) & linked(one, other)
    return one[kept], other[kept], np.full(int(kept.sum()), weight / neighbors)
