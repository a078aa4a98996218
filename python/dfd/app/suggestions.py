"""Places worth taking hold of: the vertices that look least like those chosen before."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dfd.app.columns import nearest
from dfd.app.protocol.answers import Suggestion
from dfd.editing.place import place_on

if TYPE_CHECKING:
    from dfd.editing.deformer import Deformer

__all__ = ["suggestions"]

# Feature distance below which another suggestion would say the same once more.
ALIKE = 0.35


def suggestions(deformer: Deformer, count: int) -> tuple[Suggestion, ...]:
    """At most `count` places, farthest points in feature space, the first the one farthest from the middle of the box.

    Source: Gonzalez, "Clustering to minimize the maximum intercluster distance", 1985.
    """
    mesh = deformer.mesh
    middle = mesh.bounds.mean(axis=0)
    vertex = int(np.argmax(np.square(mesh.vertices - middle).sum(axis=1)))
    chosen: list[int] = []
    distance = np.full(len(mesh.vertices), np.inf, np.float32)
    owner = np.zeros(len(mesh.vertices), np.int64)
    while len(chosen) < count and distance[vertex] > ALIKE:
        from_it = nearest(deformer, place_on(mesh, vertex))
        closer = from_it < distance
        owner[closer] = len(chosen)
        np.minimum(distance, from_it, out=distance)
        chosen.append(vertex)
        vertex = int(np.argmax(distance))
    shares = np.bincount(owner, minlength=len(chosen)) / len(mesh.vertices)
    return tuple(
        Suggestion(
            vertex=vertex,
            position=tuple(float(x) for x in mesh.vertices[vertex]),  # type: ignore[arg-type]  # always three
            name=f"part {index + 1}",
            group=index,
            share=float(shares[index]),
        )
        for index, vertex in enumerate(chosen)
    )
