"""What the server sends as text."""

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
    """Every message of the server: `id` is that of the request it answers, 0 where it comes unasked."""

    id: int = 0


class SessionMessage(Answer):
    """The first message: who the tab is, and what the server can do."""

    type: Literal["session"] = "session"
    session: str  # with this name, a tab goes on where it was
    samples: tuple[str, ...]
    upload_bytes: int  # the largest upload, all files together
    formats: tuple[str, ...]  # endings that `POST /upload` takes
    controls: tuple[ControlEntry, ...] = control_entries()


class StartMessage(Answer):
    """There is no mesh: the start page."""

    type: Literal["start"] = "start"


class ColumnState(Model):
    """A column of weights: all of a handle's, or those of one counterpart."""

    column: int  # its number; the same number is the same data
    frame: Frame | None  # rows of the matrix that turns or mirrors the handle's motion into its own
    position: Vector  # of the handle or the counterpart


class HandleBase(PoseTransform):
    """A live handle."""

    name: str | None
    vertex: int | None  # null where it sits at a point of space or holds a region
    position: Vector  # where it rests
    pivot: Vector  # what it turns and scales about
    pivot_set: bool  # whether that was set or found; otherwise it is `position`
    pivot_at: PivotAt | None  # what of the held part it is; null where it is numbers, or nothing was said
    reach_by: Literal["number", "part"]  # what was asked for; `reach` is what that found
    mask_part: bool  # whether that region is its part
    region: int  # how many vertices it holds as one; 0 where it is no region
    columns: tuple[ColumnState, ...]
    moved: bool  # whether its transform does anything


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
    """Whether the shape has a field, and where it came from."""

    status: Literal["none", "distilling", "preparing", "ready"]
    origin: str | None  # "file", "cache", "distilled"
    parts: tuple[PartChange, ...] = ()  # ways to hold another part that are possible on this shape without delay


class StateMessage(Answer):
    """The whole present state, after every change."""

    type: Literal["state"] = "state"
    after: int  # the number of the newest request that it includes
    handles: tuple[HandleState, ...] = ()
    fixed: tuple[FixedState, ...] = ()
    symmetry: SymmetryPlane | None = None
    planes: tuple[SymmetryPlane, ...] = ()  # that were found
    default: PoseTransform | None = None  # D₀, with handle 0 … and its pivot
    preset: Preset  # "paper" is its equations to the letter
    can_undo: bool = False
    can_redo: bool = False
    field: FieldState
    poses: tuple[KeyPose, ...]


class DoneMessage(Answer):
    """It was done."""

    type: Literal["done"] = "done"


class FailureMessage(Answer):
    """It was not done, and nothing changed; `message` is a sentence for people."""

    type: Literal["failure"] = "failure"
    message: str


class ProgressMessage(Answer):
    """How far the long work in the background is."""

    type: Literal["progress"] = "progress"
    task: Literal["open", "distill", "prepare"]
    stage: str  # as the command line names it; "done", "cancelled" and "failed" are the last ones
    done: int
    total: int | None
    seconds_left: float | None  # of the whole task, as far as that can be told


class ReportMessage(Answer):
    """What the edit does to the shape, as a sentence."""

    type: Literal["report"] = "report"
    text: str


class Suggestion(Model):
    """A place worth taking hold of."""

    vertex: int
    position: Vector
    name: str


class SuggestionsMessage(Answer):
    """Answer to `suggest`."""

    type: Literal["suggestions"] = "suggestions"
    suggestions: tuple[Suggestion, ...]


class SimilarPoint(Model):
    """A place that looks like the one a handle holds."""

    vertex: int  # its name
    position: Vector
    on: bool  # whether it moves along


class SimilarMessage(Answer):
    """Answer to `counterparts`: the handle's own place first, which always moves, then the most similar."""

    type: Literal["similar"] = "similar"
    handle: int
    places: tuple[SimilarPoint, ...]


class AxisMessage(Answer):
    """Answer to `axis`: what a handle may turn about, and along what it bends."""

    type: Literal["axis"] = "axis"
    handle: int
    pivots: tuple[PivotAt, ...]
    auto: Vector  # where that is if nothing is said, mesh units, at rest
    base: Vector | None  # of the part's axis; null where nothing that is held has one
    tip: Vector | None


class DownloadMessage(Answer):
    """A file that is served once."""

    type: Literal["download"] = "download"
    url: str
    name: str
    said: str = ""  # of the file, where it is not all that is seen
