"""The studies: which settings are compared on which shapes, and the table of methods by family."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import dfd
from bench.quality.baselines import PeerError, biharmonic, euclidean, geodesic
from bench.quality.evaluate import Draw, Method, handles, judge, mean
from bench.quality.fields import Lab
from bench.quality.measures import difference
from bench.quality.parts import family_of
from bench.quality.shapes import Shape
from bench.tables import to_markdown
from dfd.common.linear_algebra import Float64
from dfd.encoders.known import KNOWN_ENCODERS

Settings = Mapping[str, Any]  # by their names in `dfd.distill`, and those of `bench.quality.fields`
BARYCENTRIC, PLAIN, VERTEX = "barycentric", "plain barycentric", "plain vertex"
TEXTURED, GRAY = "textured", "gray"
FAMILIES_STUDY = "families"
EUCLIDEAN, GEODESIC, BIHARMONIC = "Euclidean distance", "geodesic distance", "biharmonic (libigl)"
Z_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
TURNS: Mapping[str, Float64] = {
    "z up": Z_UP,
    **{f"turned {seed}": Rotation.random(rng=np.random.default_rng(seed)).as_matrix() for seed in range(3)},
}


@dataclass(frozen=True)
class Row:
    """What came out for one shape and one setting or method."""

    study: str
    shape: str
    setting: str
    verdict: Mapping[str, float] = field(default_factory=dict)
    note: str = ""


@dataclass(frozen=True)
class Bench:
    """What all studies share."""

    lab: Lab
    draw: Draw
    seeds: Sequence[int]  # of the fits that a verdict is the mean of
    say: Callable[[str], None]

    def method(self, shape: Shape, settings: Settings, *, mirrored: bool = False) -> Method:
        """Weights of `shape` by dfd; `mirrored`: those that the mirror image of each vertex has for handles' images."""
        points = shape.image if mirrored else shape.mesh.vertices
        features = self.lab.field(shape.name, shape.mesh, **settings)(points)
        return lambda chosen: dfd.bind(features, chosen)

    def verdict(self, shape: Shape, settings: Settings) -> dict[str, float]:
        """Mean over the seeds of the fit, with the spread of the precision among them."""
        seeds = [settings["seed"]] if "seed" in settings else self.seeds
        verdicts = []
        for seed in seeds:
            method = self.method(shape, {**settings, "seed": seed})
            mirrored = self.method(shape, {**settings, "seed": seed}, mirrored=True) if shape.is_its_mirror else None
            verdicts.append(judge(shape, method, self.draw, mirrored=mirrored))
        result = mean(verdicts)
        if len(seeds) > 1 and "precision" in result:
            result["precision ±"] = float(np.std([verdict["precision"] for verdict in verdicts]))
        return result


def methods(bench: Bench, shapes: Sequence[Shape], *, peers: bool) -> list[Row]:
    """Weights by features beside weights by distance; `peers`: bounded biharmonic ones too, which can take minutes."""
    rows = []
    for shape in shapes:
        row = partial(Row, "methods", shape.name)
        rows.append(row("dfd", bench.verdict(shape, {})))
        if shape.labels is None:
            continue
        bench.say(f"baselines on {shape.name}")
        rows += _by_distance(bench, "methods", shape, bounded=peers)
    return rows


def _by_distance(bench: Bench, study: str, shape: Shape, *, bounded: bool = False) -> list[Row]:
    """A row for each method that knows no features."""
    row, judged = partial(Row, study, shape.name), partial(judge, shape, draw=bench.draw)
    rows = [
        row(EUCLIDEAN, judged(partial(euclidean, shape.mesh.vertices))),
        row(GEODESIC, judged(partial(geodesic, dfd.Geodesics(shape.mesh)))),
    ]
    for name, is_bounded in ((BIHARMONIC, False), *([("BBW (libigl)", True)] if bounded else [])):
        try:
            rows.append(row(name, judged(partial(biharmonic, shape.mesh, shape.labels, bounded=is_bounded))))
        except PeerError as error:
            rows.append(row(name, note=str(error)))
    return rows


def compare(bench: Bench, study: str, shapes: Sequence[Shape], settings: Mapping[str, Settings]) -> list[Row]:
    """Every setting on every shape, and how far its weights are from those of the first one.

    Encoders without weights on this machine share one row with a note.
    """
    rows = []
    missing: list[str] = []
    for shape in shapes:
        chosen = handles(shape, bench.draw.each, bench.draw.seeds[0])
        reference = None
        for name, changes in settings.items():
            if name in missing:
                continue
            try:
                verdict = bench.verdict(shape, changes)
                weights = bench.method(shape, {"seed": bench.seeds[0], **changes})(chosen)
            except OSError as error:
                bench.say(str(error).partition(". ")[0])
                missing.append(name)
                continue
            reference = weights if reference is None else reference
            rows.append(Row(study, shape.name, name, {**verdict, "off the first": difference(weights, reference)}))
    if missing:
        rows.append(Row(study, "none", ", ".join(missing), note="no weights at hand"))
    return rows


def blocks(lab: Lab) -> dict[str, Settings]:
    """The encoder's own block, and some earlier and later ones."""
    encoder = lab.settings["encoder"]
    own, depth = lab.blocks(encoder)
    others = sorted({depth * quarter // 4 for quarter in range(1, 5)} - {own})
    return {f"{encoder}, block {block}": {"block": block} for block in (own, *others)}


def encoders(lab: Lab) -> dict[str, Settings]:
    """Every known encoder, at the resolution it is best given (the paper's Fig. 12)."""
    own = lab.settings["encoder"]
    names = (own, *(name for name in KNOWN_ENCODERS if name != own))
    resolutions = {name: {} if name == own else {"resolution": KNOWN_ENCODERS[name].resolution} for name in names}
    return {name: {"encoder": name, **resolution} for name, resolution in resolutions.items()}


def lengths(lab: Lab, setting: str) -> dict[str, Settings]:
    """The lab's number of steps or views, half of it, twice as many."""
    count = lab.settings[setting]
    return {f"{number} {setting}": {setting: number} for number in (count, count // 2, count * 2)}


PLAIN_FIT: Settings = {"mirrored": False, "smoothing": 0.0}
COMPARED: Mapping[str, Callable[[Lab], Mapping[str, Settings]]] = {
    # The paper's Fig. 13, as many steps over as many points: by default, and plain, with the paper's loss alone.
    "supervision": lambda lab: {BARYCENTRIC: {}, PLAIN: PLAIN_FIT, VERTEX: {**PLAIN_FIT, "supervision": "vertex"}},
    "textures": lambda lab: {TEXTURED: {}, GRAY: {"texture": False}},
    # What the network sees of a picture.
    "background": lambda lab: {"the shape's patches": {}, "whole pictures": {"background": True}},
    "fit length": lambda lab: lengths(lab, "steps"),
    "views": lambda lab: {**lengths(lab, "views"), "the paper's cameras": {"framing": "paper"}},
    "seeds": lambda lab: {f"seed {seed}": {"seed": seed} for seed in range(3)},
    "blocks": blocks,
    "encoders": encoders,
    # Rays at the mesh itself or at simplified copies; the field is always read on the full mesh.
    "casting": lambda lab: {
        "all faces": {"simplify_to": None},
        **{f"{count:,} faces": {"simplify_to": count} for count in (50_000, 5_000)},
    },
}


# --- by family: as files come, and the same shapes turned, in gray, and by distance alone


def turned(shape: Shape, rotation: Float64) -> Shape:
    """The same shape, its vertices turned by `rotation` (3, 3); its appearance and parts stay."""
    mesh = dfd.Mesh(shape.mesh.vertices @ rotation.T, shape.mesh.faces, appearance=shape.mesh.appearance)
    return replace(shape, mesh=mesh)


def families(bench: Bench, shapes: Sequence[Shape], *, turns: Mapping[str, Float64] = TURNS) -> list[Row]:
    """Every labelled shape as it comes, turned, turned with the file's up taken for granted, gray, and by distances."""
    rows = []
    for shape in shapes:
        row = partial(Row, FAMILIES_STUDY, shape.name)
        rows.append(row("dfd", bench.verdict(shape, {})))
        for name, rotation in turns.items():
            other = turned(shape, rotation)
            rows.append(row(f"dfd, {name}", bench.verdict(other, {})))
            rows.append(row(f"dfd, {name}, up=file", bench.verdict(other, {"up": "file"})))
        if shape.mesh.appearance is not None:
            rows.append(row("dfd, gray", bench.verdict(shape, {"texture": False})))
        rows += _by_distance(bench, FAMILIES_STUDY, shape)
    return rows


def by_family(rows: Sequence[Row]) -> str:
    """A table of mean precision, a line a family and a column a method, and how often distance is as good."""
    own = [row for row in rows if row.study == FAMILIES_STUDY]
    settings = list(dict.fromkeys(row.setting for row in own))
    names = dict.fromkeys(family_of(row.shape) for row in own)
    table: list[list[str]] = []
    for name in [*names, "all"]:
        some = [row for row in own if name in (family_of(row.shape), "all")]
        table.append([name, str(len({row.shape for row in some}))])
        for setting in settings:
            found = [row.verdict["precision"] for row in some if row.setting == setting and "precision" in row.verdict]
            table[-1].append(f"{np.mean(found):.3f} ({len(found)})" if found else "")
    lines = to_markdown(["family", "shapes", *settings], table)
    return "\n".join(["## Precision by family", "", *lines, "", _distance_in_words(own), ""])


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
