"""For a shape with a field, collect the data that the page shows: the handles and their columns of weights."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from hashlib import sha256
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfd.app.protocol import messages
from dfd.app.session.marks import marks_of
from dfd.app.session.parts import ShapeParts
from dfd.app.session.steps import Steps
from dfd.common.linear_algebra import Float32, Float64
from dfd.common.preset import Preset
from dfd.editing import verbs
from dfd.editing.deformer import Deformer
from dfd.editing.edit import Edit, Handle, band_on, box_center
from dfd.editing.presets import PARTLESS_REACH
from dfd.editing.regions import Region, members
from dfd.editing.weights.fill import Band
from dfd.mesh.mesh import Mesh
from dfd.posing.transforms import Transform, vector
from dfd.symmetry.plane import SymmetryPlane

CLOSE = 1.2  # during a drag, the page gets new weights if the width of a blend band changes by more than this factor
UINT16_MAX = 65535  # the quantized weight that stands for 1
LARGEST = 1e30  # largest entry of a transform's matrix; shaders multiply the matrix by coordinates in 32-bit floats

ColumnStates = tuple[messages.ColumnState, ...]


class Editing:
    """A shape with a field: its editing session, parts and planes of symmetry, and the columns that the page has."""

    def __init__(self, deformer: Deformer) -> None:
        self.deformer, self.parts = deformer, ShapeParts(deformer)
        self.planes: Mapping[Preset, Sequence[SymmetryPlane]] = {}  # planes of symmetry, by preset
        self.history = Steps(deformer)
        self.shown: Edit | None = None  # the edit that the page shows
        self.fitted: tuple[Edit | None, str | None] = None, None  # the edit of the newest fit, and its warning
        self.unreported = False  # whether the report of the edit must still be sent
        self.pointed: tuple[int, int] | None = None  # the vertex and level of the latest probe, until `exact_probe`
        self.suggesting = False  # whether suggestions were asked for
        self.suggested: tuple[messages.Suggestion, ...] | None = None  # None until they are found
        self.sent: dict[bytes, int] = {}  # identifiers of the columns that the page has, by the hash of the weights
        self._count = 0  # number of columns that have been sent
        self._bands: list[Band] = []  # the blend bands of the columns that the page has
        self._edit: Edit | None = None  # the edit for which the bands were compared last

    @property
    def fit_warning(self) -> str | None:
        """Return what the newest fit warned of; None if the edit has changed since."""
        edit, warning = self.fitted
        return warning if edit is self.deformer.edit else None

    def exact_probe(self) -> tuple[int, int, Float32] | None:
        """Return the vertex and level of the latest probe, and the weights (V,) that a new handle there has at rest.

        The caller has no other request to answer, because the part of a handle takes longer than a probe. A click there
        then needs less time. Return None if there was no new probe, or the place cannot have a handle.
        """
        pointed, self.pointed = self.pointed, None
        if pointed is not None:
            with suppress(ValueError):  # for example, the place has a handle already
                return *pointed, self.resting_weights(*pointed)
        return None

    def resting_weights(self, at: Any, level: int) -> Float32:
        """Return the weights (V,) that the page shows for a new handle. Raises ValueError as `Deformer.add` does."""
        before, bound = self.deformer.edit, self.deformer.bound
        number = 1 + max((handle.id for handle in before.handles), default=0)
        edit = verbs.add(before, bound, number, at, name=None, level=level)
        weights, columns = bound.columns(edit, self._bands_shown_in(edit))
        own = [i for i, column in enumerate(columns) if column.handle == len(before.handles)]
        found: Float32 = weights[:, own].sum(axis=1)
        return found

    def has_stale_bands(self) -> bool:
        """Return whether the page's columns have other blend bands than those of the present edit."""
        edit, before = self.deformer.edit, self._edit
        self._edit = edit
        return edit is not before and self._bands != self._bands_shown_in(edit)

    def columns(self) -> tuple[list[ColumnStates], dict[int, NDArray[np.uint16]]]:
        """Return the weight columns of each handle, and a dict from the identifiers of new columns to values (V,).

        The page does not have the new columns yet. The caller must send them, because `sent` now contains them.
        """
        self._edit = self.deformer.edit
        self._bands = self._bands_shown_in(self._edit)
        weights, columns = self.deformer.bound.columns(self.deformer.edit, self._bands)
        handles, before, new = self.deformer.handles, self.sent, {}
        states: list[ColumnStates] = [() for _ in handles]
        self.sent = {}
        for values, column in zip(quantized(weights.T), columns, strict=True):
            key = sha256(values.tobytes()).digest()
            identifier = self.sent.get(key) or before.get(key)
            if identifier is None:
                self._count = identifier = self._count + 1
                new[identifier] = values
            self.sent[key] = identifier
            frame: Any = tuple(map(tuple, column.counterpart.frame.tolist()))
            state = messages.ColumnState(column=identifier, frame=frame, position=column.counterpart.position)
            states[column.handle] += (state,)
        return states, new

    def _bands_shown_in(self, edit: Edit) -> list[Band]:
        """Return the blend bands of all columns of `edit`. Handles at rest have the bands of a short drag."""
        if edit.default is not None:
            return self.deformer.bound.bands(edit)
        drag = Transform(translation=vector("drag", short_drag(self.deformer.mesh)[:, 3]))
        moved = (replace(each, transform=drag) if each.transform.rests else each for each in edit.handles)
        return self.deformer.bound.bands(edit, replace(edit, handles=tuple(moved)))

    def has_close_weights(self) -> bool:
        """Return whether the blend bands of the page's columns are nearly those of the present edit."""
        now = self.deformer.bound.bands(self.deformer.edit)
        if len(self._bands) != len(now):
            return False
        shown, present = np.array(self._bands), np.array(now)
        return bool((np.maximum(shown, present) <= CLOSE * np.minimum(shown, present)).all())

    def state(self, columns: Sequence[ColumnStates], **common: Any) -> messages.StateMessage:
        """Return the state. `columns` has the columns of each handle, and `common` has other fields of the state."""
        deformer, mesh, default = self.deformer, self.deformer.mesh, self.deformer.default
        if default is not None and default.pivot is None:
            default = replace(default, pivot=box_center(mesh))
        steps = self.history.names()
        return messages.StateMessage(
            handles=tuple(map(self._handle, deformer.handles, columns)),
            fixed=tuple(
                messages.FixedState(
                    vertex=fixed.place.vertex,
                    position=fixed.place.position,
                    strength=fixed.strength,
                    region=self._size(fixed.place.region),
                )
                for fixed in deformer.fixed
            ),
            symmetry=deformer.symmetry,
            planes=tuple(
                replace(plane, band=band_on(mesh, deformer.preset)) for plane in self.planes.get(deformer.preset, ())
            ),
            default=None if default is None else messages.PoseTransform.of(0, default),
            poses=tuple(
                messages.KeyPose(
                    name=pose.name,
                    seconds=pose.seconds,
                    ease=pose.ease,
                    transforms=tuple(messages.PoseTransform.of(*each) for each in pose.transforms.items()),
                )
                for pose in deformer.edit.poses
            ),
            marks=marks_of(deformer),
            fitted=self.fit_warning,
            steps=steps,
            step=self.history.done,
            **{**common, "preset": deformer.preset},
        )

    def _handle(self, handle: Handle, columns: ColumnStates) -> messages.HandleState:
        place, transform, controls = handle.place, handle.transform, handle.controls
        excluded = (place.vertex for place in controls.excluded_counterparts)
        values = vars(handle) | vars(place) | vars(transform) | vars(controls)
        values |= {
            "handle": handle.id,
            "pivot": handle.pivot,
            "pivot_set": transform.pivot is not None,
            "reach": PARTLESS_REACH if controls.reach == "part" else controls.reach,
            "origin": self.parts.origin(handle),
            "reach_by": controls.reach if isinstance(controls.reach, str) else "number",
            "excluded_counterparts": tuple(vertex for vertex in excluded if vertex is not None),
            "mask": self._size(controls.mask),
            "mask_part": self.parts.limits(handle),
            "region": self._size(place.region),
            "columns": columns,
            "moved": not transform.rests,
        }
        return messages.HandleState(**{name: values[name] for name in messages.HandleState.model_fields})

    def _size(self, region: Region | None) -> int:
        return 0 if region is None else len(members(self.deformer.mesh, region))

    def check_drawable(self) -> None:
        """Raise ValueError if a number in a transform's matrix exceeds 1e30, or the edit has no valid weights."""
        deformer = self.deformer
        matrices = {f"handle {handle.id}": handle.matrix for handle in deformer.handles}
        if deformer.default is not None:
            matrices["the rest of the shape"] = deformer.default.matrix(box_center(deformer.mesh))
        for name, matrix in matrices.items():
            size = float(np.abs(matrix).max())
            if size > LARGEST:
                raise ValueError(f"The transform of {name} must stay below {LARGEST:g}, got {size:.3g}")
        deformer.bound.columns(deformer.edit)


def short_drag(mesh: Mesh) -> Float64:
    """Return the matrix (3, 4) of a drag by 5 % of the shape's size. For parts at rest, the page shows its weights."""
    return np.column_stack([np.eye(3), np.full(3, mesh.diagonal / 20 / 3**0.5)])


def quantized(weights: Float32) -> NDArray[np.uint16]:
    """Return weights in [0, 1], multiplied by 65535 and rounded."""
    return np.rint(weights * np.float32(UINT16_MAX)).clip(0, UINT16_MAX).astype(np.uint16)
