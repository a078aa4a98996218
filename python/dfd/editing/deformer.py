"""The editing session: handles that stay live, fixed points, symmetry, undo, and the posed shape at any moment."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from importlib import import_module
from typing import TYPE_CHECKING, Any, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dfd.common import check
from dfd.common.preset import Preset
from dfd.editing.compatibility import check_compatible
from dfd.editing.controls import Falloff, Instances, controls_of, controls_on
from dfd.editing.door import door
from dfd.editing.edit import Edit, Handle, edit_on, empty_edit
from dfd.editing.edit_file import read_edit, write_edit
from dfd.editing.influence.handle_weights import HandleWeights
from dfd.editing.influence.regions import Region, VertexSet
from dfd.editing.points import Place, place_on
from dfd.editing.report import Report, report
from dfd.editing.shape import PosedShape
from dfd.editing.whole_shape import WholeShape
from dfd.mesh.mesh import MeshLike, as_mesh
from dfd.posing.transforms import Along, Transform
from dfd.weights.compact import CompactFeatures

if TYPE_CHECKING:
    from dfd.field.field import Field
    from dfd.segmentation.parts import Level

__all__ = ["Deformer"]

# What shows a session in a page: a later room, looked up by name when somebody asks for it.
PAGE = "dfd.app"


class Deformer(WholeShape):
    """One editing session of one shape.

    Nothing is ever baked: every handle keeps the numbers it was given and can be changed or removed at any time, and
    `vertices` always follows from the resting mesh. Every change is a step that `undo` takes back, without limit. A new
    handle costs one column of weights, a frame of a drag what the handles that move cost, however many others rest.

    Parameters
    ----------
    mesh
        The resting shape, or whatever `dfd.load` makes one of; it is never changed.
    field
        The shape's feature field, or that of another resolution of the same shape.
    preset
        What the session and its handles start with (`dfd.editing.presets.PRESETS`): "default", or "paper" for Eq. 1
        and 4 to 8 to the letter. Whatever is said of a handle or set of the session goes before it.
    features
        (V, D) features of the vertices when they are at hand, in full or as `dfd.compact` makes them; the field is then
        asked for points in space alone. Otherwise it is asked once they are needed, above 16,384 vertices for compact
        ones, whose weights are within 0.01 of exact, judged by a sample (`features.error`); full ones never exist.

    Raises
    ------
    ValueError
        If there is no such preset, or `features` is not finite or not one row of the field's width per vertex; without
        `features`, if the field's shape was of another size, below half or above twice the mesh's, or lay elsewhere.

    Warns
    -----
    UserWarning
        If a part of the mesh lies far outside the box of the field's shape.
    """

    def __init__(self, mesh: MeshLike, field: Field, *, preset: Preset = "default", features: Any = None) -> None:
        mesh = as_mesh(mesh)
        with door("Deformer"):
            start = empty_edit(preset)
        self.mesh = mesh
        self.field = field
        if features is None:
            with door("Deformer"):
                check_compatible(field, mesh)
        self._weights = HandleWeights(mesh, field, features)
        self._posed = PosedShape(mesh, self._weights)
        self._start(start)

    def __repr__(self) -> str:
        """Say how much is being done to what."""
        return f"Deformer({self.mesh!r}, {len(self.handles)} handles, {len(self.fixed)} fixed points)"

    # --- handles

    def add(
        self,
        at: Any,
        *,
        translation: ArrayLike | None = None,
        rotation: ArrayLike | None = None,
        scale: ArrayLike | None = None,
        pivot: ArrayLike | None = None,
        axes: ArrayLike | None = None,
        reach: float | str | None = None,
        falloff: Falloff | None = None,
        locality: float | None = None,
        radius: float | str | None = None,
        strength: float | None = None,
        instances: Instances | None = None,
        level: bool | None = None,
        without_instances: Sequence[Any] | None = None,
        within: Region | ArrayLike | str | None = None,
        within_width: float | str | None = None,
        name: str | None = None,
    ) -> int:
        """Take hold of the shape and return the new handle's id.

        Parameters
        ----------
        at
            A vertex index; any point (3,) in mesh units, on the surface or off it; an array of vertex indices or a
            mask (V,), or a region of `dfd.editing.influence.regions`, all of which is held; a text, see
            `dfd.editing.points.find`, or "part@1,2,3" for the part that holds a place, "piece@812" for that part
            without its look-alikes.
        translation
            (3,) in mesh units.
        rotation
            (3,) rotation vector in degrees (axis times angle, right-handed), or a quaternion (x, y, z, w).
        scale
            One factor, or (3,) along `axes`, before the rotation.
        pivot
            (3,) in mesh units, about which it turns and scales; its own position if left out, the center of a region.
        axes
            (3, 3) orthonormal vectors, one a row, along which it scales; "normal" for a frame whose third vector is the
            surface's normal at the handle, "limb" for one whose third vector runs along the limb there, so that
            (1.5, 1.5, 1) makes it thicker and not longer, each instance along its own; the mesh's own if left out.
        reach
            Feature distance at which the weight is 0; less takes fewer look-alikes along, "auto" stops at the largest
            gap of the distances, "part" holds the part that the handle is on. If left out the preset's, as those of
            `falloff` and `instances`.
        falloff
            The curve from the handle to the end of its reach, by the names of `dfd.bind`.
        locality
            λ of Eq. 7: 0 reaches everything that looks alike, more stays nearer.
        radius
            In place of `locality`: the distance over the surface at which the weight is smoothly 0, in mesh units or as
            "20%" of the diagonal of the box.
        strength
            In [0, 1], a factor for all of its weights; 1 if left out.
        instances
            "own": each look-alike moves about its own counterpart of the pivot, mirrored where a plane of symmetry lies
            between; "together": all move about the one pivot; "only": this one alone.
        level
            Whether all instances follow as fully as the handle's own.
        without_instances
            Those that do not move along: vertices, points or texts as `at` takes them, one on each. Of those
            that `instances` lists any but the first, the handle's own, which always moves.
        within
            A region, as `at` takes one, beyond which nothing follows; "part" for the part that the handle is on.
        within_width
            How far beyond it the weight falls smoothly to 0, given as `radius` is; 0 if left out.
        name
            For people.

        Raises
        ------
        ValueError
            If a number is not finite, of another shape or out of its range, a name is unknown, a region is empty, a
            point lies farther from the shape than the diagonal of its box, the place is taken, or fixed points leave
            nothing of the handle.
        """
        with door("Deformer.add"):
            place = place_on(self.mesh, self._part_named(at))
            within = self._part_named(within, place)
            transform = self._transform(Transform(), place, translation, rotation, scale, pivot, axes)
            handle = Handle(
                self._next_id,
                place,
                transform,
                controls_of(self.preset).changed(**controls_on(self.mesh, locals())),
                name,
            )
            self._commit(replace(self.edit, handles=(*self.handles, handle)))
        self._next_id += 1
        return handle.id

    def move(
        self,
        handle: int,
        *,
        translation: ArrayLike | None = None,
        rotation: ArrayLike | None = None,
        scale: ArrayLike | None = None,
        pivot: ArrayLike | None = None,
        axes: ArrayLike | None = None,
        merge: bool = False,
    ) -> None:
        """Set parts of a handle's transform, always from the resting shape; what is left out stays. Nothing is rebound.

        Parameters
        ----------
        handle
            The handle's id.
        translation, rotation, scale
            As in `add`.
        pivot, axes
            As in `add`; "auto" returns them to the handle's position and the mesh's axes.
        merge
            Join the step before if that one moved the same handle: a drag is one plain move and then merged ones, and
            `undo` takes it back whole.

        Raises
        ------
        ValueError
            If there is no such handle, or a number is not finite or of another shape.
        """
        with door("Deformer.move"):
            held = self.edit.handle(handle)
            moved = self._transform(held.transform, held.place, translation, rotation, scale, pivot, axes)
            self._commit_move(self.edit.replaced(replace(held, transform=moved)), handle, merge)

    def change(
        self,
        handle: int,
        *,
        at: Any = None,
        reach: float | str | None = None,
        falloff: Falloff | None = None,
        locality: float | None = None,
        radius: float | str | None = None,
        strength: float | None = None,
        instances: Instances | None = None,
        level: bool | None = None,
        without_instances: Sequence[Any] | None = None,
        within: Region | ArrayLike | str | None = None,
        within_width: float | str | None = None,
        name: str | None = None,
    ) -> None:
        """Set where a handle is, what follows it, or its name, as in `add`; what is left out stays.

        Of `radius` and `locality` the one that is given ends the other; `within="everywhere"` takes the limit away, and
        `without_instances=[]` switches all on.

        Raises
        ------
        ValueError
            As in `add`, or if there is no such handle.
        """
        with door("Deformer.change"):
            held = self.edit.handle(handle)
            place = held.place if at is None else place_on(self.mesh, self._part_named(at))
            within = self._part_named(within, place)
            transform, along = held.transform, held.transform.along
            if place != held.place and along is not None:
                axes = self._weights.axes(place, along)
                transform = transform if axes is None else transform.changed(axes=axes, along=along)
            changed = replace(
                held,
                place=place,
                transform=transform,
                controls=held.controls.changed(**controls_on(self.mesh, locals())),
                name=held.name if name is None else name,
            )
            self._commit(self.edit.replaced(changed))

    def remove(self, handle: int) -> None:
        """Let go of a handle.

        Raises
        ------
        ValueError
            If there is no such handle.
        """
        with door("Deformer.remove"):
            held = self.edit.handle(handle)
            self._commit(replace(self.edit, handles=tuple(other for other in self.handles if other is not held)))

    def apply(self, edit: Edit) -> None:
        """Replace everything by `edit`, as one step; `Edit()` clears the session.

        Its preset is the session's from then on.

        Raises
        ------
        ValueError
            If a vertex of `edit` is none of the mesh, or a region of it is empty there.
        """
        with door("Deformer.apply"):
            self._commit(edit_on(self.mesh, edit))
        self._next_id = max(self._next_id, 1 + max((handle.id for handle in edit.handles), default=0))

    def part(self, at: Any, *, level: Level = "part", alike: bool = True) -> VertexSet:
        """Find the part of the shape that holds a place: a region for `add`, `fix` and `within`.

        Parameters
        ----------
        at
            As in `add`; of a region, the part that its middle is on.
        level, alike
            As in `dfd.Parts.part`.

        Raises
        ------
        ValueError
            If `at` is no place, or the mesh has no face with an area.
        """
        with door("Deformer.part"):
            vertex = self._weights.anchor(Handle(0, place_on(self.mesh, at)))
            return VertexSet.of(self.mesh, self._weights.parts.part(vertex, level, alike=alike).mask)

    def _part_named(self, at: Any, own: Place | None = None) -> Any:
        """`at`, or the part that it names: "part@1,2,3", "piece@812" without look-alikes, "part" for that of `own`."""
        if not isinstance(at, str):
            return at
        if at == "part" and own is not None:
            return self.part(own)
        kind, _, where = at.partition("@")
        return self.part(where, alike=kind == "part") if where and kind in ("part", "piece") else at

    def _transform(
        self,
        transform: Transform,
        place: Place,
        translation: ArrayLike | None,
        rotation: ArrayLike | None,
        scale: ArrayLike | None,
        pivot: ArrayLike | None,
        axes: ArrayLike | None,
    ) -> Transform:
        """`transform` with what is given exchanged, `axes` in numbers."""
        along: Along | None = None
        if isinstance(axes, str) and axes != "auto":
            if axes not in get_args(Along):
                raise ValueError(f"`axes` must be normal, limb, auto or 3 unit vectors at right angles, got {axes!r}")
            along = check.choice("Deformer", "axes", axes, Along)
            axes = self._weights.axes(place, along)
            if axes is None:
                why = "the surface has no normal" if along == "normal" else "the shape is as wide as it is long"
                raise ValueError(f"`axes` cannot be {along!r}: {why} at the handle")
        given = {"translation": translation, "rotation": rotation, "scale": scale, "pivot": pivot, "axes": axes}
        return transform.changed(**given, along=along)

    # --- what comes of it

    def prepare(self, progress: Callable[[int], object] | None = None) -> None:
        """Ask the field for the vertices' features now rather than when they are first needed.

        It is the one long step of a session; `progress` is called with the number of further vertices that are done.
        """
        self._weights.prepare(progress)

    @property
    def features(self) -> NDArray[np.float32] | CompactFeatures:
        """(V, D) features of the vertices, what `dfd.bind` takes: full unit rows or compact ones, see `Deformer`."""
        return self._weights.features

    @property
    def weights(self) -> NDArray[np.float32]:
        """(V, H) weights of the handles, in the order of `handles`, column-major and read-only, fixed once given."""
        return self._weights.of(self.edit)

    @property
    def following(self) -> NDArray[np.float32]:
        """(V, H) how much vertices follow each handle: `weights`, less what `instances` and `level` change of them."""
        return self._weights.following(self.edit)

    @property
    def bound(self) -> HandleWeights:
        """The weights with all that they are made of, for programs that show them."""
        return self._weights

    @property
    def transforms(self) -> NDArray[np.float64]:
        """(H, 3, 4) affine transforms of the handles, mesh units, in the order of `handles`."""
        return np.array([handle.matrix for handle in self.handles]).reshape(-1, 3, 4)

    @property
    def vertices(self) -> NDArray[np.float64]:
        """(V, 3) the posed shape in mesh units, read-only: Eq. 1 and 8, as `overlap` and `blend` say."""
        return self._posed.of(self.edit)

    def report(self) -> Report:
        """What the present edit does to the shape, for people: how much moved, how far, and whether handles arrived."""
        return report(self.mesh, self.edit, self._weights, self.vertices)

    def show(self, *, height: int = 640) -> Any:
        """Show the session in a cell of a notebook, where it can be gone on with; see `dfd.app.show`."""
        return import_module(PAGE).show(self, height=height)

    # --- files

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the present edit, without its history, as the JSON document of `dfd.editing.document`.

        Where the field was read from a file it says which one, and which one the mesh was read from.

        Raises
        ------
        OSError
            If `path` cannot be written; a file that was there stays as it was.
        """
        write_edit(path, self.edit, self.mesh, self.field)

    @classmethod
    def load(cls, path: str | os.PathLike[str], mesh: MeshLike, field: Field, *, features: Any = None) -> Deformer:
        """Open a session with the edit in `path`, made on `mesh` or on another resolution of the same shape.

        Raises
        ------
        OSError
            If `path` cannot be read.
        ValueError
            If it is no edit, or one of another shape; the message names the key and what was found there.

        Warns
        -----
        UserWarning
            If a vertex of the edit is no longer where it was, and counts as a point of space.
        """
        deformer = cls(mesh, field, features=features)
        deformer._start(read_edit(path, deformer.mesh))
        return deformer
