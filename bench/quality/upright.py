"""The table by family: weights as files come, and of the same shapes turned, in grey, and by distance alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import dfd
from bench.quality.baselines import PeerError, biharmonic, euclidean, geodesic
from bench.quality.evaluate import judge
from bench.quality.families import family_of
from bench.quality.shapes import Shape
from bench.quality.studies import Bench, Row

STUDY = "families"
EUCLIDEAN, GEODESIC, BIHARMONIC = "Euclidean distance", "geodesic distance", "biharmonic (libigl)"
Z_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
TURNS: Mapping[str, NDArray[np.float64]] = {
    "z up": Z_UP,
    **{f"turned {seed}": Rotation.random(rng=np.random.default_rng(seed)).as_matrix() for seed in range(3)},
}


def turned(shape: Shape, rotation: NDArray[np.float64]) -> Shape:
    """The same shape, its vertices turned by `rotation` (3, 3); its looks and parts stay."""
    mesh = dfd.Mesh(shape.mesh.vertices @ rotation.T, shape.mesh.faces, appearance=shape.mesh.appearance)
    return replace(shape, mesh=mesh)


def families(bench: Bench, shapes: Sequence[Shape], *, turns: Mapping[str, NDArray[np.float64]] = TURNS) -> list[Row]:
    """Every labelled shape as it comes, turned, turned with the file's up taken for granted, grey, and by distances."""
    rows = []
    for shape in shapes:
        row = partial(Row, STUDY, shape.name)
        rows.append(row("dfd", bench.verdict(shape, {})))
        for name, rotation in turns.items():
            other = turned(shape, rotation)
            rows.append(row(f"dfd, {name}", bench.verdict(other, {})))
            rows.append(row(f"dfd, {name}, up=file", bench.verdict(other, {"up": "file"})))
        if shape.mesh.appearance is not None:
            rows.append(row("dfd, grey", bench.verdict(shape, {"texture": False})))
        judged = partial(judge, shape, draw=bench.draw)
        rows.append(row(EUCLIDEAN, judged(partial(euclidean, shape.mesh.vertices))))
        rows.append(row(GEODESIC, judged(partial(geodesic, dfd.Geodesics(shape.mesh)))))
        try:
            rows.append(row(BIHARMONIC, judged(partial(biharmonic, shape.mesh, shape.labels, bounded=False))))
        except PeerError as error:
            rows.append(row(BIHARMONIC, note=str(error)))
    return rows


def by_family(rows: Sequence[Row]) -> str:
    """A table of mean precision, a line a family and a column a method, and how often distance is as good."""
    own = [row for row in rows if row.study == STUDY]
    settings = list(dict.fromkeys(row.setting for row in own))
    names = dict.fromkeys(family_of(row.shape) for row in own)
    lines = [
        "## Precision by family",
        "",
        "| " + " | ".join(["family", "shapes", *settings]) + " |",
        "|---|" + "---:|" * (len(settings) + 1),
    ]
    for name in [*names, "all"]:
        some = [row for row in own if name in (family_of(row.shape), "all")]
        values = []
        for setting in settings:
            found = [row.verdict["precision"] for row in some if row.setting == setting and "precision" in row.verdict]
            values.append(f"{np.mean(found):.3f} ({len(found)})" if found else "")
        lines.append("| " + " | ".join([name, str(len({row.shape for row in some})), *values]) + " |")
    return "\n".join([*lines, "", _distance_in_words(own), ""])


def _distance_in_words(rows: Sequence[Row]) -> str:
    precision = {(row.shape, row.setting): row.verdict.get("precision", -1.0) for row in rows}
    shapes = list(dict.fromkeys(row.shape for row in rows))
    as_good = [
        shape
        for shape in shapes
        if max(precision.get((shape, method), -1.0) for method in (EUCLIDEAN, GEODESIC)) >= precision[shape, "dfd"]
    ]
    named = f": {', '.join(as_good)}" if as_good else ""
    return f"Plain distance is as good on {len(as_good)} of {len(shapes)} shapes{named}."
