"""Choose the seeds of patches, evenly spread over the surface, and divide the surface between them.

With planes of symmetry, the surface is folded first: each place stands for its mirror image on the positive side of all
planes. Farthest-point sampling chooses seeds on the folded surface, so patches are symmetric. Lengths have the unit of
`Patches`.
"""

from collections.abc import Sequence

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from dfd.common.linear_algebra import Float64, Int64
from dfd.symmetry.plane import SymmetryPlane

COUNT = 2_000  # approximate number of patches; the computing time grows with the square of this number
# NEAR: farthest-point sampling ends if all places are within NEAR patch spacings of a seed. On every sixth mesh of
# `bench.quality people`, level 0 is 0.004 smaller with 0.6, and 0.045 with 0.9.
NEAR = 0.75
MOST = 2 * COUNT  # largest number of patches; only meshes of many components have more than COUNT
# UPRIGHT: largest cosine between the normals of planes of symmetry whose reflections commute. With 0.1, all parts of
# these meshes stay the same; with one plane only, level 0 is 0.011 smaller, and sets 0.009.
UPRIGHT = 0.01
GRID = 2.0**30  # distances are rounded to multiples of 1 / GRID


def rounded(values: Float64) -> Float64:
    return np.round(values * GRID) / GRID


def mirror_images(
    planes: Sequence[SymmetryPlane], middle: Float64, size: float, tree: cKDTree
) -> list[tuple[Float64, Int64]]:
    """Return the height (M,) of each place above each plane, and the place (M,) at its mirror image, or −1.

    A place is at the mirror image if it is within half a patch spacing. Planes whose reflections do not commute with
    those before are left out. `middle` (3,) and `size` are the origin and the unit of lengths, in mesh units. `tree` is
    the search tree of the places.
    """
    found, center, kept = [], np.asarray(tree.data), list[Float64]()
    for plane in planes:
        normal = np.asarray(plane.normal)
        if all(abs(normal @ other) < UPRIGHT for other in kept):
            kept.append(normal)
            height = center @ normal - (plane.offset - normal @ middle) / size
            apart, image = tree.query(center - 2 * np.outer(height, normal), distance_upper_bound=COUNT**-0.5 / 2)
            found.append((height, np.where(np.isfinite(apart), image, -1)))
    return found


def divided(places: Float64, graph: csr_array, mirrors: Sequence[tuple[Float64, Int64]]) -> tuple[Int64, Int64, Int64]:
    """Divide the surface between seeds. Return, for each place, (M,): the place for which it stands, its seed and side.

    A place stands for its mirror image on the positive side of all planes, if there is one. The place for which it
    stands belongs to the nearest seed along the folded surface. The side has a bit for each plane of `mirrors`: 1 below
    the plane, or 0 if the seed's surface contains places in the plane. `places` (M, 6) are positions and scaled
    normals, and `graph` (M, M) are the distances of neighbors.
    """
    stands_for, side = np.arange(len(places)), np.zeros(len(places), np.int64)
    for number, (height, image) in enumerate(mirrors):
        other = image[stands_for]
        below = (other >= 0) & (height[stands_for] < 0) & (height[other] >= 0)
        stands_for = np.where(below, other, stands_for)
        side |= below.astype(np.int64) << number
    folded, number_of = np.unique(stands_for, return_inverse=True)
    seeds = _farthest_points(places[folded], NEAR * COUNT**-0.5, MOST >> len(mirrors))
    seed = nearest_seed(graph[folded][:, folded], seeds, places[folded, :3])[number_of]
    for number, (_, image) in enumerate(mirrors):
        side[np.isin(seed, seed[image == np.arange(len(image))])] &= ~(1 << number)
    return stands_for, seed, side


def _farthest_points(points: Float64, near: float, most: int) -> Int64:
    """Return the indices (K,) of the first of `points` (N, D), and of more points, each farthest from those before.

    The result ends if no point is farther than `near` from all others in it.
    """
    tree, chosen = cKDTree(points), [0]
    apart = rounded(np.linalg.norm(points - points[0], axis=1))
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
