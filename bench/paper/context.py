"""What every page is made from: the meshes at hand, fields and sessions of the two presets, and the settings."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np

import dfd
from dfd.batch.inputs import MESH_ENDINGS
from dfd.common.linear_algebra import Float32
from dfd.common.preset import Preset
from dfd.common.progress import Stages
from dfd.distillation.settings import DistillSettings
from dfd.encoders.encode import Encoder, load_encoder
from dfd.encoders.known import DEFAULT_ENCODER
from dfd.geometry.refine import split_long_edges

PRESETS: tuple[Preset, ...] = ("paper", "default")
NAMES: dict[Preset, str] = {"paper": "paper preset", "default": "dfd default"}

BALL = 0.01  # of the longest side: the radius in which the paper gives other methods the neighbors of a point as well
SAMPLES: dict[str, Callable[[], dfd.samples.Sample]] = {
    "chair": dfd.samples.chair,
    "quadruped": dfd.samples.quadruped,
    "robot": dfd.samples.robot,
}
LONGEST_EDGE = 0.03  # of the diagonal: with longer ones weights, which are exact at vertices alone, look coarse

QUICK: dict[str, Any] = {"views": 8, "resolution": 196}
QUICK_PAPER: dict[str, Any] = {"epochs": 5, "batch": 2_000}

Value = TypeVar("Value")
Number = TypeVar("Number", int, float)
Point = tuple[float, float, float]


def named(preset: Preset) -> str:
    """The words by which a preset is called on every page."""
    return NAMES[preset]


@dataclass(frozen=True)
class Shape:
    """A mesh with the name of its file, or of the sample that it is."""

    name: str
    mesh: dfd.Mesh

    def at(self, point: Sequence[float]) -> int:
        """The vertex nearest to `point`, whose coordinates go from 0 to 1 along the sides of the box."""
        low, high = self.mesh.bounds
        return self.nearest(low + np.asarray(point) * (high - low))

    def nearest(self, position: Any) -> int:
        """The vertex of a face that is nearest to `position`, mesh units."""
        corners = np.unique(self.mesh.faces)
        distance = np.linalg.norm(self.mesh.vertices[corners] - np.asarray(position), axis=1)
        return int(corners[distance.argmin()])

    def refined(self) -> Shape:
        """The shape with long edges halved, without its appearance, where faces are large; else as it is."""
        longest = LONGEST_EDGE * self.mesh.diagonal
        vertices, faces = split_long_edges(self.mesh.vertices, self.mesh.faces, longest, most=50_000)
        return self if len(faces) == len(self.mesh.faces) else Shape(self.name, dfd.Mesh(vertices, faces))


@dataclass(frozen=True)
class BoxHandle:
    """A handle and what it does, places from 0 to 1 along the sides of a shape's box: it fits any mesh of the shape."""

    at: Point
    offset: Point = (0.0, 0.0, 0.0)  # of the diagonal
    rotation: Point | None = None  # degrees
    pivot: Point | None = None
    fixed: tuple[Point, ...] = ()
    azimuth: float | None = None  # degrees, from where it is seen

    def on(self, shape: Shape) -> dict[str, Any]:
        """What `Deformer.add` takes by name."""
        handle: dict[str, Any] = {"at": shape.at(self.at), "translation": np.array(self.offset) * shape.mesh.diagonal}
        if self.rotation is not None:
            handle["rotation"] = self.rotation
        if self.pivot is not None:
            low, high = shape.mesh.bounds
            handle["pivot"] = low + np.array(self.pivot) * (high - low)
        return handle


@dataclass(frozen=True)
class Subject(Generic[Value]):
    """A shape, what a page knows of it, and its field by one preset."""

    shape: Shape
    case: Value
    preset: Preset
    field: dfd.Field

    @property
    def label(self) -> list[str]:
        """The first two columns of every table."""
        return [self.shape.name, named(self.preset)]

    @property
    def heading(self) -> str:
        """That of its row of pictures."""
        return ", ".join(self.label)

    def session(self, handles: Sequence[Mapping[str, Any]], **more: Any) -> dfd.Deformer:
        """See `session`."""
        return session(self.shape.mesh, self.field, self.preset, handles, **more)


def session(
    mesh: dfd.Mesh,
    field: dfd.Field,
    preset: Preset,
    handles: Sequence[Mapping[str, Any]],
    *,
    fixed: Sequence[Any] = (),
    symmetric: bool = False,
    features: Float32 | None = None,
) -> dfd.Deformer:
    """A session with `handles`, each what `Deformer.add` takes by name, and `fixed` points.

    `symmetric` lets handles act on both sides of the plane that `"auto"` finds by the preset: across an axis, with a
    score below ε, in the paper's. Where there is none, none is used.
    """
    deformer = dfd.Deformer(mesh, field, preset=preset, features=features)
    if symmetric:
        with suppress(ValueError):  # looks alike across no plane
            deformer.set_symmetry("auto")
    for point in fixed:
        deformer.fix(point)
    for handle in handles:
        deformer.add(**handle)
    return deformer


@dataclass
class Context:
    """Settings of a run, and what its pages share."""

    folder: Path | None = None  # where meshes are looked for first; None for `DFD_MESHES` alone
    quick: bool = False  # fewer and smaller pictures, fewer shapes
    encoder: str | Path = DEFAULT_ENCODER  # a name or a folder
    ball: float = BALL  # of the longest side, in which other methods are given the neighbors of a handle too
    settings: Mapping[str, Any] = field(default_factory=dict)  # further keywords of `dfd.distill`, over the presets'
    say: Callable[[str], None] = lambda line: None
    fields: dict[tuple[Any, ...], dfd.Field] = field(default_factory=dict)
    encoders: dict[tuple[str, int | None, bool], Encoder] = field(default_factory=dict)
    used: dict[str, dict[str, Any]] = field(default_factory=dict)  # settings of the fields, for NAME.json

    # --- meshes

    @cached_property
    def files(self) -> dict[str, Path]:
        """The mesh files at hand by their stems: those of the folder given, then those of DFD_MESHES."""
        found: dict[str, Path] = {}
        known = os.environ.get("DFD_MESHES")
        for folder in (self.folder, Path(known) if known else None):
            for path in _mesh_files(folder) if folder else ():
                found.setdefault(path.stem, path)
        return found

    def shape(self, *names: str) -> Shape:
        """The first of `names` that is a file at hand or else a sample; the last name must be a sample's."""
        for name in names:
            if name in self.files:
                return Shape(name, dfd.load(self.files[name]))
        sample = next(name for name in names if name in SAMPLES)
        return Shape(sample, SAMPLES[sample]().mesh)

    def of(self, most: tuple[Number, Number]) -> Number:
        """The first of two numbers in a quick run, the second in a whole one."""
        return most[0 if self.quick else 1]

    def cases(self, known: Mapping[str, Value], most: tuple[int, int]) -> list[tuple[Shape, Value]]:
        """At most so many shapes, in a quick and in a whole run, and what is known of each by its name.

        Of a folder that was given: its meshes, the known ones first, the others with the case that is called "*". Else
        the known ones among files and samples, in their order.
        """
        if self.folder is not None:
            stems = [path.stem for path in _mesh_files(self.folder)]
            names = sorted(dict.fromkeys(stems), key=lambda name: (name not in known, name))
        else:
            names = [name for name in known if name in self.files or name in SAMPLES]
        return [(self.shape(name), known.get(name, known["*"])) for name in names[: self.of(most)]]

    def subjects(
        self, known: Mapping[str, Value], most: tuple[int, int], *, refined: bool = False
    ) -> Iterator[Subject[Value]]:
        """The shapes of `cases`, with long edges halved where `refined`, each with its fields of both presets."""
        for found, case in self.cases(known, most):
            shape = found.refined() if refined else found
            for preset in PRESETS:
                yield Subject(shape, case, preset, self.field(shape, preset))

    # --- fields

    def distill_settings(self, preset: Preset, **more: Any) -> dict[str, Any]:
        """The keywords of `dfd.distill` for a preset, with `more` over those of this run."""
        given = {**self.settings, **more}
        shorter = {**QUICK, **(QUICK_PAPER if preset == "paper" else {})} if self.quick else {}
        if "steps" in given:  # one length of a fit at a time
            shorter.pop("epochs", None)
        return {"preset": preset, **shorter, **given}

    def loaded(self, preset: Preset, encoder: str | Path | Encoder | None = None, block: int | None = None) -> Encoder:
        """The encoder; the paper's sees the background as well."""
        chosen = self.encoder if encoder is None else encoder
        if isinstance(chosen, Encoder):
            return chosen
        key = (str(chosen), block, preset == "paper")
        if key not in self.encoders:
            self.encoders[key] = load_encoder(chosen, block=block, background=preset == "paper")
        return self.encoders[key]

    def field(
        self, shape: Shape, preset: Preset, *, encoder: Encoder | None = None, stages: Stages | None = None, **more: Any
    ) -> dfd.Field:
        """The field of a shape, distilled through the user's cache; with `stages`, distilled in any case and timed."""
        model = encoder or self.loaded(preset)
        settings = self.distill_settings(preset, **more)
        told = {**settings, **model.settings()}
        key = (shape.mesh.content_hash, *sorted((name, repr(value)) for name, value in told.items()))
        if stages is not None or key not in self.fields:
            self.say(f"distilling {shape.name}, {named(preset)}" + "".join(f", {n} {v}" for n, v in more.items()))
            self.fields[key] = dfd.distill(
                shape.mesh, model, progress=stages or False, cache=stages is None, **settings
            )
        distilled = {name: value for name, value in self.fields[key].settings.items() if name != "losses"}
        self.used.setdefault(named(preset), distilled)
        return self.fields[key]

    # --- about the run

    def notes(self) -> list[str]:
        """What a reader has to know about how a page was made."""
        where = "a folder that was given" if self.folder else "DFD_MESHES" if self.files else "made samples alone"
        notes = [
            f"**{named('paper')}** is the procedure of the paper, **{named('default')}** what dfd does if nothing is "
            f"said; encoder {getattr(self.encoder, 'name', self.encoder)}.",
            f"Meshes: {where}.",
        ]
        if self.quick:
            made, whole = DistillSettings(**self.distill_settings("paper")), DistillSettings(preset="paper")
            notes.append(
                f"Made with --quick: {made.views} pictures of {made.resolution}² instead of {whole.views} of "
                f"{whole.resolution}², a shorter fit in the paper preset, and fewer shapes. Weights are rougher than "
                "they would be."
            )
        return notes


def _mesh_files(folder: Path) -> Iterator[Path]:
    return (path for path in sorted(folder.rglob("*")) if path.suffix.lower() in MESH_ENDINGS)
