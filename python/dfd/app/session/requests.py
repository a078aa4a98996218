"""What a session does for each message of the page."""

from __future__ import annotations

import base64
import binascii
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from dfd.app.protocol import requests
from dfd.app.protocol.answers import (
    Alike,
    AlikeMessage,
    Answer,
    DoneMessage,
    DownloadMessage,
    ScriptMessage,
    Suggestion,
    SuggestionsMessage,
)
from dfd.app.protocol.parts import Controls, Place, PointPlace, RegionPlace, Transform, VertexPlace
from dfd.app.session.columns import heat_message
from dfd.app.session.exports import export
from dfd.app.session.script import as_command, as_python
from dfd.app.session.shapes import sample_source
from dfd.app.session.state import feature_colors_message, positions_message
from dfd.editing.edit import Fixed, empty_edit
from dfd.editing.edit_file import from_document
from dfd.editing.points import place_on
from dfd.editing.presets import CONTROLS
from dfd.editing.suggestions import suggest_handles
from dfd.symmetry.plane import SymmetryPlane

if TYPE_CHECKING:
    from dfd.app.session.session import Session
    from dfd.editing.deformer import Deformer
    from dfd.symmetry.plane import SymmetryPlane

__all__ = ["answer", "receive", "suggestions"]

TRANSFORM_PARTS = ("translation", "rotation", "scale", "pivot", "axes")


def receive(session: Session, message: requests.Request) -> None:
    """Do what the page asks, and answer; whatever goes wrong is said, and the session goes on."""
    session.answering(message.id, lambda: answer(session, message))


def answer(session: Session, message: requests.Request) -> None:
    """Do what `message` asks, and answer it.

    Raises
    ------
    ValueError, OSError, MemoryError
        If it cannot be done; nothing was changed then.
    """
    reply = _DO[type(message)](session, message)
    if isinstance(reply, bytes):
        session.send(reply)
    else:
        session.send((reply or DoneMessage()).model_copy(update={"id": message.id}))


# --- opening and making


def _open_sample(session: Session, message: requests.OpenSample) -> None:
    session.open_shape(sample_source(message.name))


def _close_mesh(session: Session, message: requests.CloseMesh) -> None:
    session.show_start()


def _distill(session: Session, message: requests.Distill) -> None:
    session.distill()


def _cancel(session: Session, message: requests.Cancel) -> None:
    session.cancel()


# --- looking


def _probe(session: Session, message: requests.Probe) -> bytes:
    deformer = session.living()
    place = place_on(deformer.mesh, _at(session, message.at))
    return heat_message(deformer, place, request=message.id)


def _compute(session: Session, message: requests.Compute) -> bytes:
    return positions_message(session.living(), request=message.id)


def _features(session: Session, message: requests.Features) -> bytes:
    return feature_colors_message(session.living(), request=message.id)


def _suggest(session: Session, message: requests.Suggest) -> Answer:
    return SuggestionsMessage(
        suggestions=suggestions(session.living(), message.count, session.looks.planes.get("default", ()))
    )


def _instances(session: Session, message: requests.Instances) -> Answer:
    places = []
    for instance, on in session.living().instances(message.handle):
        x, y, z = (float(value) for value in instance.position)
        places.append(Alike(vertex=int(instance.vertex), position=(x, y, z), weight=float(instance.weight), on=on))
    return AlikeMessage(handle=message.handle, places=tuple(places))


# --- handles


def _add(session: Session, message: requests.Add) -> Answer:
    at, parts = _at(session, message.at), _parts(message.transform)
    controls = _controls(session, message.controls)
    handle = session.change(lambda deformer: deformer.add(at, **parts, **controls))
    return DoneMessage(handle=handle)


def _move(session: Session, message: requests.Move) -> None:
    parts = _parts(message.transform)
    controls = _controls(session, message.controls)
    if message.merge and not (message.settle or controls):
        session.living().move(message.handle, **parts, merge=True)
        session.note_drag(message.handle)
        return

    def work(deformer: Deformer) -> None:
        if not controls:
            deformer.move(message.handle, **parts, merge=message.merge)
            return
        with deformer.step():
            deformer.move(message.handle, **parts)
            deformer.change(message.handle, **controls)

    session.change(work, ("move", message.handle), merge=message.merge and bool(controls))


def _pose(session: Session, message: requests.Pose) -> None:
    def work(deformer: Deformer) -> None:
        with deformer.step():
            for each in message.transforms:
                parts = {name: getattr(each, name) for name in TRANSFORM_PARTS}
                frame = {name: "auto" if parts[name] is None else parts[name] for name in ("pivot", "axes")}
                deformer.move(each.handle, **{**parts, **frame})

    session.change(work)


def _change(session: Session, message: requests.Change) -> None:
    options = _controls(session, message.controls)
    if message.at is not None:
        options["at"] = _at(session, message.at)
    topic = ("change", message.handle)
    session.change(lambda deformer: deformer.change(message.handle, **options), topic, merge=message.merge)


def _remove(session: Session, message: requests.Remove) -> None:
    session.change(lambda deformer: deformer.remove(message.handle))


def _reset(session: Session, message: requests.Reset) -> None:
    deformer = session.living()
    chosen = [handle.id for handle in deformer.handles] if message.handle is None else [message.handle]

    def work(deformer: Deformer) -> None:
        with deformer.step():
            for handle in chosen:
                deformer.move(handle, translation=(0, 0, 0), rotation=(0, 0, 0), scale=1.0)

    session.change(work)


# --- the whole shape


def _fix(session: Session, message: requests.Fix) -> None:
    at = _at(session, message.at)
    given = {} if message.strength is None else {"strength": message.strength}
    session.change(lambda deformer: deformer.fix(at, **given))


def _release(session: Session, message: requests.Release) -> None:
    fixed = _fixed(session, message.index)
    session.change(lambda deformer: deformer.release(fixed.place))


def _change_fixed(session: Session, message: requests.ChangeFixed) -> None:
    changed = replace(_fixed(session, message.index), strength=message.strength)

    def work(deformer: Deformer) -> None:
        before = deformer.fixed
        after = (*before[: message.index], changed, *before[message.index + 1 :])
        deformer.apply(replace(deformer.edit, fixed=after))

    session.change(work, ("fixed", message.index), merge=message.merge)


def _fixed(session: Session, index: int) -> Fixed:
    fixed = session.living().fixed
    if index >= len(fixed):
        raise ValueError(f"There is no fixed place {index}: there are {len(fixed)}")
    return fixed[index]


def _set_symmetry(session: Session, message: requests.SetSymmetry) -> None:
    plane: Any = message.plane
    if plane is not None and not isinstance(plane, str):
        plane = SymmetryPlane(plane.normal, plane.offset, band=plane.band)
    session.change(lambda deformer: deformer.set_symmetry(plane, band=message.band), "symmetry", merge=message.merge)


def _set_preset(session: Session, message: requests.SetPreset) -> None:
    session.change(lambda deformer: setattr(deformer, "preset", message.preset))


def _set_overlap(session: Session, message: requests.SetOverlap) -> None:
    session.change(lambda deformer: setattr(deformer, "overlap", message.mode))


def _set_blend(session: Session, message: requests.SetBlend) -> None:
    session.change(lambda deformer: setattr(deformer, "blend", message.mode))


def _set_default(session: Session, message: requests.SetDefault) -> None:
    parts = _parts(message.transform)
    session.change(lambda deformer: deformer.set_default(**parts), "default", merge=message.merge)


def _undo(session: Session, message: requests.Undo) -> None:
    session.walk(lambda deformer: deformer.undo())


def _redo(session: Session, message: requests.Redo) -> None:
    session.walk(lambda deformer: deformer.redo())


def _clear(session: Session, message: requests.Clear) -> None:
    session.change(lambda deformer: deformer.apply(empty_edit(deformer.preset)))


def _apply(session: Session, message: requests.Apply) -> None:
    edit = from_document(message.edit, session.living().mesh)
    session.change(lambda deformer: deformer.apply(edit))


def _set_poses(session: Session, message: requests.SetPoses) -> None:
    session.living()
    session.looks.poses = message.poses
    session.keep_poses()
    session.tell_state()


# --- taking along


def _export(session: Session, message: requests.Export) -> Answer:
    url, name = export(session.living(), message.format, session.name, session.folder, session.looks.poses)
    return DownloadMessage(url=url, name=name)


def _script(session: Session, message: requests.Script) -> Answer:
    deformer = session.living()
    return ScriptMessage(python=as_python(deformer, session.name), command=as_command(deformer, session.name))


# --- reading messages


def _at(session: Session, place: Place) -> Any:
    """What `Deformer` takes for a place."""
    if isinstance(place, VertexPlace):
        return place.vertex
    if isinstance(place, PointPlace):
        return place.point
    return _members(session, place)


def _members(session: Session, place: RegionPlace) -> Any:
    """The vertices of a region, in order."""
    count = len(session.living().mesh.vertices)
    try:
        data = base64.b64decode(place.mask, validate=True)
    except binascii.Error:
        raise ValueError("A region's mask must be bytes written as base64") from None
    if len(data) != -(-count // 8):
        raise ValueError(f"A region's mask must have {-(-count // 8)} bytes for {count} vertices, got {len(data)}")
    bits = np.unpackbits(np.frombuffer(data, np.uint8), count=count, bitorder="little")
    members = np.flatnonzero(bits)
    if len(members) == 0:
        raise ValueError("A region must hold at least one vertex")
    return members


def _parts(transform: Transform) -> dict[str, Any]:
    given = {name: getattr(transform, name) for name in TRANSFORM_PARTS}
    return {name: value for name, value in given.items() if value is not None}


def _controls(session: Session, controls: Controls) -> dict[str, Any]:
    """What `Deformer.add` and `Deformer.change` are told of `controls`."""
    given = {name: value for name, value in controls if value is not None and name != "more"}
    if isinstance(controls.within, RegionPlace):
        given["within"] = _members(session, controls.within)
    if controls.without_instances is not None:
        given["without_instances"] = list(controls.without_instances)
    for name in controls.more or {}:
        if name not in CONTROLS:
            raise ValueError(f"`{name}` is no control that this version has")
    return {**(controls.more or {}), **given}


_DO: dict[type[requests.Request], Callable[[Session, Any], Answer | bytes | None]] = {
    requests.OpenSample: _open_sample,
    requests.CloseMesh: _close_mesh,
    requests.Distill: _distill,
    requests.Cancel: _cancel,
    requests.Probe: _probe,
    requests.Compute: _compute,
    requests.Features: _features,
    requests.Suggest: _suggest,
    requests.Instances: _instances,
    requests.Add: _add,
    requests.Move: _move,
    requests.Pose: _pose,
    requests.Change: _change,
    requests.Remove: _remove,
    requests.Reset: _reset,
    requests.Fix: _fix,
    requests.Release: _release,
    requests.ChangeFixed: _change_fixed,
    requests.SetSymmetry: _set_symmetry,
    requests.SetPreset: _set_preset,
    requests.SetOverlap: _set_overlap,
    requests.SetBlend: _set_blend,
    requests.SetDefault: _set_default,
    requests.Undo: _undo,
    requests.Redo: _redo,
    requests.Clear: _clear,
    requests.Apply: _apply,
    requests.SetPoses: _set_poses,
    requests.Export: _export,
    requests.Script: _script,
}


def suggestions(deformer: Deformer, count: int, planes: Sequence[SymmetryPlane]) -> tuple[Suggestion, ...]:
    """At most `count` places, one for each kind of part; `planes` are those across which the shape looks alike."""
    found = []
    places = suggest_handles(deformer.mesh, deformer.features, count=count, planes=planes, finder=deformer.bound.finder)
    for index, each in enumerate(places):
        alike = f", {len(each.instances)} alike" if len(each.instances) > 1 else ""
        position: Any = tuple(float(x) for x in deformer.mesh.vertices[each.vertex])
        found.append(
            Suggestion(
                vertex=each.vertex,
                position=position,
                name=f"Part {index + 1}{alike}",
                group=index,
                share=each.share,
            )
        )
    return tuple(found)
