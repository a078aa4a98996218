"""Draws the strips of pictures that tooltips show, `python -m docs.tools.tips`.

They are of a made quadruped, whose features are its parts' labels, softened along the surface: nothing is learned.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from scipy.sparse import coo_array, diags_array

import dfd
from dfd.field.vertex_field import VertexField
from dfd.pictures.picture import picture

CELL, DRAWN = 104, 416  # pixels along a picture, and along what it is made smaller from
TARGET = Path(__file__).parents[2] / "python/dfd/app/client/public/tips"


def features_of(sample: dfd.samples.Sample) -> np.ndarray:
    """(V, D) labels of parts, softened by a random walk, and the height, which tells a foot from a thigh."""
    mesh = sample.mesh
    count = len(mesh.vertices)
    rows, columns = np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]]).T
    edges = coo_array((np.ones(len(rows)), (rows, columns)), (count, count)).tocsr()
    edges = edges + edges.T
    walk = diags_array(1 / edges.sum(axis=1)) @ edges
    features = np.eye(len(sample.parts))[sample.labels]
    for _ in range(24):
        features = 0.5 * features + 0.5 * (walk @ features)
    return np.column_stack([features, 0.35 * mesh.vertices[:, 1]])


def main() -> None:
    sample = dfd.samples.quadruped(12000)
    mesh = sample.mesh
    field = VertexField(mesh, features_of(sample))
    features = field.features(mesh)

    tail = sample.vertices_of("tail")
    tip = int(tail[mesh.vertices[tail, 1].argmin()])
    leg = sample.vertices_of("leg", 0)
    knee = int(leg[np.abs(mesh.vertices[leg, 1] - mesh.vertices[leg, 1].mean()).argmin()])
    head = sample.vertices_of("head")
    nose = int(head[mesh.vertices[head, 2].argmax()])

    def held(at: int, **how: Any) -> dfd.Deformer:
        session = dfd.Deformer(mesh, field, features=features)
        session.add(at, **how)
        return session

    forward: dict[str, Any] = {"translation": (0.0, 0.12, 0.22)}
    turned: dict[str, Any] = {"rotation": (-35.0, 0.0, 0.0)}
    # A quarter from behind for the tail, from the side for all else.
    curves = "linear", "sphere", "constant"
    strips: dict[str, tuple[float, list[dfd.Deformer]]] = {
        "reach": (75.0, [held(nose, **forward, reach=reach) for reach in (0.25, 1.0, 1.5)]),
        "falloff": (75.0, [held(nose, **forward, reach=1.3, falloff=kind) for kind in curves]),
        "strength": (75.0, [held(nose, **forward, strength=strength) for strength in (0.3, 0.6, 1.0)]),
        "instances": (75.0, [held(knee, **turned, instances=kind) for kind in ("only", "own_pivot", "shared_pivot")]),
        "locality": (75.0, [held(nose, **forward, reach=1.5, locality=locality) for locality in (0.0, 2.0, 8.0)]),
        "mask": (75.0, [held(nose, **forward, reach=1.5), held(nose, **forward, reach=1.5, mask="part")]),
        "pivot": (75.0, [held(nose, rotation=(40.0, 0.0, 0.0), pivot=place) for place in ("base", "middle", "point")]),
        "bend": (115.0, [held(tip, bend=80.0 * on, joint=joint) for on, joint in ((0, None), (1, None), (1, 0.5))]),
    }
    TARGET.mkdir(parents=True, exist_ok=True)
    for name, (azimuth, sessions) in strips.items():
        frame = [mesh.vertices, *(session.vertices for session in sessions)]
        cells = []
        for session in sessions:
            drawn = picture(
                mesh,
                vertices=session.vertices,
                weights=session.weights.max(axis=1),
                frame=frame,
                azimuth=azimuth,
                **({"zoom": 2.0, "target": mesh.vertices[tail].mean(axis=0)} if name == "bend" else {}),
                resolution=DRAWN,
            )
            cells.append(np.asarray(Image.fromarray(drawn).resize((CELL, CELL), Image.Resampling.LANCZOS)))
        path = TARGET / f"{name}.webp"
        Image.fromarray(np.concatenate(cells, axis=1)).save(path, quality=82, method=6)
        print(f"{path.name}: {path.stat().st_size} bytes")


if __name__ == "__main__":
    main()
