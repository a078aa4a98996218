"""The studies: which settings are compared on which shapes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

import dfd
from bench.quality.baselines import PeerError, biharmonic, euclidean, geodesic
from bench.quality.evaluate import Draw, Method, handles, judge, mean
from bench.quality.fields import Lab
from bench.quality.measures import difference
from bench.quality.shapes import Shape
from dfd.encoders.known import KNOWN_ENCODERS

Settings = Mapping[str, Any]  # by their names in `dfd.distill`, and those of `bench.quality.fields`
BARYCENTRIC, PLAIN, VERTEX = "barycentric", "plain barycentric", "plain vertex"
TEXTURED, GREY = "textured", "grey"


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
    """Weights by looks beside weights by distance; `peers`: bounded biharmonic ones too, which can take minutes."""
    rows = []
    for shape in shapes:
        row = partial(Row, "methods", shape.name)
        rows.append(row("dfd", bench.verdict(shape, {})))
        if shape.labels is None:
            continue
        bench.say(f"baselines on {shape.name}")
        geodesics = dfd.Geodesics(shape.mesh)
        judged = partial(judge, shape, draw=bench.draw)
        rows.append(row("Euclidean distance", judged(partial(euclidean, shape.mesh.vertices))))
        rows.append(row("geodesic distance", judged(partial(geodesic, geodesics))))
        for name, bounded in (("biharmonic (libigl)", False), *([("BBW (libigl)", True)] if peers else [])):
            try:
                rows.append(row(name, judged(partial(biharmonic, shape.mesh, shape.labels, bounded=bounded))))
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


def supervision() -> dict[str, Settings]:
    """The paper's Fig. 13, as many steps over as many points: by default, and plain, with the paper's loss alone."""
    plain = {"mirrored": False, "smoothing": 0.0}
    return {BARYCENTRIC: {}, PLAIN: plain, VERTEX: {**plain, "supervision": "vertex"}}


def textures() -> dict[str, Settings]:
    """What colours say beside shape."""
    return {TEXTURED: {}, GREY: {"texture": False}}


def background() -> dict[str, Settings]:
    """What the network sees of a picture: the patches of the shape, or all of them."""
    return {"the shape's patches": {}, "whole pictures": {"background": True}}


def casting() -> dict[str, Settings]:
    """Rays at the mesh itself or at simplified copies; the field is always read on the full mesh."""
    return {
        "all faces": {"simplify_to": None},
        "50,000 faces": {"simplify_to": 50_000},
        "5,000 faces": {"simplify_to": 5_000},
    }


def fit_length(lab: Lab) -> dict[str, Settings]:
    """Steps of the fit: the default, half of it, twice as many."""
    steps = lab.settings["steps"]
    return {f"{count} steps": {"steps": count} for count in (steps, steps // 2, steps * 2)}


def seeds() -> dict[str, Settings]:
    """The random numbers of the fit."""
    return {f"seed {seed}": {"seed": seed} for seed in range(3)}


def views(lab: Lab) -> dict[str, Settings]:
    """How many pictures are taken, and from where."""
    count = lab.settings["views"]
    return {
        **{f"{number} views": {"views": number} for number in (count, count // 2, count * 2)},
        "the paper's cameras": {"framing": "paper"},
    }


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
