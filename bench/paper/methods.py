"""Methods that DFD is compared with: each returns the moved vertices (V, 3) of a case, mesh units, or says why not."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from bench.paper.handles import Case
from bench.paper.peers import PEERS
from bench.paper.peers.peer import Done, Job, run

__all__ = ["BALL", "COMPARED", "constraints", "deform", "others"]

BALL = 0.01  # of the longest side: the radius in which the paper gives other methods the neighbors of a point as well
COMPARED = (
    "ARAP",
    "biharmonic",
    "BBW",
    "NeuralMLS",
)  # on pages of pictures; OptCtrlPoints has the second one's weights


def deform(name: str, case: Case, ball: float = BALL) -> Done:
    """A case by the peer called `name`; biharmonic coordinates of the set's own are taken where it has them.

    Raises
    ------
    PeerError
        As `bench.paper.peers.peer.run`.
    """
    if name == "biharmonic" and case.coordinates is not None:
        return Done(case.mesh.vertices + case.coordinates @ (case.held_to - case.mesh.vertices[case.held]))
    return run(PEERS[name], case.mesh, [constraints(case, ball)])[0]


def others(case: Case, ball: float) -> dict[str, Callable[[], NDArray[np.float64]]]:
    """Every method of pages of pictures by its name, ready to be called on `case`."""
    return {name: partial(_moved, name, case, ball) for name in COMPARED}


def _moved(name: str, case: Case, ball: float) -> NDArray[np.float64]:
    return deform(name, case, ball).vertices


def constraints(case: Case, ball: float = BALL) -> Job:
    """Vertices, distinct, and where they are to be: those that are held, and their neighbors.

    Every corner of a face within `ball`, a part of the longest side, goes as the nearest held vertex does. A handle and
    its neighbors are one group, fixed points none.
    """
    offsets = case.held_to - case.mesh.vertices[case.held]
    corners: NDArray[np.int64] = np.unique(case.mesh.faces).astype(np.int64)
    radius = 0.0 if case.dense else ball * float(case.mesh.extents.max())
    distance, nearest = KDTree(case.mesh.vertices[case.held]).query(case.mesh.vertices[corners])
    near = distance <= radius
    held, group = corners[near], nearest[near]
    group = np.where(np.isin(case.held[group], case.fixed), -1, group)
    return Job(held, group, case.mesh.vertices[held] + offsets[nearest[near]])
