"""Provide shapes, handles, fields and sessions for the pages that reproduce the paper, with two presets."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from dataclasses import field as dataclasses_field
from functools import cache, cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import dfd
from bench.quality.shapes import SAMPLES
from dfd.common.linear_algebra import Float32, Float64
from dfd.common.preset import Preset
from dfd.common.progress import Stages
from dfd.distillation.settings import DistillSettings
from dfd.encoders.encode import Encoder, load_encoder
from dfd.encoders.known import DEFAULT_ENCODER
from dfd.geometry.refine import split_long_edges

PRESETS: tuple[Preset, ...] = ("paper", "default")
NAMES: dict[Preset, str] = {"paper": "paper preset", "default": "dfd default"}
MIRRORED = "paper preset, mirrored=True"  # in Fig. 5, a variant of the paper preset
MESH_ENDINGS = (".obj", ".ply", ".stl", ".off", ".glb", ".gltf")
LEAD = 0.1  # smallest lead in weight of a related place over an unrelated place, see `agreement`
LONGEST_EDGE = 0.03  # longest edge in refined shapes, as a fraction of the diagonal, so that weights look smooth
# Settings of `dfd.distill` with --quick. QUICK is for both presets, QUICK_PAPER only for the preset "paper".
QUICK: dict[str, Any] = {"views": 8, "resolution": 196}
QUICK_PAPER: dict[str, Any] = {"epochs": 45}  # with 8 pictures, this takes 180 steps, as many as a full run

Point = tuple[float, float, float]


@dataclass(frozen=True)
class Shape:
    """A mesh with the name of its file or sample."""

    name: str
    mesh: dfd.Mesh

    def at(self, point: Sequence[float]) -> int:
        """Return the vertex nearest to `point` (fractions of the bounding box), among all vertices that have a face."""
        corners = np.unique(self.mesh.faces)
        return int(corners[np.linalg.norm(self.mesh.vertices[corners] - self.place(point), axis=1).argmin()])

    def place(self, point: Sequence[float]) -> Float64:
        """Return the position (3,), in mesh units, of `point`, whose coordinates are fractions of the bounding box."""
        return self.mesh.bounds[0] + np.asarray(point) * self.mesh.extents

    def refined(self) -> Shape:
        """Halve edges longer than `LONGEST_EDGE`; return a shape without colors, or this shape if no edge is longer."""
        longest = LONGEST_EDGE * self.mesh.diagonal
        vertices, faces = split_long_edges(self.mesh.vertices, self.mesh.faces, longest, most=50_000)
        return self if len(faces) == len(self.mesh.faces) else Shape(self.name, dfd.Mesh(vertices, faces))


@dataclass(frozen=True)
class BoxHandle:
    """A handle and its motion, with marked places. `shapes.toml` explains the attributes."""

    at: Point
    offset: Point = (0.0, 0.0, 0.0)  # translation, as fractions of the diagonal
    rotation: Point | None = None  # angles about x, y and z, in degrees
    scale: Point | None = None  # factor along each axis
    locality: float = 0.0
    pivot: Point | None = None
    fixed: tuple[Point, ...] = ()
    stays: tuple[Point, ...] = ()  # marked places that look like the fixed point
    azimuth: float | None = None  # azimuth of the camera, in degrees, see `dfd.pictures.picture`
    # Marked places, chosen by eye: on parts that look like the handle's part, and on parts that do not.
    like: tuple[Point, ...] = ()
    unlike: tuple[Point, ...] = ()
    others: Mapping[str, float] = dataclasses_field(default_factory=dict)  # other shapes of the class, see `fig19`

    def on(self, shape: Shape) -> dict[str, Any]:
        """Return the keywords of `Deformer.add` for this handle on a mesh."""
        handle: dict[str, Any] = {"at": shape.at(self.at), "translation": np.array(self.offset) * shape.mesh.diagonal}
        for name in ("rotation", "scale", "locality"):
            if value := getattr(self, name):
                handle[name] = value
        if self.pivot is not None:
            handle["pivot"] = shape.place(self.pivot)
        return handle


def agreement(mesh: dfd.Mesh, case: Any, follows: NDArray[np.floating]) -> float | None:
    """Return the percentage of pairs of marked places in which the related place follows more, by at least `LEAD`.

    A pair is a place of `case.like` and one of `case.unlike`. `follows` (V,) are weights, or motions divided by the
    handle's motion. Weights that are equal everywhere, or 0 far from the handle, give 0. None: there are no such pairs.
    """
    like, unlike = (
        follows[[Shape("", mesh).at(place) for place in getattr(case, name, ())]] for name in ("like", "unlike")
    )
    return 100 * float((like[:, None] >= unlike + LEAD).mean()) if len(like) and len(unlike) else None


def _read(about: Mapping[str, Any]) -> BoxHandle:
    """Return the handle with the keys of `shapes.toml`."""
    given = {key: _tuples(value) for key, value in about.items() if key != "feet"}
    if "feet" in about:
        feet = [(x, 0.0, z) for x in (0.0, 1.0) for z in about["feet"]]
        own = min(feet, key=lambda place: float(np.linalg.norm(np.subtract(place, about["at"]))))
        given["like"] = tuple(each for each in feet if each != own)
    return BoxHandle(**given)


def _tuples(value: Any) -> Any:
    return tuple(map(_tuples, value)) if isinstance(value, list) else value


CASES: dict[str, dict[str, BoxHandle]] = {  # for each page or set of pages: the handle on each shape
    page: {shape: _read(about) for shape, about in shapes.items()}
    for page, shapes in tomllib.loads(Path(__file__).with_name("shapes.toml").read_text("utf-8")).items()
}
UPWARDS = BoxHandle((0.5, 1.0, 0.5), (0.0, 0.15, 0.0))  # the pull of shapes without another one


def pulls_of(*names: str) -> dict[str, BoxHandle]:
    """Return the pull of each shape of `names`, by name."""
    return {name: CASES["pulls"].get(name, UPWARDS) for name in names}


@dataclass(frozen=True)
class Subject:
    """A shape, its field by one preset, and its case: data that a page defines for this shape."""

    shape: Shape
    case: Any  # most often a `BoxHandle`
    preset: Preset
    field: dfd.Field
    name: str = ""  # name of the method in tables, if it is not that of the preset

    @property
    def method(self) -> str:
        """Return the name of the method in tables."""
        return self.name or NAMES[self.preset]

    def session(
        self,
        handles: Iterable[Mapping[str, Any]],
        *,
        fixed: Sequence[int] = (),
        symmetric: bool = False,
        features: Float32 | None = None,
    ) -> dfd.Deformer:
        """Return a session with `handles`, given as keywords of `Deformer.add`, and fixed points at vertices `fixed`.

        `symmetric` sets the plane of symmetry to "auto". If no plane is found, handles are not mirrored.
        """
        deformer = dfd.Deformer(self.shape.mesh, self.field, preset=self.preset, features=features)
        if symmetric:
            with suppress(ValueError):  # raised if no plane is found
                deformer.set_symmetry("auto")
        for point in fixed:
            deformer.fix(point)
        for handle in handles:
            deformer.add(**handle)
        return deformer

    def pull(self, changes: Mapping[str, Any] | None = None, **more: Any) -> dfd.Deformer:
        """Return a session with the case's handle; `changes` replace its keywords, `more` are keywords of `session`."""
        return self.session([{**self.case.on(self.shape), **(changes or {})}], **more)


def posed_robot() -> dfd.Mesh:
    """Return the sample robot with its right arm raised by 70 degrees."""
    sample = SAMPLES["robot"]()
    arm, hand = (sample.vertices_of(part, 0) for part in ("arm", "hand"))
    vertices = sample.mesh.vertices.copy()
    shoulder = vertices[arm[vertices[arm, 1].argmax()]]
    turn = Rotation.from_euler("z", np.copysign(70, shoulder[0]), degrees=True)
    raised = np.concatenate([arm, hand])
    vertices[raised] = turn.apply(vertices[raised] - shoulder) + shoulder
    return dfd.Mesh(vertices, sample.mesh.faces)


load_once = cache(load_encoder)


@dataclass
class Context:
    """The options of a run, with methods that load the meshes and make the fields of its pages."""

    quick: bool = False  # whether to use fewer shapes, and fewer and smaller pictures
    encoder: str | Path = DEFAULT_ENCODER  # a name or a folder
    say: Callable[[str], None] = lambda line: None  # reports progress
    methods: Mapping[str, Any] = dataclasses_field(default_factory=dict)  # further methods by name: `peers.peer.Peer`

    @cached_property
    def files(self) -> dict[str, Path]:
        """Return the mesh files in the folder that DFD_MESHES names, by file name without ending."""
        folder = os.environ.get("DFD_MESHES")
        paths = sorted(Path(folder).rglob("*"), reverse=True) if folder else []
        return {path.stem: path for path in paths if path.suffix.lower() in MESH_ENDINGS}

    def shape(self, name: str) -> Shape:
        """Return the shape in the file called `name`, or the sample `name` if there is no such file."""
        return Shape(name, dfd.load(self.files[name]) if name in self.files else self.made[name]())

    @cached_property
    def made(self) -> dict[str, Callable[[], dfd.Mesh]]:
        """Return the functions that generate shapes, by name: the samples, and a robot that is no mirror image."""
        samples = {name: partial(lambda make: make().mesh, make) for name, make in SAMPLES.items()}
        return {**samples, "posed robot": posed_robot}

    def quick_or_full(self, values: tuple[Any, Any]) -> Any:
        """Return the first of two values in a quick run, and the second in a full run."""
        return values[0 if self.quick else 1]

    def cases(self, known: Mapping[str, Any], most: tuple[int, int]) -> list[tuple[Shape, Any]]:
        """Return each shape of `known` for which there is a file or sample, with its case. `known` maps names to cases.

        `most` is the largest number of shapes in a quick and in a full run.
        """
        names = [name for name in known if name in self.files or name in self.made]
        return [(self.shape(name), known[name]) for name in names[: self.quick_or_full(most)]]

    def subjects(
        self,
        known: Mapping[str, Any],
        most: tuple[int, int],
        *,
        refined: bool = False,
        presets: Sequence[Preset] = PRESETS,
    ) -> Iterator[Subject]:
        """Yield a subject for each shape of `cases` and each preset; if `refined`, long edges are halved."""
        for found, case in self.cases(known, most):
            shape = found.refined() if refined else found
            for preset in presets:
                yield Subject(shape, case, preset, self.field(shape, preset))

    def distill_settings(self, preset: Preset, **more: Any) -> dict[str, Any]:
        """Return the keywords of `dfd.distill` for a preset; settings in `more` override those of a quick run."""
        shorter = {**QUICK, **(QUICK_PAPER if preset == "paper" else {})} if self.quick else {}
        if "steps" in more:  # a fit has steps or epochs, not both
            shorter.pop("epochs", None)
        return {"preset": preset, **shorter, **more}

    def loaded(self, preset: Preset, encoder: str | Path | None = None, block: int | None = None) -> Encoder:
        """Return the encoder, loaded once. For the preset "paper", it also encodes the background of pictures."""
        return load_once(self.encoder if encoder is None else encoder, block=block, background=preset == "paper")

    def field(
        self, shape: Shape, preset: Preset, *, encoder: Encoder | None = None, stages: Stages | None = None, **more: Any
    ) -> dfd.Field:
        """Return the field of a shape. If `stages` is given, distill without the cache, and time each stage."""
        self.say(f"field of {shape.name}, {NAMES[preset]}" + "".join(f", {n} {v}" for n, v in more.items()))
        model, settings = encoder or self.loaded(preset), self.distill_settings(preset, **more)
        return dfd.distill(shape.mesh, model, progress=stages or False, cache=stages is None, **settings)

    def notes(self) -> list[str]:
        """Return sentences that say how the page was made."""
        notes = [
            f"**{NAMES['paper']}**: the procedure of the paper, with another encoder.",
            f"**{NAMES['default']}**: the default settings of dfd.",
            f"Encoder: {getattr(self.encoder, 'name', self.encoder)}.",
            f"Meshes: {'files in DFD_MESHES, and samples' if self.files else 'only samples'}.",
        ]
        if self.quick:
            made, whole = DistillSettings(**self.distill_settings("paper")), DistillSettings(preset="paper")
            notes.append(
                f"Made with --quick: {made.views} pictures of {made.resolution}² instead of {whole.views} of "
                f"{whole.resolution}² pixels, and fewer shapes. Weights are rougher."
            )
        return notes
