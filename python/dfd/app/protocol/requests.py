"""What the page sends."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, JsonValue

from dfd.app.protocol.parts import (
    MOST_HANDLES,
    Controls,
    Identifier,
    Index,
    KeyPose,
    Mode,
    Model,
    Number,
    Place,
    Plane,
    PointPlace,
    PoseTransform,
    Text,
    Transform,
    VertexPlace,
)

__all__ = ["ClientMessage", "Request"]


class Request(Model):
    """Every message of the page: `id` numbers it, for the answer to name."""

    id: Annotated[int, Field(ge=1, le=2**53)]


class Hello(Request):
    """First of all; with the `session` of before, a tab goes on where it was. Answer: `session`, then all there is."""

    type: Literal["hello"]
    version: int
    session: Identifier | None = None


class OpenSample(Request):
    """Open one of the samples that `session` lists."""

    type: Literal["open_sample"]
    name: Text


class CloseMesh(Request):
    """Go back to the start page; the edit is lost."""

    type: Literal["close_mesh"]


class Distill(Request):
    """Make the shape's field, in the background: `progress`, then `state` and `columns`."""

    type: Literal["distill"]


class Cancel(Request):
    """Stop the distillation; what is done is kept for the next one."""

    type: Literal["cancel"]


class Probe(Request):
    """The column that a handle at `at` would have; a newer one overtakes it unanswered. Answer: `heat`."""

    type: Literal["probe"]
    at: VertexPlace | PointPlace


class Add(Request):
    """Take hold. Answer: `done` with the `handle`."""

    type: Literal["add"]
    at: Place
    transform: Transform = Transform()
    controls: Controls = Controls()


class Move(Request):
    """Set parts of a handle's transform, from the resting shape.

    A drag is a plain move, then moves with `merge`, one step of undo; those are answered by `done` alone, the last one,
    with `settle`, by `state` and `report` as well. That one may bring `controls` that were changed on the way.
    """

    type: Literal["move"]
    handle: int
    transform: Transform
    controls: Controls = Controls()
    merge: bool = False
    settle: bool = False


class Pose(Request):
    """Set the transforms of several handles, as one step."""

    type: Literal["pose"]
    transforms: Annotated[tuple[PoseTransform, ...], Field(max_length=MOST_HANDLES)]


class Change(Request):
    """Set what a handle holds, or where it sits; with `merge`, one step with a change of that handle just before."""

    type: Literal["change"]
    handle: int
    at: Place | None = None
    controls: Controls = Controls()
    merge: bool = False


class Remove(Request):
    """Let go of a handle."""

    type: Literal["remove"]
    handle: int


class Fix(Request):
    """Hold a place, and what looks like it."""

    type: Literal["fix"]
    at: Place
    strength: Annotated[Number, Field(ge=0, le=1)] | None = None


class Release(Request):
    """Take back a fixed place: the `index` among those of `state`."""

    type: Literal["release"]
    index: Index


class ChangeFixed(Request):
    """Set how much the fixed place at `index` takes away; with `merge`, one step with such a change just before."""

    type: Literal["change_fixed"]
    index: Index
    strength: Annotated[Number, Field(ge=0, le=1)]
    merge: bool = False


class SetSymmetry(Request):
    """Let handles act on both sides of a plane; with `merge`, one step with such a request just before."""

    type: Literal["set_symmetry"]
    plane: Plane | Literal["auto", "x", "y", "z"] | None
    band: Annotated[Number, Field(ge=0)] | None = None
    merge: bool = False


class SetPreset(Request):
    """Put everything that a preset says in the place of what was there, as one step: a name of `state.presets`."""

    type: Literal["set_preset"]
    preset: Mode


class SetOverlap(Request):
    """What happens where handles overlap: a name of `state.overlaps`."""

    type: Literal["set_overlap"]
    mode: Mode


class SetBlend(Request):
    """How transforms blend: a name of `state.blends`."""

    type: Literal["set_blend"]
    mode: Mode


class SetDefault(Request):
    """Set D₀, what happens to what no handle holds; all null is nothing. `merge` is as in `set_symmetry`."""

    type: Literal["set_default"]
    transform: Transform
    merge: bool = False


class Undo(Request):
    """Take the newest step back."""

    type: Literal["undo"]


class Redo(Request):
    """Take a step again that was taken back."""

    type: Literal["redo"]


class Reset(Request):
    """Return a handle to rest, or with null all of them, as one step."""

    type: Literal["reset"]
    handle: int | None = None


class Clear(Request):
    """Let go of everything, as one step."""

    type: Literal["clear"]


class Apply(Request):
    """Replace everything by an edit document, as one step."""

    type: Literal["apply"]
    edit: dict[str, JsonValue]


class SetPoses(Request):
    """Replace the key poses; they are no part of the edit and of its undo."""

    type: Literal["set_poses"]
    poses: Annotated[tuple[KeyPose, ...], Field(max_length=1000)]


class Compute(Request):
    """The posed shape from the kernel. Answer: `positions`; a newer one overtakes it unanswered."""

    type: Literal["compute"]


class Features(Request):
    """Colors of the features' main directions. Answer: `colors`."""

    type: Literal["features"]


class Suggest(Request):
    """Good places for handles. Answer: `suggestions`."""

    type: Literal["suggest"]
    count: Annotated[int, Field(ge=1, le=64)] = 12


class Instances(Request):
    """The places that look like the one a handle holds, and whether each moves along. Answer: `alike`."""

    type: Literal["instances"]
    handle: int


class Export(Request):
    """Write what was done; "animation" is a GLB with the key poses, on joints. Answer: `download`."""

    type: Literal["export"]
    format: Literal["glb", "obj", "ply", "stl", "animation", "edit", "field"]


class Script(Request):
    """What was done as Python and as a command. Answer: `script`."""

    type: Literal["script"]


ClientMessage = Annotated[
    Hello
    | OpenSample
    | CloseMesh
    | Distill
    | Cancel
    | Probe
    | Add
    | Move
    | Pose
    | Change
    | Remove
    | Fix
    | Release
    | ChangeFixed
    | SetSymmetry
    | SetPreset
    | SetOverlap
    | SetBlend
    | SetDefault
    | Undo
    | Redo
    | Reset
    | Clear
    | Apply
    | SetPoses
    | Compute
    | Features
    | Suggest
    | Instances
    | Export
    | Script,
    Field(discriminator="type"),
]
