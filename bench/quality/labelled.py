"""`python -m bench.quality labelled` and `grip`: weights, parts and handles judged by the names that people gave.

With `--turned` weights alone are judged, of each shape as it stands and turned: once by a random rotation, and once to
lie along other axes of the file.

All numbers are means over the handles of a label, the labels of a shape, the shapes of a category, and the categories.
Constants may be chosen on the first half of each category; the second half judges.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

import dfd
from bench.quality.labelled_shapes import LabelledShape, labelled_shapes
from bench.quality.measures import draw_handles, euclidean, geodesic, handle_precision, thickness
from bench.tables import to_csv, to_markdown, write_text
from dfd.common.linear_algebra import Bool, Float32, Float64, Int64, UInt8
from dfd.pictures.contact_sheet import contact_sheet
from dfd.pictures.picture import picture, save_png
from dfd.pictures.viewpoint import azimuth_towards
from dfd.segmentation.parts import Parts

OUTPUT = Path(__file__).resolve().parents[1] / "results" / "quality"
EACH = 4  # handles in every label
NEAR = 0.05  # of the diagonal: a counterpart that near to a landmark is on it
FOLLOWS = 0.35  # of the handle's own weight: a counterpart that follows less is no like of it to people
WORST = 10  # parts that are drawn

Mask = Bool
Verdict = dict[str, float]

LEGEND = {
    "precision": "mean average precision with which a handle's weights rank its own label first",
    "threshold": "IoU with the label of all vertices above the best threshold of a handle's weights",
    "part": "IoU with the label of the part at a click, with its counterparts",
    "best of three": "of that part, the smaller one in it and the larger one around it, the best",
    "component": "IoU of the connected component of the part with that of the label",
    "grip": "Σ min(w, t) / Σ max(w, t) over the surface, for a session's weights w and the label t",
    "coverage": "weight that the label has, of all that it could have",
    "leak": "weight beyond the label, of all weight",
    "counterparts": "counterparts of landmarks within 5 % of the diagonal of one of the landmark's handle",
    "too many": "counterparts of such a handle that are at no landmark",
    "at random": "precision of the shape turned by a random rotation",
    "by axes": "precision of the shape turned to lie along other axes of the file",
    "loss": "what a turn takes away from the precision as it stands",
    "sure": "confidence in the up direction",
    "off": "degrees between the upright axes found for the shape turned and as it stands",
}


@dataclass(frozen=True)
class Judged:
    """What came out for one shape, and its worst part: the IoU, what it is called, its handle and what was found."""

    on: LabelledShape
    verdict: Verdict
    worst: tuple[float, str, int, Mask]


def main(arguments: Sequence[str] | None = None) -> None:
    """Judge a folder of labelled meshes."""
    options = _parser().parse_args(arguments)
    console = Console(stderr=True, highlight=False)
    os.environ["HF_HUB_OFFLINE"] = "1"
    if options.cache is not None:
        os.environ["DFD_CACHE"] = str(options.cache.absolute())
    name = "turned" if options.turned else options.verb
    found: list[Judged] = []
    for on in labelled_shapes(options.folder, quick=options.quick, only=options.only):
        console.print(on.shape.name)
        if options.turned:
            found.append(_turned(on))
        else:
            field = dfd.distill(on.shape.mesh, progress=False)
            found.append(_grips(on, field) if options.verb == "grip" else _judged(on, field, paper=options.paper))
        _write(options.output / name, found)
    if name == "labelled":
        found.sort(key=lambda each: each.worst[0])
        pictures = [(_heat(each), each.worst[1]) for each in found[:WORST]]
        save_png(options.output / "labelled_worst.png", contact_sheet([("", pictures)], title="The worst parts"))
    Console().print(f"{options.output / name}.md", highlight=False, soft_wrap=True)


def _heat(judged: Judged) -> UInt8:
    """Draw the worst part of a shape from the side that its handle is on."""
    mesh, (_, _, handle, mask) = judged.on.shape.mesh, judged.worst
    azimuth = azimuth_towards(mesh, mesh.vertices[[handle]])
    return picture(mesh, weights=mask.astype(np.float32), handles=[handle], azimuth=azimuth, resolution=320)


def _judged(on: LabelledShape, field: dfd.Field, *, paper: bool) -> Judged:
    mesh = on.shape.mesh
    features = field.features(mesh)
    handles = draw_handles(on.labels, EACH)
    verdict: Verdict = {}
    methods: dict[str, Callable[[Int64], NDArray[np.floating]]] = {
        "": partial(dfd.bind, features),
        "Euclidean ": partial(euclidean, mesh.vertices),
        "geodesic ": partial(geodesic, dfd.Geodesics(mesh)),
        "thickness ": partial(thickness, mesh),
    }
    if paper:
        methods["paper "] = partial(dfd.bind, dfd.distill(mesh, preset="paper", progress=False).features(mesh))
    for name, method in methods.items():
        weights = method(handles)
        verdict[f"{name}precision"] = _mean(on, handles, handle_precision(weights, on.labels, handles))
        truths = [on.labels == on.labels[handle] for handle in handles]
        best = [threshold_iou(on, column, truth) for truth, column in zip(truths, weights.T, strict=True)]
        verdict[f"{name}threshold"] = _mean(on, handles, best)
    parts = Parts(mesh, field.on(mesh).rows)
    overlaps, masks = [], []
    for handle in handles.tolist():
        truth, component = on.labels == on.labels[handle], on.components == on.components[handle]
        levels = [parts.part(handle, level).mask for level in ("part", "smaller", "larger")]
        first, *others = (soft_iou(on, mask, truth) for mask in levels)
        alone = soft_iou(on, parts.part(handle, alike=False).mask, component)
        overlaps.append((first, max(first, *others), alone))
        masks.append(levels[0])
    for name, values in zip(("part", "best of three", "component"), np.transpose(overlaps), strict=True):
        verdict[name] = _mean(on, handles, values)
    verdict |= {**_grip(on, field, features, handles, {}), **_counterparts(on, field, features)}
    at = int(np.argmin([first for first, *_ in overlaps]))
    name = on.shape.parts[on.labels[handles[at]]]
    caption = f"{on.shape.name}, {name}: {overlaps[at][0]:.2f}"
    return Judged(on, verdict, (overlaps[at][0], caption, int(handles[at]), masks[at]))


def turns(name: str) -> dict[str, Float64]:
    """Two rotations (3, 3) of a shape called `name`: any one, and one of the 20 that bring its up to another axis."""
    generator = np.random.default_rng([*name.encode()])
    random = Rotation.random(rng=generator).as_matrix()
    along = [turn for turn in Rotation.create_group("O").as_matrix().round() if turn[1, 1] < 1]
    return {"at random": random, "by axes": along[generator.integers(len(along))]}


def _turned(on: LabelledShape) -> Judged:
    """The precision of a shape as it stands and turned, and how far the upright axis that is found then is off."""
    handles = draw_handles(on.labels, EACH)

    def judge(mesh: dfd.Mesh) -> tuple[float, dict[str, Any]]:
        field = dfd.distill(mesh, progress=False)
        weights = dfd.bind(field.features(mesh), handles)
        return _mean(on, handles, handle_precision(weights, on.labels, handles)), field.settings

    mesh = on.shape.mesh
    stands, told = judge(mesh)
    verdict: Verdict = {"precision": stands, "sure": told.get("up_confidence", np.nan)}
    for name, rotation in turns(on.shape.name).items():
        precision, found = judge(dfd.Mesh(mesh.vertices @ rotation.T, mesh.faces, appearance=mesh.appearance))
        aligned = abs(np.dot(found.get("up_direction", rotation[:, 1]), rotation @ told.get("up_direction", [0, 1, 0])))
        off = float(np.degrees(np.arccos(min(aligned, 1.0))))
        verdict |= {name: precision, f"{name}: loss": stands - precision}
        verdict |= {f"{name}: sure": found.get("up_confidence", np.nan), f"{name}: off": off}
    return Judged(on, verdict, (0.0, "", 0, np.zeros(0, bool)))


def _grips(on: LabelledShape, field: dfd.Field) -> Judged:
    """The grip of sessions that are set up in several ways."""
    features, handles = field.features(on.shape.mesh), draw_handles(on.labels, EACH)
    verdict: Verdict = {}
    for name, how in GRIPS.items():
        verdict |= {f"{name}: {key}": value for key, value in _grip(on, field, features, handles, how).items()}
    return Judged(on, verdict, (0.0, "", 0, np.zeros(0, bool)))


GRIPS: Mapping[str, Mapping[str, Any]] = {"default": {}, "0.7": {"reach": 0.7}, "paper": {"preset": "paper"}}


def _grip(on: LabelledShape, field: dfd.Field, features: Float32, handles: Int64, how: Mapping[str, Any]) -> Verdict:
    """What a handle holds of its label, and beyond it."""
    settings = dict(how)
    session = dfd.Deformer(on.shape.mesh, field, preset=settings.pop("preset", "default"), features=features)
    found = []
    for handle in handles.tolist():
        held = session.add(handle, **settings)
        weights, truth = session.following[:, 0].astype(np.float64), on.labels == on.labels[handle]
        inside, whole = on.areas[truth] @ weights[truth], on.areas @ weights
        found.append((soft_iou(on, weights, truth), inside / on.areas[truth].sum(), 1 - inside / whole))
        session.remove(held)
    values = (_mean(on, handles, each) for each in np.transpose(found))
    return dict(zip(("grip", "coverage", "leak"), values, strict=True))


def _counterparts(on: LabelledShape, field: dfd.Field, features: Float32) -> Verdict:
    """Whether counterparts of a handle on a landmark are where those of the landmark are; nothing without any."""
    mesh, hits, wrong = on.shape.mesh, [], []
    session = dfd.Deformer(mesh, field, features=features)
    for group in on.counterparts:
        present = [int(on.landmarks[number]) for number in group if number < len(on.landmarks)]
        for vertex in present if len(present) > 1 else ():
            held = session.add(vertex)
            handle = session.edit.handles[0]
            counterparts = [one for one, _ in session.bound.counterparts(session.edit, handle) if one.weight >= FOLLOWS]
            positions = [one.position for one in counterparts] or [handle.place.position]
            others = mesh.vertices[[other for other in present if other != vertex]]
            hits.append((cKDTree(positions).query(others)[0] <= NEAR * mesh.diagonal).mean())
            wrong.append((cKDTree(mesh.vertices[present]).query(positions)[0] > NEAR * mesh.diagonal).sum())
            session.remove(held)
    return {"counterparts": float(np.mean(hits)), "too many": float(np.mean(wrong))} if hits else {}


def soft_iou(on: LabelledShape, weights: NDArray[Any], truth: Mask) -> float:
    """Σ min(w, t) / Σ max(w, t) over the surface."""
    return float(on.areas @ np.minimum(weights, truth) / (on.areas @ np.maximum(weights, truth)))


def threshold_iou(on: LabelledShape, weights: NDArray[np.floating], truth: Mask) -> float:
    """The best IoU of all vertices above some weight; equal weights are above it together."""
    order = np.argsort(-weights, kind="stable")
    last = np.append(np.diff(weights[order]) != 0, True)
    inside, outside = (np.cumsum((on.areas * side)[order])[last] for side in (truth, ~truth))
    return float((inside / (on.areas[truth].sum() + outside)).max())


def _mean(on: LabelledShape, handles: Int64, values: Sequence[float] | NDArray[np.floating]) -> float:
    """Of one number a handle, over those of each label and over the labels."""
    own, known = on.labels[handles], np.asarray(values, np.float64)
    return float(
        np.mean([known[(own == label) & ~np.isnan(known)].mean() for label in np.unique(own[~np.isnan(known)])])
    )


def by_category(found: Sequence[Judged], judged: bool | None = None) -> dict[str, Verdict]:
    """The mean verdict of each category, and "mean" over them; `judged` takes one half of the shapes."""
    table: dict[str, Verdict] = {}
    for category in dict.fromkeys(each.on.category for each in found):
        rows = [each.verdict for each in found if each.on.category == category and judged in (None, each.on.judged)]
        if rows:
            table[category] = {name: float(np.mean([row[name] for row in rows])) for name in rows[0]}
    names = dict.fromkeys(name for row in table.values() for name in row)
    means = {name: float(np.mean([row[name] for row in table.values() if name in row])) for name in names}
    return {**table, "mean": means}


def _write(path: Path, found: Sequence[Judged]) -> None:
    """Whole files after every shape: a long run that is cut short has told what it knew."""
    names = list(dict.fromkeys(name for each in found for name in each.verdict))
    halves = {True: "judged", False: "chosen on"}
    cells = [
        [each.on.category, each.on.shape.name, halves[each.on.judged], *_row(each.verdict, names)] for each in found
    ]
    lines = ["# Weights, parts and handles against people's labels", ""]
    for heading, judged in (("All shapes", None), ("Constants were chosen on these", False), ("Judged on these", True)):
        half = [each for each in found if judged in (None, each.on.judged)]
        if half:
            table = [[category, *_row(row, names)] for category, row in by_category(half).items()]
            lines += [f"## {heading}", "", f"{len(half)} shapes.", ""]
            lines += [*to_markdown(["category", *names], table, ".3f"), ""]
    lines += ["## What the words mean", "", *(f"- **{word}**: {meaning}." for word, meaning in LEGEND.items())]
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path.with_suffix(".csv"), to_csv(["category", "shape", "half", *names], cells))
    write_text(path.with_suffix(".md"), "\n".join(lines) + "\n")


def _row(verdict: Verdict, names: Sequence[str]) -> list[float | None]:
    return [verdict.get(name) for name in names]


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("python -m bench.quality", description=__doc__)
    parser.add_argument("verb", choices=("labelled", "grip"), help="everything, or handles as sessions make them")
    parser.add_argument("folder", type=Path, nargs="?", help="folder with a folder per category (samples of dfd)")
    parser.add_argument("--quick", action="store_true", help="one mesh a category")
    parser.add_argument("--turned", action="store_true", help="precision alone, as shapes stand and turned")
    parser.add_argument("--paper", action="store_true", help="the paper's distillation beside ours, minutes a shape")
    parser.add_argument("--only", metavar="CATEGORY", action="append", help="only this category; may be repeated")
    parser.add_argument("--cache", type=Path, help="folder that keeps fields, in place of the user's cache")
    parser.add_argument("--output", type=Path, default=OUTPUT, help="folder to write to (%(default)s)")
    return parser
