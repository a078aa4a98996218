"""The editing session: handles that can always be changed, fixed points, symmetry, undo, and the posed shape."""

from __future__ import annotations

import os
from collections.abc import Callable, Hashable
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from dfd.common import check
from dfd.common.errors import ArgumentError, called, public
from dfd.common.linear_algebra import Float32, Float64
from dfd.common.preset import Preset
from dfd.editing import verbs
from dfd.editing.edit import Edit, Fixed, Handle, edit_on, symmetry_on, with_preset
from dfd.editing.edit_file import read_edit, write_edit
from dfd.editing.history import History
from dfd.editing.influence.counterparts import Counterpart
from dfd.editing.influence.handle_weights import HandleWeights
from dfd.editing.influence.regions import VertexSet
from dfd.editing.presets import SymmetryCandidates
from dfd.editing.report import Report, report
from dfd.editing.shape import PosedShape
from dfd.field.compatibility import check_compatible
from dfd.field.field import Field
from dfd.mesh.mesh import MeshLike, as_mesh
from dfd.posing.transforms import Transform
from dfd.segmentation.parts import Level
from dfd.symmetry.plane import SymmetryPlane
from dfd.weights.compact import CompactFeatures


class Deformer(History):
    """One editing session of one shape.

    Every handle keeps the numbers that the caller gave, and can be changed or removed at any time. `vertices` always
    follows from the resting mesh. A new handle costs one column of weights. With a linear blend, the time of a drag's
    frame depends on the moving handles only.

    Every change is a step that `undo` takes back, without limit. With `merge`, a change joins the previous step if that
    step concerns the same handle, place or setting. So a drag is one plain move followed by merged moves, and `undo`
    takes back the whole drag.

    Parameters
    ----------
    mesh
        The resting shape, or anything that `dfd.load` accepts. The session never changes it.
    field
        The shape's feature field, or that of another resolution of the same shape.
    preset
        The defaults of the session and its handles (`dfd.editing.presets.PRESETS`): "default", or "paper" for Eq. 1
        and 4 to 8 to the letter. Settings of a handle or of the session override the preset.
    features
        (V, D) features of the vertices if they are already computed, in full or as `dfd.compact` returns them. The
        field is then only evaluated at points in space. If left out, the field is evaluated when features are first
        needed. The preset "paper" uses full features. With the preset "default", features of more than 16,384 vertices
        are compact: sampled weights differ from exact ones by at most 0.01 (`features.error`).
    other_shape
        Accept a field of another shape.

    Raises ValueError if the preset is unknown, or `features` is not finite or has another shape. If `features` is None
    and `other_shape` is False, raises ValueError if the field was distilled from another shape
    (`dfd.field.compatibility.check_compatible`). Warns if a part of the mesh lies far outside the box of that shape.
    """

    # Only slots, so that a setting with a misspelled name raises AttributeError.
    __slots__ = ("__weakref__", "_next_id", "_posed", "bound", "field", "mesh")
    page: Callable[..., Any] | None = None  # the function that shows a session; `dfd` sets it to `dfd.app.show`

    @public
    def __init__(
        self,
        mesh: MeshLike,
        field: Field,
        *,
        preset: Preset = "default",
        features: Any = None,
        other_shape: bool = False,
    ) -> None:
        self.mesh = as_mesh(mesh)
        self.field = check.field("Deformer", field)
        if features is None and not other_shape:
            check_compatible(self.field, self.mesh, allowed_by="other_shape=True")
        self.bound = HandleWeights(self.mesh, field, features)  # for programs that show weights and their data
        self._posed = PosedShape(self.mesh, self.bound)
        self._start(Edit(preset=preset))

    def _start(self, edit: Edit) -> None:
        self._follow(edit.preset)
        super().__init__(edit)
        self._next_id = 1 + max((handle.id for handle in edit.handles), default=0)

    def __repr__(self) -> str:
        """Return the mesh and the numbers of handles and fixed points."""
        counts = (len(self.handles), "handle"), (len(self.fixed), "fixed point")
        told = [f"{count} {what}" if count == 1 else f"{count} {what}s" for count, what in counts]
        return f"Deformer({self.mesh!r}, {', '.join(told)})"

    # --- handles

    @property
    def handles(self) -> tuple[Handle, ...]:
        """Return the present handles, in the order in which they were added."""
        return self.edit.handles

    @public
    def handle(self, handle: int) -> Handle:
        """Return the handle with an id; ValueError if there is none."""
        return self.edit.handle(handle)

    @public
    def counterparts(self, handle: int) -> list[tuple[Counterpart, bool]]:
        """Return the counterparts of a handle, and whether each is on (`excluded_counterparts`).

        The handle's own place is the first. The others follow in order of decreasing similarity.

        Raises ValueError if there is no such handle.
        """
        return self.bound.counterparts(self.edit, self.edit.handle(handle))

    @property
    def fixed(self) -> tuple[Fixed, ...]:
        """Return the fixed points and regions, in the order in which they were added."""
        return self.edit.fixed

    def _commit(self, edit: Edit, topic: Hashable = None, merge: bool = False, *, rebinds: bool = True) -> None:
        """Add a step. With `rebinds`, raise ValueError if fixed points leave a handle no weight at its place."""
        if rebinds:
            self.bound.by_features.check_arrivals(edit)
        self._record(edit, topic, merge)

    @public
    def add(self, at: Any, *, name: str | None = None, **given: Any) -> int:
        """Add a handle that holds a place of the shape, and return its id.

        Parameters
        ----------
        at
            The place. A vertex index, or any point (3,) in mesh units. An array of vertex indices, a mask (V,) or
            a region of `dfd.editing.influence.regions`: the handle holds all of its vertices. A text,
            see `dfd.editing.points.find`; "part@1,2,3" for the part at a place; "piece@812" for that part without its
            counterparts.
        translation
            (3,) in mesh units.
        rotation
            (3,) rotation vector in degrees (axis times angle, right-handed), or a quaternion (x, y, z, w).
        scale
            One factor, or (3,) along `axes`, applied before the rotation.
        pivot
            The center of rotation and scale: (3,) in mesh units, or one of these names. "base": where the held part
            joins the rest of the shape. "middle": the middle of that part. "point": the handle itself, or the center of
            its region. "plane": the point of the plane of symmetry nearest to the handle. "hinge": the middle of the
            hinge, a line through border points far from the tip. If left out, a limb has its base as pivot. A limb has
            one border with the rest, is longer than 0.75 widths, and is no wheel. Any other part, such as a wheel, has
            its middle as pivot; if the part lies across the plane of symmetry, the pivot lies on the plane. With the
            preset "paper" the pivot is the handle itself.
        axes
            (3, 3) orthonormal vectors, one per row, along which the handle scales. "normal" is a frame whose third
            vector is the surface's normal at the handle. If left out, the axes are the mesh's own.
        bend, towards
            `bend` is the angle in degrees by which the tip of the held part bends along the part's own axis; every
            cross-section moves rigidly. `towards` is "up", "down", "left", "right", "front", "back" or a direction
            (3,). The default is up, or front if the part runs upright. `bend` may also be a rotation vector (3,). Each
            counterpart bends along its own axis. The rest of the transform is applied after the bend.
        twist
            Angle in degrees by which the tip turns about the part's own axis.
        joint
            Where along the axis bend and twist happen. "spread", the default: over the whole length. "auto": at the
            strongest bend or the narrowest place. "here": at the handle. A number: from 0 at the base to 1 at the tip.
        open
            Angle in degrees by which the part turns about its hinge, away from the rest, as a jaw opens. It sets
            `rotation` and `pivot`.
        name
            A name for display.
        reach, falloff, locality, radius, strength, counterparts, excluded_counterparts, mask, mask_feather
            Controls, see `dfd.editing.controls.Controls`. The preset gives the values that are left out or None.
            `mask="part"` is the part at the handle.

        Raises ValueError if a number is not finite, of another shape or out of range, a name is unknown, or a region is
        empty. Raises ValueError if a point lies farther from the shape than the diagonal of its box, or the place
        already has a handle or fixed point. Raises ValueError if fixed points take all weight from the handle.
        """
        new = self._next_id
        self._commit(verbs.add(self.edit, self.bound, new, at, name=name, **given))
        self._next_id += 1
        return new

    @public
    def move(self, handle: int, *, merge: bool = False, **given: Any) -> None:
        """Set values of a handle's transform, relative to the resting shape. Others stay, and weights do not change.

        The values are those of `add`, from `translation` to `open`. "auto" returns `pivot` and `axes` to their
        defaults.

        Raises ValueError if there is no such handle, or a number is not finite or of another shape.
        """
        edit = verbs.move(self.edit, self.bound, handle, given)
        self._commit(edit, ("handle", handle), merge, rebinds=False)

    def bend(
        self, handle: int, angle: ArrayLike, *, towards: Any = None, joint: Any = None, merge: bool = False
    ) -> None:
        """Bend the held part along its own axis, see `bend` in `add`."""
        self.move(handle, bend=angle, towards=towards, joint=joint, merge=merge)

    def twist(self, handle: int, angle: float, *, joint: Any = None, merge: bool = False) -> None:
        """Twist the held part about its own axis, see `twist` in `add`."""
        self.move(handle, twist=angle, joint=joint, merge=merge)

    def open(self, handle: int, angle: float, *, merge: bool = False) -> None:
        """Turn the held part about its hinge, as a jaw opens; see `open` in `add`."""
        self.move(handle, open=angle, merge=merge)

    @public
    def change(
        self, handle: int, *, at: Any = None, name: str | None = None, merge: bool = False, **controls: Any
    ) -> None:
        """Set the place, the controls or the name of a handle, as in `add`. Values that are left out stay.

        Giving one of `radius` and `locality` resets the other. `mask="everywhere"` removes the mask.
        `excluded_counterparts=[]` makes all counterparts move.

        Raises ValueError as in `add`, or if there is no such handle.
        """
        self._commit(verbs.change(self.edit, self.bound, handle, at, name, controls), ("handle", handle), merge)

    @public
    def remove(self, handle: int, *, merge: bool = False) -> None:
        """Remove a handle; ValueError if there is no such handle."""
        self._commit(self.edit.removed(handle), ("handle", handle), merge)

    @public
    def apply(self, edit: Edit, *, merge: bool = False) -> None:
        """Replace the whole present state by `edit`, as one step; `Edit()` clears the session.

        The session takes the preset of `edit`.

        Raises ValueError if a vertex of `edit` is not in the mesh, or a region of it is empty there.
        """
        self._follow(edit.preset)
        self._commit(edit_on(self.mesh, edit), "edit", merge)
        self._next_id = max(self._next_id, 1 + max((handle.id for handle in edit.handles), default=0))

    @public
    def part(self, at: Any, *, level: Level = "part", alike: bool = True) -> VertexSet:
        """Return the part of the shape at a place, as a region for `add`, `fix` and `mask`.

        `at` is as in `add`. For a region, the result is the part at the region's center. `level` and `alike` are as in
        `dfd.Parts.part`.

        Raises ValueError if `at` is no place, or the mesh has no face with an area.
        """
        return verbs.part_at(self.bound, at, level, alike=alike)

    # --- the whole shape

    @property
    def preset(self) -> Preset:
        """Return the preset: defaults of new handles, and rules that combine handles (`dfd.editing.presets.PRESETS`).

        Setting it is one step. It also gives every handle the preset's reach, falloff and counterparts, and gives the
        plane the preset's band.
        """
        return self.edit.preset

    @preset.setter
    def preset(self, preset: Preset) -> None:
        with called("Deformer.preset"):
            self._commit(with_preset(self.edit, preset, self.mesh))
            self._follow(preset)

    def _follow(self, preset: Preset) -> None:
        """With the preset "paper", use full features, and warn if the field was distilled with other settings."""
        from dfd.distillation.settings import DistillSettings

        if preset == "paper":
            self.bound.rows.full = True
        made = self.field.settings
        paper = DistillSettings(preset="paper").as_dict() if preset == "paper" else {}
        if differ := [name for name, value in paper.items() if name != "seed" and name in made and made[name] != value]:
            more = f" and {len(differ) - 4} more settings" if len(differ) > 4 else ""
            check.warn(
                f"Deformer: `preset` is 'paper', but the field was distilled with other settings: "
                f"{', '.join(differ[:4])}{more}; distill the field with preset='paper'",
                UserWarning,
            )

    @public
    def fix(self, at: Any, *, strength: float = 1.0, merge: bool = False) -> None:
        """Hold a point or a region and all its counterparts in place (Eq. 6).

        `at` is as in `add`. `strength`, in [0, 1], multiplies the weight that the fixed point subtracts; 1 is Eq. 6.

        Raises ValueError if `at` is no place, or already fixed or a handle. Raises ValueError if `strength` lies
        outside [0, 1], or a handle would keep no weight; the preset "paper" allows that.
        """
        place = verbs.place_of(self.bound, at)
        self._commit(replace(self.edit, fixed=(*self.fixed, Fixed(place, strength))), ("fixed", place), merge)

    @public
    def release(self, at: Any, *, merge: bool = False) -> None:
        """Remove a fixed point or region; ValueError if it is not fixed."""
        place = verbs.place_of(self.bound, at)
        self._commit(self.edit.released(place), ("fixed", place), merge)

    @property
    def symmetry(self) -> SymmetryPlane | None:
        """Return the plane of symmetry, or None: handles act mirrored on its other side. Set it with `set_symmetry`."""
        return self.edit.symmetry

    @symmetry.setter
    def symmetry(self, plane: SymmetryPlane | str | None) -> None:
        with called("Deformer.symmetry"):
            self.set_symmetry(plane)

    @public
    def set_symmetry(
        self,
        plane: SymmetryPlane | str | None,
        *,
        band: float | None = None,
        candidates: SymmetryCandidates | None = None,
        threshold: float | Literal["relative"] | None = None,
        merge: bool = False,
    ) -> None:
        """Let every handle act on both sides of a plane, mirrored on the other side (Eq. 8).

        Parameters
        ----------
        plane
            A plane; "x", "y" or "z" for the plane across that axis through the center of the box; "x=0.1" for another
            position along it; "auto" for the plane with the most similar sides; None for no symmetry.
        band
            Half width, in mesh units, of the blend band, where the two sides blend. 0 is Eq. 8 as written: surface that
            crosses the plane tears. If left out, a `SymmetryPlane` keeps its own band, and the plane of a text gets the
            preset's.
        candidates, threshold
            For "auto": arguments of `dfd.symmetry_planes`; the preset gives those left out.

        Raises ValueError if `plane` is invalid, `band` is negative or not finite, or "auto" finds no plane. Raises
        ValueError if `candidates` or `threshold` is given for a plane other than "auto".
        """
        how: dict[str, Any] = {"candidates": candidates, "threshold": threshold}
        if plane is not None:
            plane = symmetry_on(self.mesh, plane, band, preset=self.preset, field=self.field, **how)
        elif any(value is not None for value in how.values()):
            raise ArgumentError("candidates", "and `threshold` are for the plane auto, got None")
        self._commit(replace(self.edit, symmetry=plane), "symmetry", merge)

    @property
    def default(self) -> Transform | None:
        """Return D₀ of Eq. 1, the transform of everything that no handle holds; None is the identity."""
        return self.edit.default

    @public
    def set_default(self, *, merge: bool = False, **given: Any) -> None:
        """Set D₀ of Eq. 1, the transform of everything that no handle holds; without arguments it is the identity.

        If left out, the pivot is the center of the box. Other arguments are as in `Deformer.add`.

        Raises ValueError if a number is not finite or of another shape.
        """
        self._commit(verbs.set_default(self.edit, self.bound, given), "default", merge)

    # --- results

    def prepare(self, progress: Callable[[int], object] | None = None) -> None:
        """Evaluate the field at the vertices now, instead of when their features are first needed.

        This is the only long step of a session. `progress` is called with the number of vertices done since its last
        call.
        """
        self.bound.rows.prepare(progress)

    @property
    def features(self) -> Float32 | CompactFeatures:
        """Return the vertices' features (V, D), for `dfd.bind`: full unit rows or compact ones, see `Deformer`."""
        return self.bound.rows.features

    @property
    def weights(self) -> Float32:
        """Return the weights (V, H) of the handles, in the order of `handles`, column-major and read-only."""
        return self.bound.by_features.of(self.edit)[0]

    @property
    def following(self) -> Float32:
        """Return the weights (V, H) with which vertices follow each handle, over all counterparts that move."""
        return self.bound.following(self.edit)

    @property
    def transforms(self) -> Float64:
        """Return affine transforms of the handles (H, 3, 4), mesh units, in the order of `handles`."""
        return np.array([handle.matrix for handle in self.handles]).reshape(-1, 3, 4)

    @property
    def vertices(self) -> Float64:
        """Return the posed shape (V, 3) in mesh units, read-only: Eq. 1 and 8 with the rules of the preset."""
        return self._posed.of(self.edit)

    def report(self) -> Report:
        """Return a report of the present edit: how much moved, how far, and whether handles reached their targets."""
        return report(self.mesh, self.edit, self.bound, self.vertices)

    def show(self, *, height: int = 640) -> Any:
        """Show the session in a notebook cell, where the user can continue it; see `dfd.app.show`."""
        if Deformer.page is None:
            raise ValueError("Deformer.show: needs the app: import dfd.app, or call dfd.app.show(session)")
        return Deformer.page(self, height=height)

    # --- files

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the present edit, without its history, as the JSON document of `dfd.editing.edit_file`.

        If the field has a file, the document also names the files of the field and of the mesh.

        Raises OSError if `path` cannot be written; an existing file stays unchanged.
        """
        write_edit(path, self.edit, self.mesh, self.field)

    @classmethod
    def load(
        cls,
        path: str | os.PathLike[str],
        mesh: MeshLike,
        field: Field,
        *,
        features: Any = None,
        other_shape: bool = False,
    ) -> Deformer:
        """Return a session with the edit in `path`, made on `mesh` or on another resolution of the same shape.

        `other_shape` accepts an edit or a field of another shape. Places are then found by their positions, and lengths
        stay unchanged. In contrast, `dfd.editing.transfer` transfers an edit by features.

        Raises OSError if `path` cannot be read. Raises ValueError if it is no edit, or an edit of another shape; the
        message names the key and the value found there. Warns if a vertex of the edit is no longer at its position; the
        position is then a point in space.
        """
        deformer = cls(mesh, field, features=features, other_shape=other_shape)
        deformer._start(read_edit(path, deformer.mesh, other_shape=other_shape))
        return deformer
