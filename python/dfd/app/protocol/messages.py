"""The messages that the server sends, and the types of fields in these messages and in the requests of the page."""

from collections.abc import Callable
from dataclasses import fields as dataclass_fields
from typing import Annotated, Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, create_model
from safetensors.numpy import save

from dfd.common.described import about, words_of
from dfd.common.preset import Preset
from dfd.editing import controls
from dfd.editing.edit import Edit
from dfd.mesh.appearance import Wrap
from dfd.posing import transforms
from dfd.posing.transforms import Frame, PivotAt, Vector
from dfd.symmetry.plane import SymmetryPlane

Index = Annotated[int, Field(ge=0)]
Text = Annotated[str, Field(min_length=1, max_length=1000)]
# Changes of a handle's region. The last three select the scene part, material or connected component at the handle.
PartChange = Literal["smaller", "larger", "add", "remove", "scene_part", "material", "component"]


class Model(BaseModel):
    """The base class of all messages. Unknown keys, wrong types, and numbers that are not finite raise an error."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


class Region(Model):
    """A set of vertices. `mask` is base64: bit b of byte i is 1 if vertex 8 i + b is in it. Bit 0 is the lowest bit."""

    mask: Annotated[str, Field(min_length=4, pattern=r"^[A-Za-z0-9+/]+={0,2}$")]


Place = Index | Region  # the index of a vertex, or a region

# Controls whose types differ from the types in an edit: in requests (GIVEN) and in the state (SHOWN).
GIVEN: dict[str, Any] = {
    "radius": float | str,
    "mask": Region | Literal["everywhere", "part"],
    "excluded_counterparts": Annotated[tuple[Index, ...], Field(max_length=1000)],  # a vertex on each of them
}
SHOWN: dict[str, Any] = {
    "reach": float,  # the feature distance; if the reach is "part", the one that may replace it
    "mask": int,  # number of vertices in the mask; 0 without a mask
    "excluded_counterparts": tuple[int, ...],  # a vertex on each of them
}


# Values of a handle's transform whose types differ in requests.
MOVED: dict[str, Any] = {
    "pivot": Vector | PivotAt | Literal["auto"],
    "axes": Frame | Literal["normal", "auto"],
    "bend": Vector | float,
    "joint": Annotated[float, Field(ge=0, le=1)] | Literal["spread", "auto", "here"],
}
REST = {each.name: each.default for each in dataclass_fields(transforms.Transform) if each.init}


def with_fields(
    source: type, defaults: dict[str, Any], kinds: dict[str, Any] | None = None
) -> Callable[[type[Model]], type[Model]]:
    """Return a decorator that adds those fields of the dataclass `source` that have a default in `defaults`.

    `kinds` replaces types of fields. A field with the default None accepts None.
    """
    types = {name: kind for name, (kind, _) in about(source).items()} | (kinds or {})
    fields: Any = {
        name: (types[name] if value is not None else types[name] | None, value) for name, value in defaults.items()
    }
    return lambda owner: create_model(owner.__name__, __base__=owner, __doc__=owner.__doc__, **fields)


@with_fields(transforms.Transform, {name: None for name in REST if name != "pivot_at"}, MOVED)
class Transform(Model):
    """New values of a handle's transform: it scales along `axes` and rotates, both about the pivot, then translates.

    A null keeps the present value. All angles are in degrees. `rotation` is a rotation vector. `axes` has one axis per
    row: "auto" selects the axes of the mesh, and "normal" selects axes whose third is the surface normal at the handle.
    The pivot "auto" is computed when the handle rotates or scales. Bend and twist act before the scale, at the position
    `joint` of the part (0 is the base, 1 the tip). `bend` is a rotation vector, or the angle by which the tip turns up.
    """


@with_fields(controls.Controls, dict.fromkeys(controls.CONTROLS), GIVEN)
class Controls(Model):
    """New values of a handle's name and controls. A null keeps the present value."""

    name: Text | None = None


@with_fields(transforms.Transform, REST)
class PoseTransform(Model):
    """The complete transform of a handle, with fields as in `Transform`. Fields that are left out are at rest."""

    handle: Index

    @classmethod
    def of(cls, handle: int, transform: transforms.Transform) -> Any:
        """Return the message for the transform of a handle."""
        return cls(handle=handle, **{name: getattr(transform, name) for name in REST})

    @property
    def motion(self) -> transforms.Transform:
        """Return the transform; raise ValueError if it is not valid."""
        return transforms.Transform(**{name: getattr(self, name) for name in REST})


PoseTransforms = Annotated[tuple[PoseTransform, ...], Field(max_length=1000)]


class KeyPose(Model):
    """A stored pose on the timeline."""

    name: Text
    seconds: Annotated[float, Field(ge=0)]
    ease: bool = False  # whether motions slow down towards the pose and start slowly from it
    transforms: PoseTransforms


KeyPoses = Annotated[tuple[KeyPose, ...], Field(max_length=1000)]


class Mark(Model):
    """A vertex, and the position at which it must arrive. In requests, null stands for its present position."""

    vertex: Index
    target: Vector | None


Marks = Annotated[tuple[Mark, ...], Field(max_length=1000)]


class Answer(Model):
    """The base class of all messages of the server. An answer has the `id` of its request; other messages have 0."""

    id: int = 0


class ControlEntry(Model):
    """How a panel shows a control: as a slider, a choice or a switch."""

    name: str
    label: str
    hint: str
    kind: Literal["number", "length", "choice", "switch"]
    choices: tuple[str, ...]  # words that the control accepts as values
    slider: Vector | None  # lowest value, highest value, step; lengths are fractions of the bounding box's diagonal


def control_entries() -> tuple[ControlEntry, ...]:
    """Return the entries of the controls that the page shows as fields, then the entry of the preset."""
    entries = []
    for name, (kind, said) in {**about(controls.Controls), "preset": about(Edit)["preset"]}.items():
        if said is None or said.repeated or name in ("mask", "level"):
            continue
        kinds, label, choices = (kind, *get_args(kind)), said.called(name), words_of(kind)
        shown: Any = "number" if float in kinds else "switch" if bool in kinds else "choice"
        shown = "length" if said.unit == "length" else shown
        entries.append(
            ControlEntry(name=name, label=label, hint=said.text, kind=shown, choices=choices, slider=said.slider)
        )
    return tuple(entries)


class SessionMessage(Answer):
    """The first message: the name of the session, and the options of the server."""

    type: Literal["session"] = "session"
    session: str  # the name with which a page reconnects to the session
    samples: tuple[str, ...]
    upload_bytes: int  # largest total size of an upload
    formats: tuple[str, ...]  # file endings that `POST /upload` accepts
    beside: tuple[str, ...]  # file endings of textures, materials and buffers, which a mesh may name
    controls: tuple[ControlEntry, ...] = control_entries()


class RecentShape(Model):
    """A shape whose edit is kept, for `open_recent`."""

    key: str
    name: str
    handles: int
    seconds: float  # time of the last change, since 1970
    present: bool  # whether the mesh is still there; if not, the user must open the file again
    picture: str | None = None  # a small picture, as a data: URL


class StartMessage(Answer):
    """No mesh is open, so the page shows its start page."""

    type: Literal["start"] = "start"
    recent: tuple[RecentShape, ...]


class SavedMessage(Answer):
    """Whether the newest edit is stored on the server's disk."""

    type: Literal["saved"] = "saved"
    saved: bool
    key: str  # the key of the kept edit; a page that reconnects to a new server opens this edit


class ColumnState(Model):
    """A column of weights. It belongs to one counterpart, or to the handle and all its counterparts."""

    column: int  # identifier of the weights in `ColumnsMessage`; equal weights have the same identifier
    frame: Frame  # the matrix F by rows; F rotates or reflects the handle's motion, see `dfd.app.protocol`
    position: Vector  # resting position of the handle or the counterpart


@with_fields(controls.Controls, dict.fromkeys(controls.CONTROLS, ...), SHOWN)
class HandleState(PoseTransform):
    """The present state of a handle."""

    name: str | None
    vertex: int | None  # null for a point in space or a region
    position: Vector  # resting position of the handle
    pivot: Vector  # center of rotation and scale
    pivot_set: bool  # whether the transform has a pivot; if not, `pivot` is `position`
    origin: int  # the vertex from which the steps of `ladder` are found
    reach_by: Literal["number", "part"]  # "part" if the reach is "part"; `reach` is a number in both cases
    mask_part: bool  # whether the mask is the handle's part
    region: int  # number of vertices in the handle's region; 0 for a point
    columns: tuple[ColumnState, ...]
    moved: bool  # whether the transform moves any point


class FixedState(Model):
    """A fixed point or region."""

    vertex: int | None
    position: Vector
    strength: float
    region: int  # number of vertices in the region; 0 for a point


class MarkState(Mark):
    """A mark, and how far it is from its target."""

    position: Vector  # resting position
    missing: float  # distance between the posed vertex and the target


class FieldState(Model):
    """The status and the origin of the shape's field."""

    status: Literal["none", "distilling", "preparing", "ready"]
    origin: str | None  # "file", "cache", "sample", "distilled", or "geometry" before features are learned
    parts: tuple[PartChange, ...] = ()  # the ways to change a handle's region that are available now


class StateMessage(Answer):
    """The whole present state, sent after every change."""

    type: Literal["state"] = "state"
    after: int  # the `id` of the newest request whose changes this state includes
    handles: tuple[HandleState, ...] = ()
    fixed: tuple[FixedState, ...] = ()
    symmetry: SymmetryPlane | None = None
    planes: tuple[SymmetryPlane, ...] = ()  # the planes of symmetry that were found
    default: PoseTransform | None = None  # D₀ of Eq. 1, which moves the rest of the shape; `handle` is 0
    preset: Preset
    steps: tuple[str, ...] = ()  # names of the steps that `go` can undo or redo, the oldest first
    step: int = 0  # number of `steps` that are done
    field: FieldState
    poses: tuple[KeyPose, ...]
    marks: tuple[MarkState, ...] = ()
    fitted: str | None = None  # what the newest fit says of motions that the marks do not determine


class DoneMessage(Answer):
    """The request succeeded."""

    type: Literal["done"] = "done"


class FailureMessage(Answer):
    """The request failed and changed nothing. If `id` is 0, background work failed or gave a warning."""

    type: Literal["failure"] = "failure"
    message: str  # a sentence for the user


class ProgressMessage(Answer):
    """The progress of background work."""

    type: Literal["progress"] = "progress"
    task: Literal["open", "distill", "prepare", "suggest"]
    stage: str  # the last stage of a task is "done", "cancelled" or "failed"
    text: str  # the stage for the user
    share: float | None  # share of the stage's items that are done; null if they are not counted


class ReportMessage(Answer):
    """The effect of the edit: a short sentence, and sentences with details."""

    type: Literal["report"] = "report"
    text: str
    details: tuple[str, ...]


class Suggestion(Model):
    """A suggested place for a handle."""

    vertex: int
    position: Vector
    name: str


class SuggestionsMessage(Answer):
    """Answer to `suggest`."""

    type: Literal["suggestions"] = "suggestions"
    suggestions: tuple[Suggestion, ...]


class SimilarPoint(Model):
    """The place of a handle, or of one of its counterparts."""

    vertex: int  # the vertex that identifies the counterpart in `excluded_counterparts`
    position: Vector
    on: bool  # whether the surface there moves with the handle


class SimilarMessage(Answer):
    """Answer to `counterparts`. `places` has the handle, then its counterparts in order of decreasing similarity."""

    type: Literal["similar"] = "similar"
    handle: int
    places: tuple[SimilarPoint, ...]


class LadderStep(Model):
    """A part at a vertex, for `probe` and `add`."""

    level: int
    text: str  # its name in the file, its number of components, and its size, in words that no other step has
    share: float  # area of its components, as a fraction of the surface
    alike: int  # number of its components
    found: bool  # False if no part was found, so that a handle moves all surface within a feature distance
    leaves: bool  # whether a component of the surface touches the part, but is not in it


class LadderMessage(Answer):
    """Answer to `ladder`: the parts at a vertex, from the smallest to the largest."""

    type: Literal["ladder"] = "ladder"
    vertex: int
    steps: tuple[LadderStep, ...]


class BendAxis(Model):
    """The axis along which a part bends, for the equations of `dfd.posing.bend`."""

    nodes: tuple[Vector, ...]  # points at equal distances from the base to the tip
    radius: tuple[float, ...]  # distance of the surface from each of them
    slender: bool  # if false, the part rotates as a whole about the first of the two nodes
    carry: Frame  # matrix by rows that maps the handle's bend to the bend of the part


class AxisMessage(Answer):
    """Answer to `axis`: the possible pivots of a handle, and the axis along which the handle's part bends."""

    type: Literal["axis"] = "axis"
    handle: int
    pivots: tuple[PivotAt, ...]
    auto: Vector  # position of the pivot "auto" on the resting shape
    bends: BendAxis | None  # null if the handle's part has no axis


class Proposal(Model):
    """Other controls that a handle could have."""

    label: str
    controls: dict[str, str | int]


class ProposalsMessage(Answer):
    """Answer to `propose`. Arrays: the posed shape with the controls of proposal i, as in `PositionsMessage`.

    `positions{i}` is float32 (V, 3), and `normals{i}` is int16 (V, 4).
    """

    type: Literal["proposals"] = "proposals"
    handle: int
    proposals: tuple[Proposal, ...]


class DownloadMessage(Answer):
    """A file that can be downloaded once."""

    type: Literal["download"] = "download"
    url: str
    name: str
    said: str = ""  # the report of a rig, morph targets or an animation; empty for other files


class MaterialEntry(Model):
    """A material; colors are display-referred (sRGB)."""

    color: tuple[float, float, float, float]
    texture: str | None  # name of the array that holds the image file
    media_type: str | None
    wrap: tuple[Wrap, Wrap]
    alpha_mode: Literal["OPAQUE", "MASK", "BLEND"]
    alpha_cutoff: float


class Group(Model):
    """Consecutive triangles of one material."""

    material: int  # index into `materials`
    start: int  # first triangle
    count: int


class MeshMessage(Answer):
    """The resting shape as R rows. A row is a vertex with a normal, uv and color; a vertex on a seam has several rows.

    Arrays: `positions` float32 (R, 3), relative to `center`; `triangles` uint32 (F, 3), the row of each corner;
    `vertex` uint32 (R,), the vertex of each row; `normals` int16 (R, 4), unit normals times 32767 and a 0. Optional:
    `uv` float32 (R, 2), v points up; `colors` uint8 (R, 4), display-referred (sRGB); the image file of each texture.
    """

    type: Literal["mesh"] = "mesh"
    name: str
    vertices: int
    faces: int
    parts: int  # number of scene parts, such as objects, in the file
    center: Vector
    diagonal: float
    groups: tuple[Group, ...]
    materials: tuple[MaterialEntry, ...]
    warnings: tuple[str, ...]  # problems that were found while the file was read, as sentences
    recent: tuple[RecentShape, ...] = ()  # other shapes that were edited


class ColumnsMessage(Answer):
    """New weights, which the next `state` uses. After it, the page may delete weights that no handle uses.

    Array: `values` uint16 (C, V), weights times 65535; row i has the identifier `columns[i]`.
    """

    type: Literal["columns"] = "columns"
    columns: tuple[int, ...]


class HeatMessage(Answer):
    """Answer to `probe`, `stays`, `preview` and `take_part`, or exact weights after a `probe`.

    The array `values` uint16 (V,) has weights times 65535.
    """

    type: Literal["heat"] = "heat"
    vertex: int | None  # the vertex of `probe` or `stays`; null for other requests
    level: int = 0  # the level of the `probe`
    # Whether the values are those of a new handle. If not, they are an approximation, and exact ones follow if the
    # page sends no other request.
    exact: bool = False


class PositionsMessage(Answer):
    """Answer to `compute`. Arrays: `positions` float32 (V, 3), relative to `center`; `normals` int16 (V, 4)."""

    type: Literal["positions"] = "positions"


class ColorsMessage(Answer):
    """Answer to `features`. Array: `colors` uint8 (V, 4), display-referred (sRGB)."""

    type: Literal["colors"] = "colors"


def pack(message: Answer, **arrays: NDArray[Any]) -> bytes:
    """Return a message and its arrays as the bytes of a safetensors file; see `dfd.app.protocol`."""
    whole = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
    return save(whole, {"message": message.model_dump_json()})
