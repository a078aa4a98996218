"""Compare corresponding vertices of two shapes with the landmarks that people set on both.

Beside each mesh `N.off` lies `N.vts`: a line with a vertex and its position for each landmark of the category (Kim,
Lipman and Funkhouser, "Blended intrinsic maps", 2011). Each landmark of a shape is mapped to all other shapes of its
category. The error is the distance along the surface from the landmark there, as a fraction of the square root of the
area. `counterparts.info` names landmarks that are mirror images: a line with the numbers of each pair, from 0.

`dfd.correspond` is for shapes that face the same direction, which these shapes do not. So each other shape is turned
first, with its features, by the rotation that brings its landmarks nearest to those of the shape.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

import dfd
from bench.quality.shapes import Shape
from dfd.common.linear_algebra import Float32, Float64, Int64
from dfd.editing.transfer import Correspondence
from dfd.geometry.topology import face_areas

NEAR = 0.1  # an error below this number counts as near
SURE = 0.5  # a correspondence of at least this confidence counts as sure
LEGEND = {
    "error": "mean distance from the landmark, for the vertices of `dfd.correspond`",
    "near": f"fraction of landmarks with an error below {NEAR}",
    "either side": "the same fraction if the landmark's mirror image is right, too",
    "nearest: …": "the same numbers for the vertices with the most similar feature, without any position",
    "not turned: …": "the same numbers for `dfd.correspond` and the shapes as they stand in their files",
    "sure": f"fraction of landmarks with a confidence of at least {SURE}",
    "sure: near": "fraction of these that are near",
}


@dataclass(frozen=True, eq=False)
class LandmarkShape(Shape):
    """A mesh with landmarks, and the other shapes of its category."""

    category: str = ""
    landmarks: Int64 | None = None  # (L,) vertices
    others: tuple[tuple[dfd.Mesh, Int64], ...] = ()  # the other meshes and their landmarks
    mirrored: Int64 | None = None  # (L,) index of each landmark's mirror image; its own without one


def landmark_shapes(folder: Path, *, quick: bool = False) -> Iterator[LandmarkShape]:
    """Yield every mesh of `folder` with landmarks; `quick` reads one mesh of each category.

    Raises ValueError if `folder` has no such mesh.
    """
    paths = sorted(folder.glob("*/*.vts"))
    if not paths:
        raise ValueError(f"landmarks: there is no CATEGORY/N.vts in {folder}")
    for category in dict.fromkeys(path.parent for path in paths):
        own = [path for path in paths if path.parent == category]
        read = [(dfd.load(path.with_suffix(".off")), np.loadtxt(path, ndmin=2)[:, 0].astype(np.int64)) for path in own]
        mirrored = np.arange(len(read[0][1]))
        info = category / "counterparts.info"
        for pair in (line.split() for line in info.read_text().splitlines() if line.strip()) if info.is_file() else ():
            if len(pair) == 2:
                one, other = map(int, pair)
                mirrored[[one, other]] = other, one
        for path, (mesh, landmarks) in zip(own[: 1 if quick else None], read, strict=False):
            others = tuple(each for each in read if each[0] is not mesh)
            name = f"{category.name} {path.stem}"
            yield LandmarkShape(
                name, mesh, category=category.name, landmarks=landmarks, others=others, mirrored=mirrored
            )


def judged(shape: LandmarkShape, field: dfd.Field) -> dict[str, float]:
    """Return the numbers that `LEGEND` explains."""
    assert shape.landmarks is not None
    assert shape.mirrored is not None
    rows = []
    for mesh, landmarks in shape.others:
        other = dfd.distill(mesh, progress=False)
        features, of_other = field.on(shape.mesh).rows(shape.landmarks), other.on(mesh).rows(slice(None))
        turned = _turned(mesh, landmarks, shape.mesh.vertices[shape.landmarks])
        found = dfd.correspond(shape.mesh, field, turned, dfd.VertexField(turned, of_other))
        as_given = dfd.correspond(shape.mesh, field, mesh, other).vertices[shape.landmarks]
        vertices = {"": found.vertices[shape.landmarks], "nearest: ": _most_similar(features, of_other)}
        row: dict[str, float] = {}
        for kind, those in (vertices | {"not turned: ": as_given}).items():
            apart = _errors(mesh, landmarks, those)
            row |= {kind + name: value for name, value in _numbers(apart, shape.mirrored).items()}
            if not kind:
                row |= _sure(found, shape.landmarks, np.diagonal(apart))
        rows.append(row)
    return {name: float(np.ma.masked_invalid([row[name] for row in rows]).mean()) for name in rows[0]}


def _turned(mesh: dfd.Mesh, landmarks: Int64, others: Float64) -> dfd.Mesh:
    """Return `mesh` with its `landmarks` (L,) turned to those of another shape, at positions `others` (L, 3)."""
    own = mesh.vertices[landmarks].copy()
    turn = Rotation.align_vectors(others - others.mean(axis=0), own - own.mean(axis=0))[0]
    return dfd.Mesh(turn.apply(np.array(mesh.vertices)), mesh.faces)


def _errors(mesh: dfd.Mesh, landmarks: Int64, found: Int64) -> Float64:
    """Return the distances (L, L) from each landmark (row) to each found vertex (column)."""
    geodesics = dfd.Geodesics(mesh)
    along: Float64 = np.asarray(geodesics.distances(landmarks), np.float64)[:, found] * geodesics.extent
    return along / np.sqrt(face_areas(mesh.vertices, mesh.faces).sum())


def _most_similar(rows: Float32, others: Float32) -> Int64:
    """Return the index of the row of `others` (V, D) that is nearest to each of `rows` (L, D)."""
    return np.asarray((rows @ others.T).argmax(axis=1), np.int64)


def _numbers(apart: Float64, mirrored: Int64) -> dict[str, float]:
    own = np.diagonal(apart)
    either = np.minimum(own, apart[mirrored, np.arange(len(apart))])
    return {"error": own.mean(), "near": (own < NEAR).mean(), "either side": (either < NEAR).mean()}


def _sure(found: Correspondence, landmarks: Int64, own: Float64) -> dict[str, float]:
    sure = found.confidence[landmarks] >= SURE
    return {"sure": sure.mean(), "sure: near": (own[sure] < NEAR).mean() if sure.any() else np.nan}
