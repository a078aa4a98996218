"""What every peer can do, and how one is run and timed where it can neither hang nor crash the bench."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

import dfd
from bench.paper.peers.tetrahedra import MOST_FACES, Tetrahedra, tetrahedra
from bench.quality.baselines import PeerError, in_child
from dfd.common.linear_algebra import Float64, Int64

PATIENCE = 300.0  # seconds for all that one peer does with one shape


@dataclass(frozen=True)
class Body:
    """A surface all of whose vertices are corners of faces, and the tetrahedra within it for those that need them."""

    vertices: Float64  # (V, 3)
    faces: Int64  # (F, 3)
    within: Tetrahedra | None = None


class Peer(Protocol):
    """Three steps, each timed: `prepare` once a shape, `bind` once a set of handles, `deform` once a pose.

    Each may raise PeerError.
    """

    volume: bool  # whether it needs tetrahedra

    def prepare(self, body: Body) -> None:
        """Take the shape."""

    def bind(self, held: Int64, group: Int64) -> None:
        """Take vertices (N,) that will be moved; those of one `group` (N,) move alike, and stay where it is below 0."""

    def deform(self, targets: Float64) -> Float64:
        """The vertices (V, 3) when the held ones are at `targets` (N, 3), as near as the method can."""


@dataclass(frozen=True)
class Job:
    """Vertices (N,) of a mesh, the groups that they move in (N,), below 0 for those that stay, and targets (N, 3)."""

    held: Int64
    group: Int64
    targets: Float64


@dataclass(frozen=True)
class Done:
    """Moved vertices (V, 3), mesh units, and the seconds of every step."""

    vertices: Float64
    seconds: dict[str, float] = field(default_factory=dict)


def run(
    make: Callable[[], Peer],
    mesh: dfd.Mesh,
    jobs: Sequence[Job],
    *,
    patience: float = PATIENCE,
    most_faces: int | None = MOST_FACES,
) -> list[Done]:
    """Do `jobs` on one shape by one peer, in a process of its own, within `patience` seconds.

    Tetrahedra are those of the shape simplified to `most_faces`; None fills it as it is, within `patience` too.

    Raises PeerError if the peer is not installed, cannot do the shape or the handles, fails, crashes or takes too long.
    """
    used, faces = np.unique(mesh.faces, return_inverse=True)  # a vertex of no face makes equations singular
    faces = faces.reshape(-1, 3).astype(np.int64)
    filled = {} if most_faces else {"patience": patience, "most_faces": None}
    body = Body(mesh.vertices[used], faces, tetrahedra(mesh.vertices[used], faces, **filled) if make().volume else None)
    own = [Job(np.searchsorted(used, mesh.representative[job.held]), job.group, job.targets) for job in jobs]
    done = []
    for moved, seconds in in_child(_run, make, body, own, seconds=patience):
        if not np.isfinite(moved).all():
            raise PeerError("gives NaN")
        vertices = mesh.vertices.copy()
        vertices[used] = moved
        if body.within is not None:
            seconds = {"tetrahedra": body.within.seconds, **seconds}
        done.append(Done(vertices[mesh.representative], seconds))
    return done


def _run(make: Callable[[], Peer], body: Body, jobs: Sequence[Job]) -> list[tuple[Float64, dict[str, float]]]:
    peer = make()
    begin = time.perf_counter()
    peer.prepare(body)
    prepared = time.perf_counter() - begin
    done = []
    for job in jobs:
        start = time.perf_counter()
        peer.bind(job.held, job.group)
        bound = time.perf_counter()
        moved = peer.deform(job.targets)
        done.append((moved, {"prepare": prepared, "bind": bound - start, "pose": time.perf_counter() - bound}))
    return done
