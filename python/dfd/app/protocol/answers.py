"""Messages of the server without arrays."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from pydantic import create_model

from dfd.app.protocol.parts import (
    SHOWN,
    ControlEntry,
    Frame,
    KeyPose,
    Model,
    PartChange,
    PoseTransform,
    Vector,
    control_entries,
    control_types,
)
from dfd.common.preset import Preset
from dfd.posing.transforms import PivotAt
from dfd.symmetry.plane import SymmetryPlane


class Answer(Model):
    """The base of all messages of the server: `id` is that of the answered request, or 0."""

    id: int = 0


class SessionMessage(Answer):
    """The first message: the name of the session, and the options of the server."""

    type: Literal["session"] = "session"
    session: str  # with this name, a tab reconnects to its session
    samples: tuple[str, ...]
    upload_bytes: int  # largest total size of an upload
    formats: tuple[str, ...]  # file endings that `POST /upload` accepts
    controls: tuple[ControlEntry, ...] = control_entries()


class StartMessage(Answer):
    """No mesh is open: show the start page."""

    type: Literal["start"] = "start"


class ColumnState(Model):
    """A column of weights: of a whole handle, or of one counterpart."""

    column: int  # its number; equal numbers mean equal data
    frame: Frame  # rows of the matrix that rotates or reflects the handle's motion
    position: Vector  # position of the handle or the counterpart


class HandleBase(PoseTransform):
    """A handle."""

    name: str | None
    vertex: int | None  # null for a point in space or a region
    position: Vector  # its resting position
    pivot: Vector  # center of rotation and scale
    pivot_set: bool  # whether the pivot was given or found; otherwise it is `position`
    pivot_at: PivotAt | None  # name of the pivot; null if it was given in numbers, or not at all
    reach_by: Literal["number", "part"]  # how the reach was given; `reach` is the resulting number
    mask_part: bool  # whether the mask is the handle's part
    region: int  # number of vertices of its region; 0 for a point
    columns: tuple[ColumnState, ...]
    moved: bool  # whether its transform moves anything


if TYPE_CHECKING:
    HandleState = HandleBase
else:
    HandleState = create_model(
        "HandleState",
        __base__=HandleBase,
        __doc__=HandleBase.__doc__,
        **{name: (kind, ...) for name, kind in control_types(SHOWN).items()},
    )


class FixedState(Model):
    """A fixed place."""

    vertex: int | None
    position: Vector
    strength: float
    region: int


class FieldState(Model):
    """The status of the shape's field, and its origin."""

    status: Literal["none", "distilling", "preparing", "ready"]
    origin: str | None  # "file", "cache", "distilled"
    parts: tuple[PartChange, ...] = ()  # ways to hold another part that this shape allows now


class StateMessage(Answer):
    """The whole present state, after every change."""

    type: Literal["state"] = "state"
    after: int  # the number of the newest request that it includes
    handles: tuple[HandleState, ...] = ()
    fixed: tuple[FixedState, ...] = ()
    symmetry: SymmetryPlane | None = None
    planes: tuple[SymmetryPlane, ...] = ()  # the planes of symmetry that were found
    default: PoseTransform | None = None  # D₀ with its pivot, as handle 0
    preset: Preset
    can_undo: bool = False
    can_redo: bool = False
    field: FieldState
    poses: tuple[KeyPose, ...]


class DoneMessage(Answer):
    """The request succeeded."""

    type: Literal["done"] = "done"


class FailureMessage(Answer):
    """The request failed, and nothing changed; `message` is a sentence for people."""

    type: Literal["failure"] = "failure"
    message: str


class ProgressMessage(Answer):
    """The progress of background work."""

    type: Literal["progress"] = "progress"
    task: Literal["open", "distill", "prepare"]
    stage: str  # as on the command line; a task ends with "done", "cancelled" or "failed"
    done: int
    total: int | None
    seconds_left: float | None  # estimate for the whole task; null if unknown


class ReportMessage(Answer):
    """The effect of the edit, as a sentence."""

    type: Literal["report"] = "report"
    text: str


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
    """A counterpart of a handle."""

    vertex: int  # identifies it
    position: Vector
    on: bool  # whether it moves with the handle


class SimilarMessage(Answer):
    """Answer to `counterparts`: the handle's own place first, then the others in order of similarity."""

    type: Literal["similar"] = "similar"
    handle: int
    places: tuple[SimilarPoint, ...]


class AxisMessage(Answer):
    """Answer to `axis`: the possible pivots of a handle, and the axis along which it bends."""

    type: Literal["axis"] = "axis"
    handle: int
    pivots: tuple[PivotAt, ...]
    auto: Vector  # the default pivot at rest, mesh units
    base: Vector | None  # start of the part's axis; null if the held part has no axis
    tip: Vector | None  # end of the axis


class DownloadMessage(Answer):
    """A file that can be downloaded once."""

    type: Literal["download"] = "download"
    url: str
    name: str
    said: str = ""  # how the file differs from the page; empty if it does not
