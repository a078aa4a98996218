"""Measure how exactly the other side mirrors a motion, judged by rigs with left and right joints."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

import dfd
from bench.quality.anatomy import LARGEST_JUDGED, SMALLEST_JUDGED, RiggedShape, rigged_shapes, sides_as_one
from dfd.common.linear_algebra import Float64, Int64

EXACT = 0.02  # of the part's size, the largest difference of the other side from the mirror image
ALIKE = 0.01  # of the part's size, the largest difference from a mirror image at rest
ANGLE, PULL = 30.0, 0.2  # degrees, and of the part's size
MOTIONS: dict[str, Any] = {"bend": {"bend": ANGLE}, "twist": {"twist": ANGLE}, "turn": {"rotation": (0.0, 0.0, ANGLE)}}
LEGEND = {
    "apart": "fraction of the pairs in which a handle on the left side moves several separate components",
    "bend": f"of these, the fraction whose right side mirrors the left one to {EXACT:.0%}, bent by {ANGLE:g}°",
    "twist": f"the same of a twist by {ANGLE:g}°",
    "turn": f"the same of a rotation by {ANGLE:g}°",
    "pull": f"the same of a translation by {PULL:.0%} of the part's size",
}


@dataclass(frozen=True, eq=False)
class Pair:
    """The vertices of the subtrees of a left joint and of its right counterpart."""

    vertex: int  # of the left joint, nearest to its middle
    left: Int64  # (N,) vertices
    right: Int64  # (N,) the vertices nearest to their mirror images
    axis: int  # the coordinate that the mirror image negates
    size: float  # the diagonal of the left part's box, mesh units

    def error(self, moved: Float64) -> float:
        """Return the root mean squared difference of displacements (V, 3) from mirror images, over the part's size."""
        mirrored = moved[self.left]
        mirrored[:, self.axis] *= -1.0
        apart = np.linalg.norm(moved[self.right] - mirrored, axis=1)
        return float(np.sqrt(np.square(apart).mean())) / self.size


def paired_shapes(folder: Path, *, quick: bool = False) -> Iterator[RiggedShape]:
    """Read the skinned GLB files of a folder that have pairs of joints; `quick` reads the first two files."""
    return (shape for shape in rigged_shapes(folder, quick=quick) if pairs_of(shape))


def judged(shape: RiggedShape, field: dfd.Field) -> dict[str, float]:
    """Return every number of `LEGEND`; those of motions are NaN if no pair is apart."""
    session = dfd.Deformer(shape.mesh, field)
    found = [_errors(session, pair) for pair in pairs_of(shape)]
    exact = [np.array(errors) <= EXACT for errors in found if errors]
    shares = np.mean(exact, axis=0) if exact else np.full(len(LEGEND) - 1, np.nan)
    return dict(zip(LEGEND, [len(exact) / len(found), *shares.tolist()], strict=True))


def _errors(session: dfd.Deformer, pair: Pair) -> list[float]:
    """Return the error of each motion of a handle on the left side; no error if it moves one component."""
    held = session.add(pair.vertex)
    found = []
    if len(session.counterparts(held)) > 1:
        for given in (*MOTIONS.values(), {"translation": (0.0, PULL * pair.size, 0.0)}):
            try:
                session.move(held, **given)
                found.append(pair.error(session.vertices - session.mesh.vertices))
                session.undo()
            except ValueError:  # the held part has no axis
                found.append(np.inf)
    session.remove(held)
    return found


def pairs_of(shape: RiggedShape) -> list[Pair]:
    """Return the pairs of joints with one name whose parts are mirror images at rest."""
    found, vertices = [], shape.mesh.vertices
    names = [*map(sides_as_one, shape.joints)]
    for pair in (name for name in dict.fromkeys(names) if names.count(name) == 2):
        one, other = (joint for joint, name in enumerate(names) if name == pair)
        sides, own = (shape.subtree(one), shape.subtree(other)), np.flatnonzero(shape.of_vertex == one)
        judged = SMALLEST_JUDGED <= shape.areas @ sides[0] <= LARGEST_JUDGED
        if not (judged and len(own) and sides[1].any()) or (sides[0] & sides[1]).any():
            continue
        left, right = map(np.flatnonzero, sides)
        middles = [np.average(vertices[side], axis=0, weights=shape.areas[side] + 1e-12) for side in (left, right)]
        axis = int(np.abs(middles[0] - middles[1]).argmax())
        image = vertices[left]
        image[:, axis] = middles[0][axis] + middles[1][axis] - image[:, axis]
        apart, nearest = cKDTree(vertices[right]).query(image)
        size = float(np.linalg.norm(np.ptp(vertices[left], axis=0)))
        if np.sqrt(np.square(apart).mean()) <= ALIKE * size:
            middle = np.linalg.norm(vertices[own] - vertices[own].mean(axis=0), axis=1).argmin()
            found.append(Pair(int(own[middle]), left, right[nearest], axis, size))
    return found
