"""The requests of the page. Each request is a function whose parameters are the fields of the message."""

import base64
import binascii
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from dfd.app.protocol import messages
from dfd.app.protocol.messages import Controls, Index, PartChange, Place, PoseTransforms, Transform
from dfd.app.protocol.requests import HANDLERS, Request, request
from dfd.app.session import exports
from dfd.app.session.marks import replace_marks
from dfd.app.session.session import Session
from dfd.app.session.state import Editing, quantized, short_drag
from dfd.app.session.surface import Arrays, centered, packed_normals
from dfd.common.linear_algebra import Float32
from dfd.common.preset import Preset
from dfd.editing.deformer import Deformer
from dfd.editing.edit import Fixed
from dfd.editing.points import place_on
from dfd.editing.presets import PARTLESS_REACH, PRESETS
from dfd.editing.weights import of_handles
from dfd.editing.weights.axis_motions import BendablePart, bendable_parts, pivot_on
from dfd.geometry.normals import updated_normals
from dfd.pictures.colors import feature_colors
from dfd.posing.transforms import PivotAt, vector
from dfd.symmetry.plane import SymmetryPlane
from dfd.weights.bind import bind

NO_CONTROLS = Controls()
FOLLOWERS = {"none": "Only this", "mirror": "Mirrored", "all": "All alike"}  # who follows, in words
SAME_WEIGHTS = 0.02  # proposals whose weights differ by less than this share of their mean look the same

ArrayAnswer = tuple[messages.Answer, Arrays]


def answer(session: Session, message: Request) -> None:
    """Handle a request and send the answer; an exception becomes a `failure` message."""

    def work() -> None:
        fields = {name: value for name, value in message if name not in Request.model_fields}
        reply = HANDLERS[message.type](session, **fields) or messages.DoneMessage()
        said, arrays = reply if isinstance(reply, tuple) else (reply, {})
        session.send(said.model_copy(update={"id": message.id}), **arrays)

    session.after = message.id
    session.guarded(message.id, work)


@request
def probe(session: Session, vertex: Index, level: int = 0) -> ArrayAnswer:
    """Approximate the weights of a dragged new handle. Only the newest `probe` is answered. Answer: `heat`.

    `level` is that of a step of `ladder`.
    """
    editing = session.require()
    editing.pointed = vertex, level
    return _heat(probed(session.deformer, vertex, level), vertex, level)


def probed(deformer: Deformer, vertex: int, level: int = 0) -> Float32:
    """Return the weights of a new handle during a drag, (V,), without a search for counterparts."""
    rules, bound, place = PRESETS[deformer.preset], deformer.bound, place_on(deformer.mesh, vertex)
    drag = short_drag(deformer.mesh)
    held = of_handles.probed(bound, bound.rows.anchor(place), level, drag) if rules.reach == "part" else None
    if held is None:
        reach = PARTLESS_REACH if rules.reach == "part" else rules.reach
        weights: Float32 = bind(deformer.features, bound.rows.points([place]), reach=reach, falloff=rules.falloff)[:, 0]
    else:
        weights = held
    return weights - bound.by_features.subtracted(deformer.fixed) if deformer.fixed else weights


def _heat(weights: Float32, vertex: int | None = None, level: int = 0) -> ArrayAnswer:
    return messages.HeatMessage(vertex=vertex, level=level), {"values": quantized(weights)}


@request
def stays(session: Session, vertex: Index | None = None) -> ArrayAnswer:
    """Compute how strongly each vertex stays in place, if `vertex` is fixed too. Answer: `heat`."""
    deformer = session.deformer
    more = () if vertex is None else (Fixed(place_on(deformer.mesh, vertex)),)
    return _heat(deformer.bound.by_features.subtracted((*deformer.fixed, *more)), vertex)


@request
def preview(session: Session, handle: int, controls: Controls) -> ArrayAnswer:
    """Compute the weights that a handle would have with other controls. Answer: `heat`."""
    with _tried(session.deformer) as deformer:
        _change(session, handle, controls)
        return _heat(_following(deformer, handle))


@request
def propose(session: Session, handle: int) -> ArrayAnswer:
    """Pose the shape as if the handle had other controls: only its part, or a smaller or larger one.

    Proposals that move the same surface as the present controls, or as another proposal, are left out. Answer:
    `proposals`.
    """
    editing, deformer = session.require(), session.deformer
    mesh = deformer.mesh
    seen = [_following(deformer, handle)]
    found: list[messages.Proposal] = []
    arrays: Arrays = {}
    for label, controls in _proposals(editing, handle):
        with _tried(deformer), suppress(ValueError):
            _change(session, handle, Controls(**controls))
            weights = _following(deformer, handle)
            if any(float(np.abs(weights - other).mean()) < SAME_WEIGHTS * float(weights.mean()) for other in seen):
                continue
            seen.append(weights)
            posed, number = deformer.vertices, len(found)
            normals = updated_normals(mesh.normals, mesh.vertices, posed, mesh.faces)
            arrays |= {f"positions{number}": centered(mesh, posed), f"normals{number}": packed_normals(normals)}
            found.append(messages.Proposal(label=label, controls=controls))
    return messages.ProposalsMessage(handle=handle, proposals=tuple(found)), arrays


def _proposals(editing: Editing, handle: int) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the label and the controls of each proposal: who else may follow, and a smaller and a larger part."""
    own, parts = editing.deformer.edit.handle(handle), editing.parts
    if own.controls.reach != "part" or own.place.region is not None:
        return
    yield from ((label, {"follow": value}) for value, label in FOLLOWERS.items() if value != own.controls.follow)
    for step, label in ((-1, "Smaller"), (1, "Larger")):
        with suppress(ValueError):  # there is no such part
            yield label, {"level": parts.next_level(parts.origin(own), own.controls.level, step)}


def _following(deformer: Deformer, handle: int) -> Float32:
    """Return how much each vertex follows a handle, (V,)."""
    index = [each.id for each in deformer.handles].index(handle)
    found: Float32 = deformer.following[:, index]
    return found


@request
def ladder(session: Session, vertex: Index) -> messages.Answer:
    """Find the parts at a vertex from the smallest to the largest. Answer: `ladder`."""
    return messages.LadderMessage(vertex=vertex, steps=session.require().parts.ladder(vertex))


@request
def compute(session: Session, transforms: PoseTransforms | None = None) -> ArrayAnswer:
    """Compute the posed shape. Handles that `transforms` names have these transforms, all others those of the edit.

    Answer: `positions`. Only the newest `compute` is answered.
    """
    with _tried(session.deformer, transforms):
        posed, mesh = session.deformer.vertices, session.deformer.mesh
    normals = packed_normals(updated_normals(mesh.normals, mesh.vertices, posed, mesh.faces))
    return messages.PositionsMessage(), {"positions": centered(mesh, posed), "normals": normals}


@request
def features(session: Session) -> ArrayAnswer:
    """Compute colors of the vertices from three principal components of their features. Answer: `colors`."""
    colors = np.rint(feature_colors(session.deformer.features) * 255).astype(np.uint8)
    return messages.ColorsMessage(), {"colors": np.pad(colors, ((0, 0), (0, 1)), constant_values=255)}


@request
def counterparts(session: Session, handle: int) -> messages.Answer:
    """Find the counterparts of a handle, and whether each counterpart moves. Answer: `similar`."""
    places = (
        messages.SimilarPoint(vertex=int(each.vertex), position=vector("position", each.position), on=on)
        for each, on in session.deformer.counterparts(handle)
    )
    return messages.SimilarMessage(handle=handle, places=tuple(places))


@request
def axis(session: Session, handle: int) -> messages.Answer:
    """Find the possible pivots of a handle, and the axis along which the handle's part bends. Answer: `axis`."""
    edit = session.deformer.edit
    held = edit.handle(handle)
    part = next(iter(bendable_parts(session.deformer.bound, edit, held)), None)
    pivots: tuple[PivotAt, ...] = ("point",)
    auto, bends = held.place.position, None
    if part is not None:
        pivots += ("base", "middle", "hinge") if edit.symmetry is None else ("base", "middle", "hinge", "plane")
        if edit.rules.pivot == "auto":
            auto = pivot_on(part, None, held, edit.symmetry)[0]
        bends = _bend_axis(part)
    return messages.AxisMessage(handle=handle, pivots=pivots, auto=auto, bends=bends)


def _bend_axis(part: BendablePart) -> messages.BendAxis:
    axis, carry = part.axis, part.amount * part.carry
    nodes = axis.nodes if part.slender else np.stack([axis.base, axis.nodes[-1]])
    return messages.BendAxis(
        nodes=tuple(vector("axis", node) for node in nodes),
        radius=tuple(axis.radius.tolist()),
        slender=part.slender,
        carry=tuple(vector("carry", row) for row in carry),  # type: ignore[arg-type]
    )


@request
def add(session: Session, at: Place, level: int = 0) -> None:
    """Add a handle. At a vertex, it holds the part of the step `level` of `ladder`."""
    place = at if isinstance(at, int) else _decoded(session, at)
    session.change(lambda deformer: deformer.add(place, level=level))


@request
def take_part(
    session: Session, handle: int, how: PartChange, vertex: Index | None = None, preview: bool = False
) -> ArrayAnswer | None:
    """Change the part or region of a handle, and the mask if it is this part. "add" and "remove" need `vertex`.

    With `preview`, the edit stays unchanged, and the answer is `heat`: the weights that the handle would have.
    """
    parts, deformer = session.require().parts, session.deformer
    given = parts.taken(deformer.edit.handle(handle), how, vertex)
    if not preview:
        session.change(lambda deformer: deformer.change(handle, **given))
        return None
    with _tried(deformer):
        deformer.change(handle, **given)
        return _heat(_following(deformer, handle))


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

    Each `move` of a drag except the first has `merge`, so the drag is one step of undo. After a `move` with `merge`,
    the server sends `state` only if `controls` or the blend band change, or if `settle` is true. The last
    `move` of a drag has `settle`.
    """
    parts, changed = transform.model_dump(exclude_none=True), _controls(session, controls)
    if merge and not (settle or changed):
        deformer = session.deformer
        deformer.move(handle, **parts, merge=True)
        if session.require().has_close_weights():
            session.require().shown = deformer.edit  # the page has already drawn this edit
        else:
            session.tell_state()
        return

    def work(deformer: Any) -> None:
        deformer.move(handle, **parts)
        if changed:
            deformer.change(handle, **changed)

    session.change(work, ("handle", handle), merge=merge)  # same topic as `Deformer.move`: a drag is one undo step


@request
def pose(session: Session, transforms: PoseTransforms) -> None:
    """Set the transforms of several handles, as one step of undo."""
    session.change(lambda deformer: _move_all(deformer, transforms))


@request
def set_marks(session: Session, marks: messages.Marks, fit: bool = True, merge: bool = False) -> None:
    """Replace the marks. If `fit` is true, also move the handles so that the marks arrive at their targets.

    Only handles that move a mark are fitted. With `merge`, successive changes are one step of undo.
    """
    editing = session.require()

    def work(deformer: Deformer) -> None:
        before = editing.fit_warning
        warning = replace_marks(deformer, marks, fit)
        editing.fitted = deformer.edit, warning if fit else before

    session.change(work, "marks", merge=merge)


@request
def reset(session: Session, handle: int | None = None) -> None:
    """Reset the transform of a handle, or of all handles if `handle` is null, as one step of undo."""
    zero = (0.0, 0.0, 0.0)

    def work(deformer: Any) -> None:
        for each in [each.id for each in deformer.handles] if handle is None else [handle]:
            deformer.move(each, translation=zero, rotation=zero, scale=1.0, bend=zero, twist=0.0)

    session.change(work)


@request
def change(session: Session, handle: int, controls: Controls, merge: bool = False) -> None:
    """Set a handle's name or controls. With `merge`, successive changes are one step of undo.

    If the mask is the handle's part, it changes with the part.
    """
    session.change(lambda _: _change(session, handle, controls), ("change", handle), merge=merge)


def _change(session: Session, handle: int, controls: Controls) -> None:
    parts, deformer, given = session.require().parts, session.deformer, _controls(session, controls)
    limits = parts.limits(deformer.edit.handle(handle)) and "level" in given and "mask" not in given
    whole = limits or (isinstance(given.get("mask"), str) and given["mask"] == "part")
    first = {name: value for name, value in given.items() if name != "mask" or not whole}
    if first:
        deformer.change(handle, **first)
    if whole:
        deformer.change(handle, mask=parts.of(deformer.edit.handle(handle)))


@request
def remove(session: Session, handle: int) -> None:
    """Remove a handle."""
    session.change(lambda deformer: deformer.remove(handle))


@request
def fix(session: Session, at: Place) -> None:
    """Fix a point or a region, with all surface that looks like it."""
    session.change(lambda deformer: deformer.fix(_decoded(session, at)))


@request
def release(session: Session, index: Index) -> None:
    """Release the fixed point or region `fixed[index]` of `state`."""
    session.change(lambda deformer: deformer.release(_fixed(session, index).place))


@request
def change_fixed(
    session: Session, index: Index, strength: Annotated[float, Field(ge=0, le=1)], merge: bool = False
) -> None:
    """Set the strength of `fixed[index]` in `state`. With `merge`, successive changes are one step of undo."""
    changed = _fixed(session, index)
    after = tuple(replace(each, strength=strength) if each is changed else each for each in session.deformer.fixed)
    session.change(lambda deformer: deformer.apply(replace(deformer.edit, fixed=after)), ("fixed", index), merge=merge)


def _fixed(session: Session, index: int) -> Fixed:
    fixed = session.deformer.fixed
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
    """Set the plane of symmetry; null removes it. With `merge`, successive changes are one step of undo."""
    session.change(lambda deformer: deformer.set_symmetry(plane, band=band), "symmetry", merge=merge)


@request
def set_preset(session: Session, preset: Preset) -> None:
    """Set the preset, and set reach, falloff, counterparts and the plane's band to its values, in one undo step."""
    session.change(lambda deformer: setattr(deformer, "preset", preset))


@request
def set_default(session: Session, transform: Transform, merge: bool = False) -> None:
    """Replace D₀, the transform of vertices without weights. Null means no motion. `merge` is as in `set_symmetry`."""
    parts = transform.model_dump(exclude_none=True)
    session.change(lambda deformer: deformer.set_default(**parts), "default", merge=merge)


@request
def go(session: Session, by: int) -> None:
    """Redo the next `by` of the `steps` in `state`; undo if `by` is negative. Stop if no step is left."""
    session.require().history.go(by)
    session.tell_state()


@request
def clear(session: Session) -> None:
    """Remove all handles, fixed places and key poses, as one step of undo. The plane of symmetry stays."""
    session.change(lambda deformer: deformer.apply(replace(deformer.edit, handles=(), fixed=(), poses=())))


@request
def export(
    session: Session,
    format: exports.Kind,  # noqa: A002
    transforms: PoseTransforms | None = None,
) -> messages.Answer:
    """Write a file for download. Answer: `download`.

    `transforms` is the pose on the page if this pose differs from the edit. Three formats are GLB files with motion:
    "rig" has joints, "morph" has morph targets, and "animation" has an animation of the key poses.
    """
    deformer, number = session.deformer, secrets.token_hex(16)
    folder = session.folder / number
    folder.mkdir()
    try:
        with _tried(deformer, transforms):
            path, said = exports.export(deformer, format, session.name, folder)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    session.exports[number] = path
    return messages.DownloadMessage(url=f"download/{session.folder.name}/{number}", name=path.name, said=said)


class _TakenBackError(Exception):
    """Raised inside a step, so that the step discards its changes."""


@contextmanager
def _tried(deformer: Deformer, transforms: PoseTransforms | None = None) -> Iterator[Deformer]:
    """Set `transforms` of handles inside the `with` block. When the block ends, discard these and all other changes."""
    with suppress(_TakenBackError), deformer.step():
        _move_all(deformer, transforms or ())
        yield deformer
        raise _TakenBackError


def _move_all(deformer: Any, transforms: PoseTransforms) -> None:
    at_rest = {"pivot": "point", "axes": "auto", "joint": "spread"}
    for each in transforms:
        given = {name: at_rest[name] if part is None else part for name, part in each if name != "pivot_at"}
        deformer.move(**given)


def _decoded(session: Session, value: Any) -> Any:
    """Return the vertices (N,) of a `Region`, in ascending order. Return a value of another type unchanged."""
    if not isinstance(value, messages.Region):
        return value
    count = len(session.deformer.mesh.vertices)
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
    return {name: _decoded(session, value) for name, value in controls if value is not None}
