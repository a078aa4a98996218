"""The page of pictures: per shape its features, and its best and its worst part beside distance along the surface."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

import dfd
from bench.quality.baselines import geodesic
from bench.quality.evaluate import handles
from bench.quality.measures import handle_precision
from bench.quality.shapes import Shape
from bench.quality.studies import Bench
from dfd.common.linear_algebra import Bool, Float64, Int64, UInt8
from dfd.pictures.colors import feature_colors
from dfd.pictures.contact_sheet import heat_bar
from dfd.pictures.picture import picture

RESOLUTION = 320

Picture = tuple[UInt8, str]


def row(bench: Bench, shape: Shape) -> tuple[str, Sequence[Picture]]:
    """Draw one labelled shape: a heading, and pictures with captions."""
    mesh, labels = shape.mesh, shape.labels
    features = bench.lab.field(shape.name, mesh, seed=bench.seeds[0]).features(mesh)
    chosen = handles(shape, bench.draw.each, bench.draw.seeds[0])
    weights = dfd.bind(features, chosen)
    precision = handle_precision(weights, labels, chosen)
    own = labels[chosen]
    by_part = {part: np.nanmean(precision[own == part]) for part in np.unique(own[~np.isnan(precision)])}
    pictures: list[Picture] = [(picture(mesh, colors=feature_colors(features), resolution=RESOLUTION), "features")]
    geodesics = dfd.Geodesics(mesh)
    for word, part in (
        ("best", max(by_part, key=by_part.__getitem__)),
        ("worst", min(by_part, key=by_part.__getitem__)),
    ):
        column = _typical(precision, own == part)
        handle = chosen[column : column + 1]
        baseline = geodesic(geodesics, handle)
        name = shape.parts[part]
        ranked = float(handle_precision(baseline, labels, handle)[0])
        pictures.append((heat(mesh, weights[:, column], handle), f"{word}: {name}, precision {precision[column]:.2f}"))
        pictures.append((heat(mesh, baseline[:, 0], handle), f"{name} by geodesic distance, {ranked:.2f}"))
    pictures.append((heat_bar(RESOLUTION), ""))
    return f"{shape.name}: part precision {np.mean(list(by_part.values())):.2f}", pictures


def worst(bench: Bench, shapes: Sequence[Shape], count: int = 10) -> tuple[str, Sequence[Picture]]:
    """Draw the parts, over all `shapes`, whose handles rank them the worst: a heading, and pictures with captions."""
    found = []
    for shape in shapes:
        features = bench.lab.field(shape.name, shape.mesh, seed=bench.seeds[0]).features(shape.mesh)
        chosen = handles(shape, bench.draw.each, bench.draw.seeds[0])
        weights = dfd.bind(features, chosen)
        precision, own = handle_precision(weights, shape.labels, chosen), shape.labels[chosen]
        for part in np.unique(own[~np.isnan(precision)]):
            column = _typical(precision, own == part)
            mean = float(np.nanmean(precision[own == part]))
            found.append((mean, shape, shape.parts[part], weights[:, column], chosen[column : column + 1]))
    found.sort(key=lambda each: each[0])
    pictures: list[Picture] = [
        (heat(shape.mesh, weights, handle), f"{shape.name}, {part}: {mean:.2f}")
        for mean, shape, part, weights, handle in found[:count]
    ]
    return f"The {len(pictures)} parts that weights tell apart the least", pictures


def _typical(precision: Float64, among: Bool) -> int:
    """The column of `among` whose precision is nearest to their mean: neither a lucky nor an unlucky handle."""
    columns = np.flatnonzero(among & ~np.isnan(precision))
    return int(columns[np.abs(precision[columns] - precision[columns].mean()).argmin()])


def heat(mesh: dfd.Mesh, weights: NDArray[np.floating], handle: Int64) -> UInt8:
    """Draw weights of one handle, seen from the side that it is on."""
    x, _, z = mesh.normals[handle[0]]
    azimuth = float(np.degrees(np.arctan2(x, z))) if np.hypot(x, z) > 0.3 else 35.0
    return picture(mesh, weights=weights, handles=handle, azimuth=azimuth, resolution=RESOLUTION)
