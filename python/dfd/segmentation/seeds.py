"""Choose the seeds of patches: evenly spread over the surface, and symmetric in the planes of symmetry.

Farthest-point sampling chooses seeds on one side of all planes, and their mirror images are the other seeds. Lengths
have the unit of `Patches`.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import cKDTree

from dfd.common.linear_algebra import Float64, Int64
from dfd.symmetry.plane import SymmetryPlane

COUNT = 2_000  # approximate number of patches; the computing time grows with the square of this number
NEAR = 0.75  # farthest-point sampling ends if all places are within NEAR patch spacings of a seed
MOST = 2 * COUNT  # largest number of patches; only meshes of many components have more than COUNT
UPRIGHT = 0.01  # largest cosine between the normals of planes of symmetry whose reflections commute
MAPPED = 0.7  # a plane of symmetry maps at least this share of the surface onto the surface
SAME = 1e-5  # two places are exact mirror images up to this distance
GRID = 2.0**30  # distances are rounded to multiples of 1 / GRID


class Mirror(NamedTuple):
    """The plane of all normalized positions p with normal · p = offset."""

    normal: Float64  # (3,) unit vector
    offset: float

    def height(self, points: Float64) -> Float64:
        """Return the signed distances (N,) of `points` (N, 3) from the plane."""
        return points @ self.normal - self.offset

    def image(self, points: Float64) -> Float64:
        """Return the mirror images of `points` (..., 3)."""
        return points - 2 * np.multiply.outer(points @ self.normal - self.offset, self.normal)


def rounded(values: Float64) -> Float64:
    return np.round(values * GRID) / GRID


def _commuting(planes: Sequence[SymmetryPlane]) -> list[SymmetryPlane]:
    """Return the first of `planes` and those perpendicular to it and to each other; their reflections commute."""
    kept: list[SymmetryPlane] = []
    for plane in planes:
        if all(abs(np.dot(plane.normal, other.normal)) < UPRIGHT for other in kept):
            kept.append(plane)
    return kept


def mirrors_of(
    planes: Sequence[SymmetryPlane], middle: Float64, size: float, tree: cKDTree, area: Float64
) -> list[Mirror]:
    """Return those of `planes` whose reflections commute and map the surface to itself, as mirrors.

    `middle` (3,) and `size` are the origin and the unit of lengths, in mesh units. `tree` is the search tree of the
    places, and `area` (M,) are their areas.
    """
    found = []
    for plane in _commuting(planes):
        normal = np.asarray(plane.normal)
        mirror = Mirror(normal, float((plane.offset - normal @ middle) / size))
        if _mapped(mirror, tree, area, COUNT**-0.5) > MAPPED:
            found.append(mirror)
    return found


def _mapped(mirror: Mirror, tree: cKDTree, area: Float64, spacing: float) -> float:
    """Return the share of the surface whose mirror image lies on the surface."""
    apart = tree.query(mirror.image(np.asarray(tree.data)), distance_upper_bound=spacing / 2)[0]
    return float(area[np.isfinite(apart)].sum())


def orbits(places: Float64, tree: cKDTree, spacing: float, mirrors: Sequence[Mirror]) -> tuple[Int64, Int64]:
    """Return the seeds (P,) of patches, which are indices of `places` (M, 6), and the orbit (P,) of each seed.

    Farthest-point sampling chooses seeds on one side of all planes. Their mirror images are the other seeds. `tree` is
    the search tree of the positions of the places.
    """
    center, near = places[:, :3], NEAR * spacing
    half = np.ones(len(places), bool)
    for mirror in mirrors:
        half &= mirror.height(center) > -spacing / 4
    own = np.flatnonzero(half)
    chosen = own[_farthest_points(places[own], [0], near, MOST >> len(mirrors))]  # the first place is in the middle
    of_seed: dict[int, int] = {}
    for orbit, seed in enumerate(chosen.tolist()):
        images = [center[seed]]
        for mirror in mirrors:
            images += [mirror.image(point) for point in images]
        apart, nearest = tree.query(np.array(images))
        members: list[int] = []
        for image in nearest[apart < spacing / 2].tolist():
            if all(np.linalg.norm(places[image] - places[other]) > near / 2 for other in members):
                members.append(image)
                of_seed.setdefault(image, orbit)
    # Places whose mirror images lie off the surface get seeds of their own.
    for seed in _farthest_points(places, list(of_seed), near, MOST)[len(of_seed) :].tolist():
        of_seed[seed] = len(chosen) + seed
    return np.array(list(of_seed)), np.unique(list(of_seed.values()), return_inverse=True)[1]


def symmetric(patch: Int64, tree: cKDTree, seeds: Float64, mirrors: Sequence[Mirror]) -> Int64:
    """Return `patch` (M,), the patch of each place, made symmetric where the places are exact mirror images.

    `tree` is the search tree of the positions of the places, and `seeds` (P, 3) are the positions of the seeds.
    """
    center, of_seed = np.asarray(tree.data), cKDTree(seeds)
    for mirror in mirrors:
        below = np.flatnonzero(mirror.height(center) < 0)
        apart, image = tree.query(mirror.image(center[below]))
        offset, mate = of_seed.query(mirror.image(seeds))
        exact = (apart < SAME) & (offset[patch[image]] < SAME)
        patch[below[exact]] = mate[patch[image[exact]]]
    return patch


def _farthest_points(points: Float64, first: Sequence[int], near: float, most: int) -> Int64:
    """Return the indices `first`, and more of `points` (N, D), each farthest from those before.

    The result (K,) ends if no point is farther than `near` from all others in it.
    """
    tree, chosen = cKDTree(points), list(first)
    apart = rounded(cKDTree(points[chosen]).query(points)[0])
    while len(chosen) < most and apart.max() >= near:
        farthest = int(apart.argmax())
        chosen.append(farthest)
        # Only points within the largest distance can come nearer.
        some = np.array(tree.query_ball_point(points[farthest], apart[farthest]))
        apart[some] = np.minimum(apart[some], rounded(np.linalg.norm(points[some] - points[farthest], axis=1)))
    return np.array(chosen)


def nearest_seed(graph: csr_array, seeds: Int64, center: Float64) -> Int64:
    """Return the index of the seed nearest to each place, (M,), along the surface; in space if there is no path."""
    _, _, source = dijkstra(graph, indices=seeds, min_only=True, return_predecessors=True)
    number = np.full(len(center), -1)
    number[seeds] = np.arange(len(seeds))
    found = np.where(source >= 0, number[np.maximum(source, 0)], -1)
    lost = found < 0
    if lost.any():
        found[lost] = cKDTree(center[seeds]).query(center[lost])[1]
    return found


def orbits_of_patches(
    orbit: Int64, seed_of_patch: Int64, center: Float64, spacing: float, mirrors: Sequence[Mirror]
) -> Int64:
    """Return the orbit (P,) of each patch, from the orbits (S,) of seeds and the seed (P,) of each patch, or −1.

    A patch without a seed has the orbit of the patches that are mirror images of it.
    """
    alone = np.flatnonzero(seed_of_patch < 0)
    found = np.append(orbit, 0)[seed_of_patch]
    if len(alone):
        tree, pairs = cKDTree(center[alone]), [np.zeros((2, 0), np.int64)]
        for mirror in mirrors:
            apart, image = tree.query(mirror.image(center[alone]))
            mutual = np.flatnonzero((apart < spacing / 4) & (image[image] == np.arange(len(alone))))
            pairs.append(np.stack([mutual, image[mutual]]))
        ends = np.concatenate(pairs, axis=1)
        graph = csr_array((np.ones(ends.shape[1]), tuple(ends)), shape=(len(alone), len(alone)))
        found[alone] = len(orbit) + connected_components(graph, directed=False)[1]
    return np.unique(found, return_inverse=True)[1]
