"""What all pages use: the meshes at hand, fields and sessions of two presets, pictures and tables."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache, cached_property
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

import dfd
from bench.quality.measures import area_fractions
from bench.quality.shapes import SAMPLES
from bench.tables import to_csv, to_markdown, write_text
from dfd.common.linear_algebra import Float32, Float64, UInt8
from dfd.common.preset import Preset
from dfd.common.progress import Stages
from dfd.distillation.settings import DistillSettings
from dfd.encoders.encode import Encoder, load_encoder
from dfd.encoders.known import DEFAULT_ENCODER
from dfd.geometry.refine import split_long_edges
from dfd.pictures.contact_sheet import contact_sheet
from dfd.pictures.picture import picture, save_png
from dfd.pictures.sheet import session_views
from dfd.pictures.viewpoint import azimuth_towards

PRESETS: tuple[Preset, ...] = ("paper", "default")
NAMES: dict[Preset, str] = {"paper": "paper preset", "default": "dfd default"}
MESH_ENDINGS = (".obj", ".ply", ".stl", ".off", ".glb", ".gltf")
BALL = 0.01  # of the longest side, the radius around a point in which the paper constrains other methods
LONGEST_EDGE = 0.03  # of the diagonal; weights, which are exact at vertices alone, look coarse on longer ones
QUICK: dict[str, Any] = {"views": 8, "resolution": 196}
QUICK_PAPER: dict[str, Any] = {"epochs": 5, "batch": 2_000}
RESOLUTION = 320

Point = tuple[float, float, float]
Pictures = tuple[str, Sequence[tuple[UInt8, str]]]  # a heading, and pictures with their captions
Row = Mapping[str, Any]  # a number or word by the name of its column; None or nothing is an empty cell
Rule = Callable[[Sequence[Row]], float]  # a number from the rows of all tables of a page


# --- shapes, handles and sessions


@dataclass(frozen=True)
class Shape:
    """A mesh with the name of its file or sample."""

    name: str
    mesh: dfd.Mesh

    def at(self, point: Sequence[float]) -> int:
        """Return the vertex with a face nearest to `point`, whose coordinates go from 0 to 1 along the box."""
        corners = np.unique(self.mesh.faces)
        return int(corners[np.linalg.norm(self.mesh.vertices[corners] - self.place(point), axis=1).argmin()])

    def place(self, point: Sequence[float]) -> Float64:
        """Return `point` (3,), whose coordinates go from 0 to 1 along the box, in mesh units."""
        return self.mesh.bounds[0] + np.asarray(point) * self.mesh.extents

    def refined(self) -> Shape:
        """Return the shape with long edges halved, without its appearance; unchanged if no edge is long."""
        longest = LONGEST_EDGE * self.mesh.diagonal
        vertices, faces = split_long_edges(self.mesh.vertices, self.mesh.faces, longest, most=50_000)
        return self if len(faces) == len(self.mesh.faces) else Shape(self.name, dfd.Mesh(vertices, faces))


@dataclass(frozen=True)
class BoxHandle:
    """A handle and its motion, with places from 0 to 1 along the sides of a shape's box, for any mesh of the shape."""

    at: Point
    offset: Point = (0.0, 0.0, 0.0)  # of the diagonal
    rotation: Point | None = None  # degrees
    scale: Point | None = None
    locality: float = 0.0
    pivot: Point | None = None
    fixed: tuple[Point, ...] = ()
    azimuth: float | None = None  # degrees, of the camera

    def on(self, shape: Shape) -> dict[str, Any]:
        """Return the keywords of `Deformer.add`."""
        handle: dict[str, Any] = {"at": shape.at(self.at), "translation": np.array(self.offset) * shape.mesh.diagonal}
        for name in ("rotation", "scale", "locality"):
            if value := getattr(self, name):
                handle[name] = value
        if self.pivot is not None:
            handle["pivot"] = shape.place(self.pivot)
        return handle


# A pull of each shape that pages show, and of any other.
PULLS = {
    "spot": BoxHandle((0.1, 1.0, 0.4), (-0.06, 0.1, 0.0)),
    "kaykit_chair_A": BoxHandle((0.0, 0.0, 1.0), (0.0, -0.15, 0.0)),
    "scorpion": BoxHandle((0.0, 0.2, 1.0), (-0.05, 0.0, 0.1)),
    "koala": BoxHandle((0.0, 0.95, 0.75), (-0.08, 0.08, 0.0)),
    "fox": BoxHandle((0.2, 1.0, 0.7), (0.0, 0.12, 0.0)),
    "table_roundlarge": BoxHandle((0.0, 0.0, 0.5), (0.0, -0.12, 0.0)),
    "shark": BoxHandle((0.0, 0.4, 0.6), (-0.12, 0.0, 0.0)),
    "human_neutral": BoxHandle((1.0, 0.75, 0.5), (0.02, 0.12, 0.05)),
    "boat": BoxHandle((0.5, 1.0, 0.5), (0.0, 0.15, 0.0)),
    "plane_holes": BoxHandle((0.0, 0.2, 0.4), (-0.1, 0.1, 0.0)),
    "chair": BoxHandle((0.0, 0.0, 1.0), (0.0, -0.15, 0.0)),
    "quadruped": BoxHandle((0.2, 1.0, 0.9), (-0.04, 0.12, 0.0)),
    "*": BoxHandle((0.5, 1.0, 0.5), (0.0, 0.15, 0.0)),
}


def pulls_of(*names: str) -> dict[str, BoxHandle]:
    """Return the pulls of the shapes called `names`, and of any other shape."""
    return {name: PULLS.get(name, PULLS["*"]) for name in (*names, "*")}


@dataclass(frozen=True)
class Subject:
    """A shape, what a page knows of it, and its field by one preset."""

    shape: Shape
    case: Any
    preset: Preset
    field: dfd.Field

    def session(
        self,
        handles: Iterable[Mapping[str, Any]],
        *,
        fixed: Sequence[int] = (),
        symmetric: bool = False,
        features: Float32 | None = None,
    ) -> dfd.Deformer:
        """Return a session with `handles`, each the keywords of `Deformer.add`, and `fixed` points.

        `symmetric` lets handles act on both sides of the plane that `"auto"` finds by the preset, if there is one.
        """
        deformer = dfd.Deformer(self.shape.mesh, self.field, preset=self.preset, features=features)
        if symmetric:
            with suppress(ValueError):  # no plane has equal features on both sides
                deformer.set_symmetry("auto")
        for point in fixed:
            deformer.fix(point)
        for handle in handles:
            deformer.add(**handle)
        return deformer

    def pull(self, changes: Mapping[str, Any] | None = None, **more: Any) -> dfd.Deformer:
        """Return a session with the handle of the case, with `changes`; `more` are keywords of `session`."""
        return self.session([{**self.case.on(self.shape), **(changes or {})}], **more)


load_once = cache(load_encoder)


@dataclass
class Context:
    """Settings of a run, and the meshes and fields of its pages."""

    folder: Path | None = None  # of meshes; None for `DFD_MESHES`
    quick: bool = False  # fewer and smaller pictures, fewer shapes
    encoder: str | Path = DEFAULT_ENCODER  # a name or a folder
    settings: Mapping[str, Any] = field(
        default_factory=dict
    )  # further keywords of `dfd.distill`, which override the presets'
    say: Callable[[str], None] = lambda line: None

    @cached_property
    def files(self) -> dict[str, Path]:
        """The mesh files by their stems: those of `folder`, then those of DFD_MESHES."""
        known = os.environ.get("DFD_MESHES")
        folders = [folder for folder in (Path(known) if known else None, self.folder) if folder]
        return {path.stem: path for folder in folders for path in reversed(_mesh_files(folder))}

    def shape(self, name: str) -> Shape:
        """Return the shape of a file, or else of a sample."""
        return Shape(name, dfd.load(self.files[name]) if name in self.files else SAMPLES[name]().mesh)

    def of(self, most: tuple[Any, Any]) -> Any:
        """Return the first of two numbers in a quick run, the second in a whole one."""
        return most[0 if self.quick else 1]

    def cases(self, known: Mapping[str, Any], most: tuple[int, int]) -> list[tuple[Shape, Any]]:
        """Return at most so many shapes, in a quick and in a whole run, with the case that is `known` by each name.

        With a `folder`, its meshes: the known ones first, the others with the case "*". Without, the known ones among
        files and samples, in their order.
        """
        if self.folder is not None:
            stems = [path.stem for path in _mesh_files(self.folder)]
            names = sorted(dict.fromkeys(stems), key=lambda name: (name not in known, name))
        else:
            names = [name for name in known if name in self.files or name in SAMPLES]
        return [(self.shape(name), known.get(name, known["*"])) for name in names[: self.of(most)]]

    def subjects(
        self,
        known: Mapping[str, Any],
        most: tuple[int, int],
        *,
        refined: bool = False,
        presets: Sequence[Preset] = PRESETS,
    ) -> Iterator[Subject]:
        """Yield the shapes of `cases`, with long edges halved where `refined`, each with its field of every preset."""
        for found, case in self.cases(known, most):
            shape = found.refined() if refined else found
            for preset in presets:
                yield Subject(shape, case, preset, self.field(shape, preset))

    def distill_settings(self, preset: Preset, **more: Any) -> dict[str, Any]:
        """Return the keywords of `dfd.distill` for a preset; `more` overrides those of this run."""
        given = {**self.settings, **more}
        shorter = {**QUICK, **(QUICK_PAPER if preset == "paper" else {})} if self.quick else {}
        if "steps" in given:  # a fit has steps or epochs, not both
            shorter.pop("epochs", None)
        return {"preset": preset, **shorter, **given}

    def loaded(self, preset: Preset, encoder: str | Path | None = None, block: int | None = None) -> Encoder:
        """Return the encoder; the paper's takes the background, too."""
        return load_once(self.encoder if encoder is None else encoder, block=block, background=preset == "paper")

    def field(
        self, shape: Shape, preset: Preset, *, encoder: Encoder | None = None, stages: Stages | None = None, **more: Any
    ) -> dfd.Field:
        """Return the field of a shape; with `stages`, ignore the user's cache and time each stage."""
        self.say(f"field of {shape.name}, {NAMES[preset]}" + "".join(f", {n} {v}" for n, v in more.items()))
        model, settings = encoder or self.loaded(preset), self.distill_settings(preset, **more)
        return dfd.distill(shape.mesh, model, progress=stages or False, cache=stages is None, **settings)

    def notes(self) -> list[str]:
        """Return how the page was made."""
        where = "a folder that was given" if self.folder else "DFD_MESHES" if self.files else "made samples alone"
        notes = [
            f"**{NAMES['paper']}** is the procedure of the paper, **{NAMES['default']}** dfd's own settings.",
            f"Encoder: {getattr(self.encoder, 'name', self.encoder)}.",
            f"Meshes: {where}.",
        ]
        if self.quick:
            made, whole = DistillSettings(**self.distill_settings("paper")), DistillSettings(preset="paper")
            notes.append(
                f"Made with --quick: {made.views} pictures of {made.resolution}² instead of {whole.views} of "
                f"{whole.resolution}², a shorter fit in the paper preset, and fewer shapes. Weights are rougher."
            )
        return notes


def _mesh_files(folder: Path) -> list[Path]:
    return [path for path in sorted(folder.rglob("*")) if path.suffix.lower() in MESH_ENDINGS]


# --- pictures


def aim(mesh: dfd.Mesh, points: Any, *moved: Float64, **more: Any) -> dict[str, Any]:
    """Return options of `picture` that show `points` (N, 3) from outside, and all of `moved` (V, 3)."""
    frame = [mesh.vertices, *moved]
    return {"azimuth": azimuth_towards(mesh, points), "frame": frame, "resolution": RESOLUTION, **more}


# --- the page


@dataclass(frozen=True)
class Section:
    """A part of a page: its pictures, and its table."""

    heading: str
    text: str = ""
    pictures: Sequence[Pictures] = ()
    rows: Sequence[Row] = ()
    image: Image.Image | None = None  # such as a plot


def gallery(
    subjects: Iterable[Subject],
    variants: Callable[[Subject], Mapping[str, dfd.Deformer]],
    measure: Callable[[Subject, dfd.Deformer, dfd.Deformer], Row],
    text: str = "",
    *,
    heading: str = "Results",
    shown: Sequence[str] = ("weights", "after"),
    azimuth: float | None = None,
    source: Callable[[Subject], Mapping[str, Any]] = lambda subject: {},
) -> list[Section]:
    """Draw every subject by the sessions of its `variants`, and tabulate what `measure` returns for each.

    `measure` takes the subject, a session and the first session, whose camera draws all. `shown` are views of
    `session_views`, a row of pictures each. `source` returns options of `picture` for the shape at rest.
    """
    drawn: list[Pictures] = []
    rows: list[Row] = []
    for subject in subjects:
        sessions, mesh = variants(subject), subject.shape.mesh
        first = next(iter(sessions.values()))
        camera = session_views(first, getattr(subject.case, "azimuth", azimuth))["before"]
        views = {name: session_views(each, camera["azimuth"]) for name, each in sessions.items()}
        room = [mesh.vertices, *(each.vertices for each in sessions.values() if each.mesh is mesh)]
        look: dict[str, Any] = {"resolution": RESOLUTION, "frame": room}
        start = (picture(mesh, **{**camera, **look, **source(subject)}), "before")
        cells: dict[str, list[tuple[UInt8, str]]] = {what: [] for what in shown}
        for (name, each), what in product(sessions.items(), shown):
            options = {**views[name][what], **(look if each.mesh is mesh else {"resolution": RESOLUTION})}
            cells[what].append((picture(each.mesh, **options), name))
        title = f"{subject.shape.name}, {NAMES[subject.preset]}"
        if len(sessions) == 1:
            drawn.append((title, [start, *((row[0][0], what) for what, row in cells.items())]))
        else:
            drawn += [(f"{title}: {what}", [start, *row]) for what, row in cells.items()]
        for name, each in sessions.items():
            label = {"shape": subject.shape.name, "preset": NAMES[subject.preset], "variant": name}
            rows.append({**label, **measure(subject, each, first)})
    return [Section(heading, text, drawn, rows)]


def following(subject: Subject, session: dfd.Deformer, least: float) -> float:
    """Return how much of the surface follows the first handle by a weight above `least`, per cent."""
    return 100 * float(area_fractions(subject.shape.mesh)[session.following[:, 0] > least].sum())


@dataclass(frozen=True)
class Figure:
    """The claim of a figure or table, and the number that decides whether it holds here."""

    paper: str  # the paper's number, or what its pictures show
    measured: str  # the name of the number
    number: Rule
    least: float = -np.inf  # bounds of a number that agrees with the paper
    most: float = np.inf

    def verdict(self, number: float, quick: bool) -> str:
        """Return one sentence that follows from the number."""
        if not np.isfinite(number):
            return f"Not decided: this run did not measure {self.measured}."
        agrees = "agrees" if self.least <= number <= self.most else "does not agree"
        bound = f"at least {self.least:g}" if np.isfinite(self.least) else f"at most {self.most:g}"
        inputs = ", on the few and small inputs of --quick" if quick else ""
        return f"{self.measured}: {number:.3g}, which {agrees} with the paper (our bound: {bound}){inputs}."


def write(make: Callable[[Context], list[Section]], figure: Figure, name: str, folder: Path, context: Context) -> Path:
    """Write NAME.md, a PNG for each section with pictures and a CSV for each section; return the path of NAME.md."""
    folder.mkdir(parents=True, exist_ok=True)
    sections, body = make(context), list[str]()
    for number, section in enumerate(sections, 1):
        body += ["", f"## {section.heading}", "", section.text]
        sheet = contact_sheet(section.pictures, cell=RESOLUTION) if section.pictures else None
        for image, stem in ((sheet, f"{name}_{number}"), (section.image, f"{name}_{number}_plot")):
            if image is not None:
                save_png(folder / f"{stem}.png", image)
                body += ["", f"![{section.heading}]({stem}.png)"]
        columns = dict.fromkeys(key for row in sorted(section.rows, key=len, reverse=True) for key in row)
        cells = [[row.get(key) for key in columns] for row in section.rows]
        write_text(folder / f"{name}_{number}.csv", to_csv(columns, cells))
        body += ["", *to_markdown(columns, cells)]
    rows = [row for section in sections for row in section.rows]
    decides = figure.number(rows)
    here = f"{decides:.3g}" if np.isfinite(decides) else "not measured"
    said = to_markdown(["", "the paper", "here"], [[figure.measured, figure.paper, here]])
    title, verdict = (make.__doc__ or "").splitlines()[0], figure.verdict(decides, context.quick)
    head = [f"# {name}: {title}", "", *said, "", verdict, ""]
    write_text(folder / f"{name}.md", "\n".join([*head, *(f"- {note}" for note in context.notes()), *body]) + "\n")
    return folder / f"{name}.md"
