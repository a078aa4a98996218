"""Measure how exactly the right side mirrors a motion of the left side, in rigs with left and right joints."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

import dfd
from bench.quality.anatomy import LARGEST_JUDGED, SMALLEST_JUDGED, RiggedShape, rigged_shapes, sides_as_one
from bench.quality.measures import session_of
from dfd.common.linear_algebra import Float64, Int64

EXACT = 0.02  # a motion counts as mirrored if its error is at most this fraction of the part's size
SYMMETRIC = 0.01  # largest RMS distance between a side at rest and the mirrored other side, divided by the part's size
ANGLE, PULL = 30.0, 0.2  # angle of the motions in degrees, and translation as a fraction of the part's size
MOTIONS: dict[str, Any] = {"bend": {"bend": ANGLE}, "twist": {"twist": ANGLE}, "turn": {"rotation": (0.0, 0.0, ANGLE)}}
LEGEND = {
    "apart": "fraction of the pairs of joints for which a handle on the left side moves several separate components",
    "bend": f"fraction of these pairs that mirror a bend by {ANGLE:g}° with an error of at most {EXACT:.0%}",
    "twist": f"the same for a twist by {ANGLE:g}°",
    "turn": f"the same for a rotation by {ANGLE:g}°",
    "pull": f"the same for a translation by {PULL:.0%} of the part's size",
}


@dataclass(frozen=True, eq=False)
class Pair:
    """Two joints that differ only in side, with their subtrees. "Left" is the side of the first joint in the file."""

    vertex: int  # vertex of the handle: the one nearest to the center of the left joint's vertices
    left: Int64  # (N,) vertex indices
    right: Int64  # (N,) indices of the vertices nearest to the mirror images of `left`
    axis: int  # index of the coordinate that the mirror image negates
    size: float  # diagonal of the left side's bounding box, mesh units

    def error(self, moved: Float64) -> float:
        """Return the RMS difference of right and mirrored left displacements in `moved` (V, 3), divided by `size`."""
        mirrored = moved[self.left]
        mirrored[:, self.axis] *= -1.0
        apart = np.linalg.norm(moved[self.right] - mirrored, axis=1)
        return float(np.sqrt(np.square(apart).mean())) / self.size


def paired_shapes(folder: Path, *, quick: bool = False) -> Iterator[RiggedShape]:
    """Yield those rigs of a folder's GLB files that have pairs of joints; `quick` reads only two files."""
    return (shape for shape in rigged_shapes(folder, quick=quick) if pairs_of(shape))


def judged(shape: RiggedShape, field: dfd.Field) -> dict[str, float]:
    """Return the numbers that `LEGEND` explains. If the first number is 0, all others are NaN."""
    session = session_of(shape.mesh, field)
    found = [_errors(session, pair) for pair in pairs_of(shape)]
    exact = [np.array(errors) <= EXACT for errors in found if errors]
    shares = np.mean(exact, axis=0) if exact else np.full(len(LEGEND) - 1, np.nan)
    return dict(zip(LEGEND, [len(exact) / len(found), *shares.tolist()], strict=True))


def _errors(session: dfd.Deformer, pair: Pair) -> list[float]:
    """Return the error of each motion of a handle on the left side; [] if the handle moves only one component."""
    held = session.add(pair.vertex)
    found = []
    if len(session.counterparts(held)) > 1:
        for given in (*MOTIONS.values(), {"translation": (0.0, PULL * pair.size, 0.0)}):
            try:
                session.move(held, **given)
                found.append(pair.error(session.vertices - session.mesh.vertices))
                session.undo()
            except ValueError:  # The handle's part has no axis for a bend or twist.
                found.append(np.inf)
    session.remove(held)
    return found


def pairs_of(shape: RiggedShape) -> list[Pair]:
    """Return the pairs of joints whose names differ only in side, and whose subtrees are mirror images at rest."""
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
        if np.sqrt(np.square(apart).mean()) <= SYMMETRIC * size:
            middle = np.linalg.norm(vertices[own] - vertices[own].mean(axis=0), axis=1).argmin()
            found.append(Pair(int(own[middle]), left, right[nearest], axis, size))
    return found
