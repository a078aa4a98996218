"""The requests of the page. Each is a function whose parameters are the fields of the message."""

from __future__ import annotations

import base64
import binascii
import secrets
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field

from dfd.app.options import Opening
from dfd.app.protocol import answers
from dfd.app.protocol.parts import (
    Controls,
    Index,
    PartChange,
    Place,
    PoseTransform,
    PoseTransforms,
    Region,
    Text,
    Transform,
)
from dfd.app.protocol.requests import Request, call, request
from dfd.app.session import exports
from dfd.app.session.columns import heat_message, probed
from dfd.app.session.session import Session
from dfd.app.session.state import feature_colors_message, positions_message
from dfd.common.preset import Preset
from dfd.editing.edit import Fixed
from dfd.editing.influence.held_parts import pivot_on
from dfd.editing.points import place_on
from dfd.posing.transforms import PivotAt, vector
from dfd.symmetry.plane import SymmetryPlane

if TYPE_CHECKING:
    from dfd.editing.deformer import Deformer

NO_CONTROLS = Controls()
MOST_SUGGESTED = 12  # number of suggested places; more markers would hide the shape


def answer(session: Session, message: Request) -> None:
    """Handle a request and send the answer; an exception becomes a `failure` message."""

    def work() -> None:
        reply = call(session, message)
        if isinstance(reply, bytes):
            session.send(reply)
        else:
            session.send((reply or answers.DoneMessage()).model_copy(update={"id": message.id}))

    session.after = message.id
    session.guarded(message.id, work)


# --- opening, distilling


@request
def open_sample(session: Session, name: Text) -> None:
    """Open one of the samples that `session` lists."""
    session.open(Opening(mesh=name))


request(Session.close_mesh)
request(Session.distill)
request(Session.cancel)
request(Session.set_poses)


# --- queries


@request
def probe(session: Session, vertex: Index) -> bytes:
    """Show about what a new handle at a vertex would hold. Only the newest request is answered. Answer: `heat`."""
    deformer = session.require().deformer
    place = place_on(deformer.mesh, vertex)
    return heat_message(probed(deformer, place), request=session.after, vertex=vertex)


@request
def compute(session: Session, transforms: PoseTransforms | None = None) -> bytes:
    """Pose the shape with `transforms` in place of the handles' own; null is the present edit.

    Answer: `positions`. Only the newest request is answered.
    """
    with _posed_by(session, transforms):
        return positions_message(session.require().deformer, request=session.after)


@request
def features(session: Session) -> bytes:
    """Color the vertices by the principal directions of their features. Answer: `colors`."""
    return feature_colors_message(session.require().deformer, request=session.after)


@request
def suggest(session: Session) -> answers.Answer:
    """Suggest places for handles: a vertex far inside each of the largest parts. Answer: `suggestions`."""
    deformer = session.require().deformer
    found: list[answers.Suggestion] = []
    for number, part in enumerate(deformer.bound.grips.parts.cut()[:MOST_SUGGESTED], start=1):
        alike = f", {part.components} alike" if part.components > 1 else ""
        position = vector("position", deformer.mesh.vertices[part.vertex])
        found.append(answers.Suggestion(vertex=part.vertex, position=position, name=f"Part {number}{alike}"))
    return answers.SuggestionsMessage(suggestions=tuple(found))


@request
def counterparts(session: Session, handle: int) -> answers.Answer:
    """Find the counterparts of a handle, and whether each moves with it. Answer: `similar`."""
    places = []
    for counterpart, on in session.require().deformer.counterparts(handle):
        position = vector("position", counterpart.position)
        places.append(answers.SimilarPoint(vertex=int(counterpart.vertex), position=position, on=on))
    return answers.SimilarMessage(handle=handle, places=tuple(places))


@request
def axis(session: Session, handle: int) -> answers.Answer:
    """Find the possible pivots of a handle, and the axis along which its part bends. Answer: `axis`."""
    deformer = session.require().deformer
    edit = deformer.edit
    held = edit.handle(handle)
    part = next(iter(deformer.bound.held_parts(edit, held)), None)
    pivots: tuple[PivotAt, ...] = ("point",)
    auto = held.place.position
    if part is None:
        return answers.AxisMessage(handle=handle, pivots=pivots, auto=auto, base=None, tip=None)
    pivots += ("base", "middle", "hinge") if edit.symmetry is None else ("base", "middle", "hinge", "plane")
    if edit.rules.pivot == "auto":
        auto = pivot_on(part, None, held, edit.symmetry)[0]
    base, tip = (vector("axis", part.axis.nodes[end]) for end in (0, -1))
    return answers.AxisMessage(handle=handle, pivots=pivots, auto=auto, base=base, tip=tip)


# --- handles


@request
def add(session: Session, at: Place) -> None:
    """Add a handle."""
    place = _known(session, at)
    session.change(lambda deformer: deformer.add(place))


@request
def take_part(
    session: Session, handle: int, how: PartChange, vertex: Index | None = None, preview: bool = False
) -> bytes | None:
    """Hold another part; "add" and "remove" need the `vertex` of a part. If the mask is the part, it changes as well.

    With `preview`, the edit stays unchanged, and the answer is `heat`: the weights that the handle would have.
    """
    parts, deformer = session.require().parts, session.require().deformer
    held = deformer.edit.handle(handle)
    chosen = parts.taken(held, how, vertex)
    mask = chosen if parts.limits(held) else None
    if not preview:
        session.change(lambda deformer: deformer.change(handle, at=chosen, mask=mask))
        return None
    with _tried(deformer):
        deformer.change(handle, at=chosen, mask=mask)
        weights = deformer.bound.following(deformer.edit)[:, deformer.handles.index(deformer.handle(handle))]
        return heat_message(weights, request=session.after)


@request
def move(
    session: Session,
    handle: int,
    transform: Transform,
    controls: Controls = NO_CONTROLS,
    merge: bool = False,
    settle: bool = False,
) -> None:
    """Set values of a handle's transform, relative to the resting shape.

    A drag is a move followed by moves with `merge`, and is one step of undo. Moves with `merge` are answered by `done`
    alone. The last one has `settle`: it is also answered by `state` and `report`, and may contain changed `controls`.
    """
    parts, changed = transform.model_dump(exclude_none=True), _controls(session, controls)
    if merge and not (settle or changed):
        session.require().deformer.move(handle, **parts, merge=True)
        session.note_shown()
        return

    def work(deformer: Any) -> None:
        deformer.move(handle, **parts)
        if changed:
            deformer.change(handle, **changed)

    session.change(work, ("handle", handle), merge=merge)  # the topic of `Deformer.move`


@request
def pose(session: Session, transforms: PoseTransforms) -> None:
    """Set the transforms of several handles, as one step."""
    session.change(lambda deformer: _move_all(deformer, transforms))


@request
def reset(session: Session, handle: int | None = None) -> None:
    """Reset the transform of a handle, or of all handles with null, as one step."""
    zero = (0.0, 0.0, 0.0)

    def work(deformer: Any) -> None:
        for each in [each.id for each in deformer.handles] if handle is None else [handle]:
            deformer.move(each, translation=zero, rotation=zero, scale=1.0, bend=zero, twist=0.0)

    session.change(work)


@request
def change(session: Session, handle: int, controls: Controls, merge: bool = False) -> None:
    """Set a handle's name or controls. With `merge`, the change joins the previous change of that handle."""
    given = _controls(session, controls)
    if isinstance(given.get("mask"), str) and given["mask"] == "part":
        given["mask"] = session.require().parts.of(session.require().deformer.edit.handle(handle))
    session.change(lambda deformer: deformer.change(handle, **given), ("change", handle), merge=merge)


@request
def remove(session: Session, handle: int) -> None:
    """Remove a handle."""
    session.change(lambda deformer: deformer.remove(handle))


# --- the whole shape


@request
def fix(session: Session, at: Place) -> None:
    """Fix a point or region with everything similar to it."""
    place = _known(session, at)
    session.change(lambda deformer: deformer.fix(place))


@request
def release(session: Session, index: Index) -> None:
    """Release the fixed place at `index` in `state`."""
    place = _fixed(session, index).place
    session.change(lambda deformer: deformer.release(place))


@request
def change_fixed(
    session: Session, index: Index, strength: Annotated[float, Field(ge=0, le=1)], merge: bool = False
) -> None:
    """Set the strength of the fixed place at `index`. With `merge`, the change joins the previous one."""
    fixed = session.require().deformer.fixed
    changed = replace(_fixed(session, index), strength=strength)
    after = (*fixed[:index], changed, *fixed[index + 1 :])
    session.change(lambda deformer: deformer.apply(replace(deformer.edit, fixed=after)), ("fixed", index), merge=merge)


def _fixed(session: Session, index: int) -> Fixed:
    fixed = session.require().deformer.fixed
    if index >= len(fixed):
        raise ValueError(f"There is no fixed place {index}: there are {len(fixed)}")
    return fixed[index]


@request
def set_symmetry(
    session: Session,
    plane: SymmetryPlane | Literal["x", "y", "z"] | None,
    band: Annotated[float, Field(ge=0)] | None = None,
    merge: bool = False,
) -> None:
    """Mirror handles across a plane. With `merge`, the change joins the previous one."""
    session.change(lambda deformer: deformer.set_symmetry(plane, band=band), "symmetry", merge=merge)


@request
def set_preset(session: Session, preset: Preset) -> None:
    """Set the preset, with the reach, falloff and counterparts of every handle, as one step."""
    session.change(lambda deformer: setattr(deformer, "preset", preset))


@request
def set_default(session: Session, transform: Transform, merge: bool = False) -> None:
    """Set D₀, the transform of everything that no handle holds; all null removes it. `merge` as in `set_symmetry`."""
    parts = transform.model_dump(exclude_none=True)
    session.change(lambda deformer: deformer.set_default(**parts), "default", merge=merge)


@request
def undo(session: Session) -> None:
    """Undo the newest step."""
    if session.require().deformer.undo():
        session.tell_state()


@request
def redo(session: Session) -> None:
    """Redo the step that was undone last."""
    if session.require().deformer.redo():
        session.tell_state()


@request
def clear(session: Session) -> None:
    """Remove all handles and fixed places, as one step; the mirror plane stays."""
    session.change(lambda deformer: deformer.apply(replace(deformer.edit, handles=(), fixed=())))


# --- export


@request
def export(
    session: Session,
    format: exports.Kind,  # noqa: A002
    transforms: PoseTransforms | None = None,
) -> answers.Answer:
    """Export the shape as the page shows it, the edit or the field.

    `transforms` are those that the page shows in place of the edit's. "rig" is a GLB file with joints, "morph" one with
    morph targets, and "animation" one of the key poses. Answer: `download`.
    """
    deformer, poses, number = session.require().deformer, session.poses, secrets.token_hex(16)
    folder = session.folder / number
    folder.mkdir()
    try:
        with _posed_by(session, transforms):
            path, said = exports.export(deformer, format, session.name, folder, poses)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    session.exports[number] = path
    return answers.DownloadMessage(url=f"download/{session.folder.name}/{number}", name=path.name, said=said)


class _TakenBackError(Exception):
    """Ends a step whose changes are discarded."""


@contextmanager
def _posed_by(session: Session, transforms: Sequence[PoseTransform] | None) -> Iterator[None]:
    """Give the handles these transforms inside the block, if any; restore the edit and its steps afterwards."""
    if transforms is None:
        yield
        return
    deformer = session.require().deformer
    with _tried(deformer):
        _move_all(deformer, transforms)
        yield


@contextmanager
def _tried(deformer: Deformer) -> Iterator[None]:
    """Discard all changes made inside the block."""
    with suppress(_TakenBackError), deformer.step():
        yield
        raise _TakenBackError


def _move_all(deformer: Any, transforms: Sequence[PoseTransform]) -> None:
    at_rest = {"pivot": "point", "axes": "auto", "joint": "spread"}
    for each in transforms:
        deformer.move(**{name: at_rest[name] if part is None else part for name, part in each.model_dump().items()})


# --- from messages to arguments of `Deformer`


def _known(session: Session, value: Any) -> Any:
    """Return the vertices of a region, in order; return any other value unchanged."""
    if not isinstance(value, Region):
        return value
    count = len(session.require().deformer.mesh.vertices)
    try:
        data = base64.b64decode(value.mask, validate=True)
    except binascii.Error:
        raise ValueError("A region's mask must be bytes written as base64") from None
    if len(data) != -(-count // 8):
        raise ValueError(f"A region's mask must have {-(-count // 8)} bytes for {count} vertices, got {len(data)}")
    members = np.flatnonzero(np.unpackbits(np.frombuffer(data, np.uint8), count=count, bitorder="little"))
    if len(members) == 0:
        raise ValueError("A region must hold at least one vertex")
    return members


def _controls(session: Session, controls: Controls) -> dict[str, Any]:
    return {name: _known(session, value) for name, value in controls if value is not None}
