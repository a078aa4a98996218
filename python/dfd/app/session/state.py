"""The present state of a session, as the page shows it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from dataclasses import field as dataclass_field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dfd.app.protocol.answers import FieldState, FixedState, HandleState, NewHandle, ReportMessage, StateMessage
from dfd.app.protocol.binary_messages import ColorsMessage, PositionsMessage, pack
from dfd.app.protocol.parts import KeyPose, Plane, PoseTransform
from dfd.app.session.columns import Columns
from dfd.app.session.surface import center_of, packed_normals
from dfd.common.preset import Preset
from dfd.editing.edit import band_on, box_center
from dfd.editing.influence.regions import members
from dfd.editing.presets import PARTLESS_REACH, PRESETS
from dfd.mesh.normals import smooth_normals
from dfd.pictures.colors import feature_colors
from dfd.symmetry.plane import axis_name
from dfd.weights.compact import CompactFeatures

if TYPE_CHECKING:
    from dfd.editing.deformer import Deformer
    from dfd.editing.edit import Handle
    from dfd.editing.points import Place
    from dfd.posing.transforms import Transform
    from dfd.symmetry.plane import SymmetryPlane

__all__ = [
    "ViewState",
    "check_drawable",
    "feature_colors_message",
    "positions_message",
    "report",
    "state_message",
]

NO_FIELD = FieldState(status="none", origin=None)


@dataclass
class ViewState:
    """The parts of a state message that are not the edit."""

    field: FieldState = NO_FIELD
    planes: Mapping[Preset, Sequence[SymmetryPlane]] = dataclass_field(default_factory=dict)  # by each preset's rules
    poses: tuple[KeyPose, ...] = ()


def state_message(
    view_state: ViewState, deformer: Deformer | None = None, columns: Columns | None = None, *, after: int
) -> StateMessage:
    """The state of an editing session, or of a shape without a field, which cannot be edited yet."""
    common: dict[str, Any] = {"after": after, "field": view_state.field, "poses": view_state.poses}
    if deformer is None or columns is None:
        overlap, blend = PRESETS["default"].overlap, PRESETS["default"].blend
        return StateMessage(preset="default", new_handle=_new_handle("default"), overlap=overlap, blend=blend, **common)
    mesh, preset = deformer.mesh, deformer.preset
    return StateMessage(
        handles=tuple(_handle(deformer, columns, handle) for handle in deformer.handles),
        fixed=tuple(
            FixedState(
                vertex=fixed.vertex,
                position=fixed.position,
                strength=fixed.strength,
                region=_region_size(deformer, fixed.place),
            )
            for fixed in deformer.fixed
        ),
        fixed_column=columns.of_fixed(),
        symmetry=None if deformer.symmetry is None else _plane(deformer.symmetry),
        planes=tuple(_plane(replace(plane, band=band_on(mesh, preset))) for plane in view_state.planes.get(preset, ())),
        default=None if deformer.default is None else _default(deformer.default, box_center(mesh)),
        preset=preset,
        new_handle=_new_handle(preset),
        overlap=deformer.overlap,
        blend=deformer.blend,
        posing="shader" if (deformer.overlap, deformer.blend) == ("add", "linear") else "server",
        can_undo=deformer.can_undo,
        can_redo=deformer.can_redo,
        **common,
    )


def _new_handle(preset: Preset) -> NewHandle:
    reach, falloff = PRESETS[preset].reach, PRESETS[preset].falloff
    return NewHandle(reach=PARTLESS_REACH if isinstance(reach, str) else reach, falloff=falloff)


def _handle(deformer: Deformer, columns: Columns, handle: Handle) -> HandleState:
    transform, controls = handle.transform, handle.controls
    bound, edit = deformer.bound, deformer.edit
    same = ("falloff", "locality", "radius", "strength", "instances", "level", "within_width")
    return HandleState(
        handle=handle.id,
        name=handle.name,
        vertex=handle.place.vertex,
        position=handle.place.position,
        translation=transform.translation,
        rotation=transform.rotation,
        scale=transform.scale,
        pivot=handle.pivot,
        own_pivot=transform.pivot is not None,
        axes=transform.axes,
        reach=bound.reach(handle),
        exponent=bound.locality(edit, handle)[2],
        without_instances=tuple(place.vertex for place in controls.without_instances if place.vertex is not None),
        within=0 if controls.within is None else len(members(deformer.mesh, controls.within)),
        region=_region_size(deformer, handle.place),
        gain=bound.gain(edit, handle),
        column=columns.of_handle(handle),
        moved=not transform.rests,
        **{name: getattr(controls, name) for name in same},
    )


def _region_size(deformer: Deformer, place: Place) -> int:
    return 0 if place.region is None else len(members(deformer.mesh, place.region))


def _plane(plane: SymmetryPlane) -> Plane:
    return Plane(
        normal=plane.normal,
        offset=plane.offset,
        band=plane.band,
        score=plane.score or None,
        name=axis_name(plane.normal) or None,
    )


def _default(transform: Transform, center: tuple[float, float, float]) -> PoseTransform:
    return PoseTransform(
        handle=0,
        translation=transform.translation,
        rotation=transform.rotation,
        scale=transform.scale,
        pivot=center if transform.pivot is None else transform.pivot,
    )


def positions_message(deformer: Deformer, *, request: int) -> bytes:
    """The answer to `compute`."""
    posed = deformer.vertices
    normals = smooth_normals(posed, deformer.mesh.faces)
    arrays: dict[str, NDArray[Any]] = {
        "positions": (posed - center_of(deformer.mesh)).astype(np.float32),
        "normals": packed_normals(normals),
    }
    return pack(PositionsMessage, arrays, id=request)


def feature_colors_message(deformer: Deformer, *, request: int) -> bytes:
    """The answer to `features`, with the colors of `dfd.pictures`."""
    features = deformer.features
    colors = feature_colors(features.principal(3) if isinstance(features, CompactFeatures) else features)
    packed = np.full((len(colors), 4), 255, np.uint8)
    packed[:, :3] = np.rint(colors * 255)
    return pack(ColorsMessage, {"colors": packed}, id=request)


LARGEST = 1e30  # shaders multiply it with coordinates in 32-bit floats


def check_drawable(deformer: Deformer) -> None:
    """Reject transforms that the page could not draw.

    Raises ValueError if a number of a handle's transform, mesh units, is beyond 1e30.
    """
    for handle in deformer.handles:
        size = float(np.abs(handle.matrix).max())
        if size > LARGEST:
            raise ValueError(f"The transform of handle {handle.id} must stay below {LARGEST:g}, got {size:.3g}")


def report(deformer: Deformer) -> ReportMessage:
    """How much moved, how far, and whether the handles reached their targets."""
    if not deformer.handles and deformer.default is None:
        return ReportMessage(moved=0.0, text="Nothing has moved")
    found = deformer.report()
    text = str(found)
    return ReportMessage(
        moved=found.moved,
        text=text[:1].upper() + text[1:],
    )
