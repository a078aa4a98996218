"""What of a shape is farther from its middle than a place: who grabs a limb means at least all beyond the hand."""

from __future__ import annotations

import numpy as np
from scipy.sparse.csgraph import connected_components, dijkstra

import dfd._core as _core
from dfd.common.linear_algebra import Bool
from dfd.segmentation.patches import Patches

STARTS = 96  # patches from which distances are measured to find the middle


class Distal:
    """Distances along the surface from the patch in the middle of the largest component, and the shortest paths."""

    def __init__(self, patches: Patches) -> None:
        borders = patches.borders
        graph = borders.graph(borders.apart)
        component = connected_components(graph, directed=False)[1]
        body = np.flatnonzero(component == np.bincount(component, patches.area).argmax())
        starts = body[:: len(body) // STARTS + 1]
        middle = body[np.square(dijkstra(graph, indices=starts)[:, body]).sum(axis=0).argmin()]
        self._distance, before = dijkstra(graph, indices=middle, return_predecessors=True)
        self._pairs = borders.pairs.astype(np.int32)
        # For k = 0, 1, …: the patch 2ᵏ steps nearer to the middle.
        step = np.where(before >= 0, before, np.arange(len(before)))
        self._steps = [step]
        while not np.array_equal(step, step[step]):
            step = step[step]
            self._steps.append(step)

    def through(self, inside: Bool) -> Bool:
        """(P,) Return a part `inside` (P,) and all patches whose shortest path from the middle leads through it."""
        reached = inside
        for step in self._steps:
            reached = reached | reached[step]
        return reached

    def side(self, patch: int) -> Bool:
        """(P,) Return the connected component, around a patch, of all that is at least as far from the middle."""
        far = self._distance >= self._distance[patch]
        pairs = self._pairs[far[self._pairs].all(axis=1)]
        component = _core.components(len(far), np.zeros((0, 3), np.int32), pairs)
        return np.asarray(component == component[patch])
