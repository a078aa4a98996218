"""Messages with the present state of a session."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from dfd.app.protocol import parts
from dfd.app.protocol.answers import ColumnState, FieldState, FixedState, HandleState, ReportMessage, StateMessage
from dfd.app.protocol.binary_messages import ColorsMessage, PositionsMessage, pack
from dfd.app.protocol.parts import KeyPoses, PoseTransform
from dfd.app.session.columns import Columns
from dfd.app.session.parts import ShapeParts
from dfd.app.session.surface import center_of, packed_normals
from dfd.common.preset import Preset
from dfd.editing.controls import CONTROLS
from dfd.editing.edit import band_on, box_center
from dfd.editing.influence.regions import Region, members
from dfd.mesh.normals import updated_normals
from dfd.pictures.colors import feature_colors

if TYPE_CHECKING:
    from dfd.editing.deformer import Deformer
    from dfd.editing.edit import Edit, Fixed, Handle
    from dfd.mesh.mesh import Mesh
    from dfd.posing.transforms import Transform
    from dfd.symmetry.plane import SymmetryPlane

# Fields of a handle's transform that the state has under the same name; the state's `pivot` is a position instead.
MOTION = (*(name for name in parts.Transform.model_fields if name != "pivot"), "pivot_at")
NO_FIELD = FieldState(status="none", origin=None)


class Editing:
    """A shape with a field: its editing session, columns, parts and planes."""

    def __init__(self, deformer: Deformer) -> None:
        self.deformer, self.columns, self.parts = deformer, Columns(deformer), ShapeParts(deformer)
        self.planes: Mapping[Preset, Sequence[SymmetryPlane]] = {}  # planes of symmetry, by preset
        self.shown: Edit | None = None  # the edit that the page shows
        self.unreported = False  # whether the report of the edit must still be sent


def state_message(field: FieldState, poses: KeyPoses, editing: Editing | None, *, after: int) -> StateMessage:
    """Return the state of a shape; `editing` is None without a field."""
    if editing is None:
        return StateMessage(preset="default", field=field, poses=poses, after=after)
    deformer = editing.deformer
    mesh, preset = deformer.mesh, deformer.preset
    return StateMessage(
        handles=tuple(
            _handle(deformer, handle, editing.columns.of_handle(index), editing.parts)
            for index, handle in enumerate(deformer.handles)
        ),
        fixed=tuple(_fixed(mesh, fixed) for fixed in deformer.fixed),
        symmetry=deformer.symmetry,
        planes=tuple(replace(plane, band=band_on(mesh, preset)) for plane in editing.planes.get(preset, ())),
        default=None if deformer.default is None else _default(deformer.default, box_center(mesh)),
        preset=preset,
        can_undo=deformer.can_undo,
        can_redo=deformer.can_redo,
        field=field,
        poses=poses,
        after=after,
    )


def _handle(deformer: Deformer, handle: Handle, columns: tuple[ColumnState, ...], parts: ShapeParts) -> HandleState:
    transform, controls = handle.transform, handle.controls
    values = {
        **{name: getattr(transform, name) for name in MOTION},
        **{name: getattr(controls, name) for name in CONTROLS},
        "reach": deformer.bound.by_features.reach(handle),
        "excluded_counterparts": tuple(
            place.vertex for place in controls.excluded_counterparts if place.vertex is not None
        ),
        "mask": _size(deformer.mesh, controls.mask),
    }
    return HandleState(
        handle=handle.id,
        name=handle.name,
        vertex=handle.place.vertex,
        position=handle.place.position,
        pivot=handle.pivot,
        pivot_set=transform.pivot is not None,
        reach_by=controls.reach if isinstance(controls.reach, str) else "number",
        mask_part=parts.limits(handle),
        region=_size(deformer.mesh, handle.place.region),
        columns=columns,
        moved=not transform.rests,
        **values,
    )


def _fixed(mesh: Mesh, fixed: Fixed) -> FixedState:
    region = _size(mesh, fixed.place.region)
    return FixedState(vertex=fixed.vertex, position=fixed.position, strength=fixed.strength, region=region)


def _size(mesh: Mesh, region: Region | None) -> int:
    return 0 if region is None else len(members(mesh, region))


def _default(transform: Transform, center: tuple[float, float, float]) -> PoseTransform:
    motion = {name: getattr(transform, name) for name in ("translation", "rotation", "scale")}
    return PoseTransform(handle=0, pivot=center if transform.pivot is None else transform.pivot, **motion)


def positions_message(deformer: Deformer, *, request: int) -> bytes:
    """Return the answer to `compute`."""
    posed, mesh = deformer.vertices, deformer.mesh
    normals = updated_normals(mesh.normals, mesh.vertices, posed, mesh.faces)
    positions = (posed - center_of(deformer.mesh)).astype(np.float32)
    return pack(PositionsMessage(id=request), positions=positions, normals=packed_normals(normals))


def feature_colors_message(deformer: Deformer, *, request: int) -> bytes:
    """Return the answer to `features`, with the colors of `dfd.pictures`."""
    features = deformer.features
    colors = feature_colors(features)
    packed = np.full((len(colors), 4), 255, np.uint8)
    packed[:, :3] = np.rint(colors * 255)
    return pack(ColorsMessage(id=request), colors=packed)


LARGEST = 1e30  # largest number of a transform, because shaders multiply it by coordinates in 32-bit floats


def check_drawable(deformer: Deformer) -> None:
    """Raise ValueError if the page cannot draw a transform: if a number of it, in mesh units, exceeds 1e30."""
    matrices = {f"handle {handle.id}": handle.matrix for handle in deformer.handles}
    if deformer.default is not None:
        matrices["the rest of the shape"] = deformer.default.matrix(box_center(deformer.mesh))
    for name, matrix in matrices.items():
        size = float(np.abs(matrix).max())
        if size > LARGEST:
            raise ValueError(f"The transform of {name} must stay below {LARGEST:g}, got {size:.3g}")


def report(deformer: Deformer) -> ReportMessage:
    """Return the report: how much moved, how far, and whether the handles reached their targets."""
    text = str(deformer.report())
    return ReportMessage(text=text[:1].upper() + text[1:])
