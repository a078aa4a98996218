"""Divide the whole shape into parts with clear borders, each with its counterparts."""

import numpy as np

from dfd.common.linear_algebra import Int64
from dfd.segmentation.alike import alike
from dfd.segmentation.choose import LARGEST, SMALLEST, clarity
from dfd.segmentation.tree import Tree

LEAST_AREA = 0.005  # smallest area of a part in a cut of the whole shape, as a share of the surface


def cut_labels(tree: Tree) -> Int64:
    """Return the part of each patch, (P,). A part that is too small joins the part that it touches most.

    The parts are the tree nodes that cover the shape once, with the largest sum of `clarity` × area.
    """
    patches = tree.patches
    label = np.full(len(patches.area), -1)
    for node in sorted(_clearest(tree), key=lambda node: -tree.areas[node]):
        if (label[tree.inside[node]] < 0).any():
            new = label.max() + 1
            for region in alike(tree, node, tree.inside[node]):
                label[region & (label < 0)] = new
    for small in sorted(set(label.tolist()), key=lambda number: patches.area[label == number].sum()):
        if patches.area[label == small].sum() >= LEAST_AREA:
            break
        ends = label[patches.borders.pairs]
        between = (ends == small).any(axis=1) & (ends[:, 0] != ends[:, 1])
        if between.any():
            beside = ends[between].sum(axis=1) - small
            label[label == small] = np.bincount(beside, patches.borders.length[between] + 1e-9).argmax()
    return label


def _clearest(tree: Tree) -> list[int]:
    """Return the nodes of the clearest cut. The best cut of a node is the node, or its children's best cuts together."""
    worth = np.zeros(len(tree.parent))
    cuts: list[list[int]] = [[] for _ in worth]
    below = np.zeros(len(worth))
    for node, parent in enumerate(tree.parent.tolist()):
        own = tree.areas[node] * clarity(tree, node) if SMALLEST < tree.areas[node] < LARGEST else 0.0
        if not cuts[node] or own >= below[node]:
            cuts[node] = [node]
        worth[node] = max(own, below[node])
        if parent >= 0:
            below[parent] += worth[node]
            cuts[parent] = cuts[parent] + cuts[node]
    return cuts[-1]
