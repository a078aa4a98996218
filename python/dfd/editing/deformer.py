"""The editing session: add, change and remove handles and fixed points, undo each step, and read the posed shape."""

from __future__ import annotations

import os
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dfd.common import check
from dfd.common.errors import called, public
from dfd.common.linear_algebra import Float32, Float64
from dfd.common.preset import Preset
from dfd.editing import verbs
from dfd.editing.edit import Edit, Fixed, Handle, History, edit_on, symmetry_on, with_preset
from dfd.editing.edit_file import read_edit, write_edit
from dfd.editing.fit import Fit, Motion, fit
from dfd.editing.key_pose import KeyPose
from dfd.editing.presets import SymmetryCandidates
from dfd.editing.regions import VertexSet
from dfd.editing.report import Report, report
from dfd.editing.shape import PosedShape
from dfd.editing.transfer import transfer
from dfd.editing.verbs import ControlOptions, HandleOptions, MotionOptions
from dfd.editing.weights import handle_features
from dfd.editing.weights.fill import Counterpart
from dfd.editing.weights.of_handles import check_targets, following, weights_of
from dfd.editing.weights.session_weights import SessionWeights
from dfd.field.compatibility import check_compatible
from dfd.field.field import Field
from dfd.mesh.mesh import MeshLike, as_mesh
from dfd.posing.transforms import Transform
from dfd.segmentation.follow import Follow
from dfd.symmetry.plane import SymmetryPlane
from dfd.weights.compact import CompactFeatures

if TYPE_CHECKING:
    from typing_extensions import Unpack


class Deformer(History):
    """An editing session: one shape, its handles and fixed points, and the posed vertices.

    `vertices` is always computed from the resting mesh, so handles can be changed or removed at any time.

    Every change is one step of `undo`. With `merge=True`, a change joins the previous step if that step changed the
    same handle, place or setting. So for a drag, make all moves but the first with `merge`.

    Raises ValueError if the preset is unknown, `features` is not finite or has a wrong array shape, or the field was
    distilled from another shape. Vertices far outside the bounding box of the field's shape cause a warning. With
    `features` or `other_shape`, the field is not checked.

    Parameters
    ----------
    mesh
        The resting shape, or anything that `dfd.load` accepts. The session never changes it.
    field
        The shape's feature field. It may come from another resolution of the shape.
    preset
        The defaults of the session and its handles (`dfd.editing.presets.PRESETS`): "default", or "paper" for Eq. 1
        and Eq. 4 to 8 exactly. Settings of a handle or of the session override the preset.
    features
        (V, D) features of the vertices, or their compact form from `dfd.compact`. By default, the session evaluates the
        field when it first needs features. With the preset "default", it compacts those of more than 16,384 vertices.
        This changes weights by at most 0.01, as measured on samples (`CompactFeatures.error`).
    other_shape
        Whether to accept a field of another shape.

    Examples
    --------
    >>> import dfd
    >>> mesh = dfd.samples.chair().mesh
    >>> session = dfd.Deformer(mesh, dfd.distill(mesh))
    >>> foot = session.add("0.225,0,0.235", translation=(0, -0.2, 0))
    >>> session.move(foot, translation=(0, -0.3, 0))
    >>> session.undo()
    True
    >>> mesh.save("longer.glb", session.vertices)
    """

    # With slots, the assignment to an attribute with a misspelled name raises AttributeError.
    __slots__ = ("__weakref__", "_features", "_next_id", "_shapes", "_similarity", "field", "mesh")
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
        self._features = features
        self._similarity: dict[int, float] = {}
        self._shapes: dict[bool, PosedShape] = {}
        self._start(Edit(preset=preset))

    def _start(self, edit: Edit) -> None:
        _warn_of_settings(self.field, edit.preset)
        super().__init__(edit)
        self._shape(edit.preset)
        self._next_id = 1 + max((handle.id for handle in edit.handles), default=0)

    def _shape(self, preset: Preset) -> PosedShape:
        """Return the posed shape, and the weights, of edits with `preset`: with "paper", features are not compact."""
        compacts = self._features is None and len(self.mesh.vertices) > handle_features.MOST_EXACT
        full = compacts and preset == "paper"
        if full not in self._shapes:
            self._shapes[full] = PosedShape(SessionWeights(self.mesh, self.field, self._features, full=full))
        return self._shapes[full]

    @property
    def bound(self) -> SessionWeights:
        """Return the weights and parts of the present edit, for programs that show them."""
        return self._shape(self.preset).weights

    def __repr__(self) -> str:
        """Return the mesh and the numbers of handles and fixed points."""
        counts = (len(self.handles), "handle"), (len(self.fixed), "fixed point")
        told = [f"{count} {what}" if count == 1 else f"{count} {what}s" for count, what in counts]
        return f"Deformer({self.mesh!r}, {', '.join(told)})"

    @property
    def handles(self) -> tuple[Handle, ...]:
        """Return the handles, in the order in which they were added."""
        return self.edit.handles

    @public
    def handle(self, handle: int) -> Handle:
        """Return the handle with the id `handle`. Raises ValueError if there is none."""
        return self.edit.handle(handle)

    @public
    def counterparts(self, handle: int) -> list[tuple[Counterpart, bool]]:
        """Return the counterparts of a handle, and whether each moves with the handle.

        The first counterpart is at the handle itself. The others are in order of decreasing similarity. They do not
        move if `excluded_counterparts` excludes them, or if the control `follow` leaves them out.

        Raises ValueError if there is no such handle.
        """
        one = self.edit.handle(handle)
        return self.bound.counterparts(one, self.bound.held(self.edit, one))

    @property
    def fixed(self) -> tuple[Fixed, ...]:
        """Return the fixed points and regions, in the order in which they were added."""
        return self.edit.fixed

    def _commit(self, edit: Edit, topic: Hashable = None, merge: bool = False, *, rebinds: bool = True) -> None:
        """Record `edit` as a step. With `rebinds`, raise ValueError if fixed points take all weight from a handle."""
        if rebinds and edit.fixed:
            check_targets(self._shape(edit.preset).weights, edit)
        self._record(edit, topic, merge)

    @public
    def add(self, at: Any, *, name: str | None = None, **given: Unpack[HandleOptions]) -> int:
        """Add a handle at a place of the shape, and return the handle's id.

        Without a motion, the handle takes over the motion that its component has, so that nothing moves.

        Raises ValueError if an argument has a wrong array shape, a number is not finite or out of range, a word is
        unknown, or a region is empty. Raises ValueError if a point lies farther from the shape than the diagonal of its
        bounding box, the place already has a handle or a fixed point, or fixed points take all weight from the handle.

        Parameters
        ----------
        at
            The place: a vertex index, or any point (3,) in mesh units. An array of vertex indices, a mask (V,) or a
            region of `dfd.editing.regions` makes all of its vertices the handle. A text is "part@812" (the part at a
            vertex or point), "piece@812" (without its counterparts), or one of the texts of `dfd.editing.points.find`.
        translation
            (3,) in mesh units.
        rotation
            (3,) rotation vector in degrees (axis times angle, right-handed), a quaternion (x, y, z, w), or a
            `scipy.spatial.transform.Rotation`.
        scale
            One factor, or (3,) along `axes`, applied before the rotation.
        pivot
            The center of rotation and scale: (3,) in mesh units, or a name. "base" is the center of the border of the
            *held part*, the vertices with at least half of the handle's largest weight at rest. "middle" is the center
            of the held part. "point" is the handle, or the center of its region. "plane" is the point of the plane of
            symmetry nearest to the handle. "hinge" is the middle of a line through the border points that are farthest
            from the tip. The default is "base" for a limb, and else "middle", or with the preset "paper" "point". A
            limb has one border, is longer than 0.75 times its width, and is no disk such as a wheel. If the held part
            lies on both sides of the plane of symmetry, the default lies on the plane.
        axes
            (3, 3) orthonormal vectors, one per row: the directions of the three factors of `scale`. "normal" is a frame
            whose third vector is the surface's normal at the handle. By default, they are the mesh's axes x, y and z.
        bend, towards
            `bend` is the angle in degrees, or the rotation vector (3,), by which the tip of the held part rotates. The
            rotation grows along the axis of each counterpart, and cross-sections move rigidly. `towards` is where the
            tip moves: "up", "down", "left", "right", "front", "back" or a vector (3,). The default is "up", or "front"
            if the part is upright. Bend and twist are applied before scale, rotation and translation.
        twist
            Angle in degrees by which the tip rotates about the part's axis.
        joint
            The position of bend and twist on the axis: a number from 0 at the base to 1 at the tip, or a word.
            "spread", the default, distributes them over the whole length. "auto" is where the resting part is most bent
            or narrowest, such as a knee. "here" is the place nearest to the handle.
        open
            Angle in degrees by which the part rotates about its hinge, as a jaw opens. It sets `rotation` and `pivot`.
        matrix
            (3, 4) or (4, 4) affine matrix in mesh units, in place of translation, rotation, scale and axes. The handle
            stores its polar decomposition about the pivot.
        name
            The name for display.
        level, follow, counterparts, excluded_counterparts, detach
            The part at the handle, what follows it, and whether it comes loose from pieces of the mesh that it touches.
        reach, falloff, locality, radius, strength, mask, mask_feather
            The other controls, see `dfd.editing.controls.Controls`. By default, they are those of the preset.
        """
        new = self._next_id
        self._commit(verbs.add(self.edit, self.bound, new, at, name=name, **given))
        self._next_id += 1
        return new

    @public
    def move(self, handle: int, *, merge: bool = False, **given: Unpack[MotionOptions]) -> None:
        """Set values of a handle's transform, relative to the resting shape. Values that are left out do not change.

        The arguments are those of `add`, from `translation` to `matrix`. "auto" resets `pivot` or `axes` to its
        default. With the reach "part", `move` also changes `weights` in the blend band, a strip at the part's border.

        Raises ValueError if there is no such handle, an array has a wrong shape, or a number is not finite.
        """
        edit = verbs.move(self.edit, self.bound, handle, given)
        self._commit(edit, ("handle", handle), merge, rebinds=False)

    @public
    def fit(
        self, targets: Any, *, handles: Sequence[int] | None = None, motion: Motion = "rigid", merge: bool = False
    ) -> Fit:
        """Move handles so that chosen vertices, or the surface, arrive at given positions, and return the distances.

        The motions begin from rest. They minimize the squared distances from the targets. If several motions do so, the
        smallest is chosen: a motion that no target determines stays almost 0. One call is one step of the history.

        Raises ValueError if there is no handle or no target, a position is not finite, a place is a region or not on
        the shape, or no handle moves a target. Warns of motions that the targets do not determine.

        Parameters
        ----------
        targets
            A mapping of places to positions (3,) in mesh units. A place is a vertex index, a point or a text, as in
            `add`, and stands for the vertex at it or nearest to it. Or a pair: vertex indices (N,) and positions
            (N, 3). Or the points (N, 3) of a scan, each of which attracts the nearest point of the surface.
        handles
            The ids of the handles that may move; None stands for all handles of the session.
        motion
            The motion of each handle: "rigid" has a translation and a rotation. "scale" also has one factor of scale,
            and "affine" any linear map, which also shears.

        Returns
        -------
        fit
            The mean and the largest distance from the targets, the mean distance before the fit, and the undetermined
            motions of each handle.

        Examples
        --------
        >>> import dfd
        >>> mesh = dfd.samples.chair().mesh
        >>> session = dfd.Deformer(mesh, dfd.distill(mesh))
        >>> back = session.add("top")
        >>> marks = mesh.vertices[:, 1].argsort()[-9:]  # the highest vertices
        >>> found = session.fit((marks, mesh.vertices[marks] + (0, 0.1, 0)))
        >>> found.largest < 1e-4
        True
        """
        fitted, found = fit(self.edit, self.bound, targets, handles, motion)
        self._commit(fitted, "fit", merge, rebinds=False)
        return found

    def bend(
        self, handle: int, angle: ArrayLike, *, towards: Any = None, joint: Any = None, merge: bool = False
    ) -> None:
        """Bend the held part along its axis; see `bend` in `add`."""
        self.move(handle, bend=angle, towards=towards, joint=joint, merge=merge)

    def twist(self, handle: int, angle: float, *, joint: Any = None, merge: bool = False) -> None:
        """Twist the held part about its axis; see `twist` in `add`."""
        self.move(handle, twist=angle, joint=joint, merge=merge)

    def open(self, handle: int, angle: float, *, merge: bool = False) -> None:
        """Rotate the held part about its hinge, as a jaw opens; see `open` in `add`."""
        self.move(handle, open=angle, merge=merge)

    @public
    def change(
        self,
        handle: int,
        *,
        at: Any = None,
        name: str | None = None,
        merge: bool = False,
        **controls: Unpack[ControlOptions],
    ) -> None:
        """Set the place, the controls or the name of a handle, as in `add`. Values that are left out do not change.

        A given `radius` resets `locality`, and a given `locality` resets `radius`. `mask="everywhere"` removes the
        mask. `excluded_counterparts=[]` makes all counterparts move.

        Raises ValueError as in `add`, or if there is no such handle.
        """
        self._commit(verbs.change(self.edit, self.bound, handle, at, name, controls), ("handle", handle), merge)

    @public
    def remove(self, handle: int, *, merge: bool = False) -> None:
        """Remove a handle. Raises ValueError if there is no such handle."""
        self._commit(self.edit.removed(handle), ("handle", handle), merge)

    @public
    def transfer(self, mesh: MeshLike, field: Field, *, features: Any = None) -> Deformer:
        """Return a session on another `mesh` of the same class, with this edit, transferred to the most similar places.

        `field` is the feature field of `mesh`.

        `dfd.editing.transfer.transfer` explains the rules and the errors. `similarity` of the new session has the
        similarity of each place. `features` are those of `Deformer`.

        Examples
        --------
        >>> import dfd
        >>> mesh, other = dfd.samples.chair().mesh, dfd.samples.chair(8_000).mesh
        >>> session = dfd.Deformer(mesh, dfd.distill(mesh))
        >>> foot = session.add("0.225,0,0.235", translation=(0, -0.2, 0))
        >>> twin = session.transfer(other, dfd.distill(other))
        >>> twin.similarity[foot] > 0.5
        True
        """
        other = Deformer(mesh, field, preset=self.preset, features=features)
        parts = self.bound.parts, other.bound.parts
        found = transfer(self.edit, self.mesh, self.field, other.mesh, other.field, parts=parts)
        other._start(found.edit)
        other._similarity = found.similarity
        return other

    @property
    def similarity(self) -> dict[int, float]:
        """Return the similarity, in [0, 1], of each transferred handle, by its id; it is empty without `transfer`.

        It is the cosine between the features at the handle's place on both shapes, each minus the mean of its shape.
        """
        return dict(self._similarity)

    @public
    def apply(self, edit: Edit, *, merge: bool = False) -> None:
        """Replace all handles, fixed points and settings, including the preset, by those of `edit`, as one step.

        `Edit()` removes everything.

        Raises ValueError if the mesh lacks a vertex of `edit`, a region is empty on the mesh, a point lies farther from
        the shape than the diagonal of its bounding box, or the plane of symmetry does not cut the shape.
        """
        _warn_of_settings(self.field, edit.preset)
        self._commit(edit_on(self.mesh, edit), "edit", merge)
        self._next_id = max(self._next_id, 1 + max((handle.id for handle in edit.handles), default=0))

    @public
    def part(self, at: Any, *, level: int = 0, follow: Follow = "all") -> VertexSet:
        """Return the part of the shape at a place, as a region for `add`, `fix` and `mask`.

        `at` is as in `add`. If `at` is a region, the result is the part at the vertex that is nearest to the region's
        center. `level` and `follow` are as in `dfd.Parts.part`.

        Raises ValueError if `at` is no place, `level` is no whole number, `follow` is another word, or the mesh has no
        face with an area.
        """
        return verbs.part_at(self.bound, at, level, follow=follow)

    @property
    def preset(self) -> Preset:
        """Return the preset: defaults of new handles, and rules that combine handles (`dfd.editing.presets.PRESETS`).

        An assignment is one step. It sets reach, falloff and counterparts of every handle, and the band of the plane of
        symmetry, to the values of the preset.
        """
        return self.edit.preset

    @preset.setter
    def preset(self, preset: Preset) -> None:
        with called("Deformer.preset"):
            self._commit(with_preset(self.edit, preset, self.mesh))
            _warn_of_settings(self.field, preset)

    @public
    def fix(self, at: Any, *, strength: float = 1.0, merge: bool = False) -> None:
        """Keep a point or a region in place, together with all surface that looks like it (Eq. 6).

        Of the part of a handle, it keeps whole counterparts, or divides the handle's own component.

        `at` is as in `add`. `strength`, in [0, 1], multiplies the weights that Eq. 6 subtracts.

        Raises ValueError if `at` is no place, or used already, or `strength` lies outside [0, 1]. With the preset
        "default", raises ValueError if a handle would lose all weight at its place.
        """
        place = verbs.place_of(self.bound, at)
        self._commit(replace(self.edit, fixed=(*self.fixed, Fixed(place, strength))), ("fixed", place), merge)

    @public
    def release(self, at: Any, *, merge: bool = False) -> None:
        """Remove the fixed point or region at a place. Raises ValueError if there is none."""
        place = verbs.place_of(self.bound, at)
        self._commit(self.edit.released(place), ("fixed", place), merge)

    @property
    def symmetry(self) -> SymmetryPlane | None:
        """Return the plane of symmetry, or None; see `set_symmetry`."""
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
        """Set the plane of symmetry. Vertices beyond it, seen from a handle, follow the mirrored transform (Eq. 8).

        Raises ValueError if `plane` is invalid, `band` is negative or not finite, "auto" finds no plane, or
        `candidates` or `threshold` is given for another plane.

        Parameters
        ----------
        plane
            A plane, a text, or None for no symmetry. "x", "y" or "z" is the plane perpendicular to that axis through
            the center of the bounding box. "x=0.1" is the plane x = 0.1. "auto" is the one with the most similar sides.
        band
            Half width, in mesh units, of the band at the plane in which the motions of both sides are blended. With 0,
            as in Eq. 8, the surface tears at the plane. If left out, a `SymmetryPlane` keeps its own band, and a plane
            from a text has the preset's band.
        candidates, threshold
            Arguments of `dfd.symmetry_planes` for "auto". If left out, they are those of the preset.
        """
        how: dict[str, Any] = {"candidates": candidates, "threshold": threshold}
        none = plane is None and candidates is None and threshold is None
        found = None if none else symmetry_on(self.mesh, plane, band, preset=self.preset, field=self.field, **how)
        self._commit(replace(self.edit, symmetry=found), "symmetry", merge)

    @property
    def default(self) -> Transform | None:
        """Return D₀ of Eq. 1, the transform of vertices without weights; None is the identity."""
        return self.edit.default

    @public
    def set_default(self, *, merge: bool = False, **given: Any) -> None:
        """Set D₀ of Eq. 1, the transform of vertices without weights. Without arguments, D₀ is the identity.

        The arguments are `translation`, `rotation` and `scale` of `add`, and `pivot` and `axes` as numbers. If left
        out, the pivot is the center of the bounding box.

        Raises ValueError if an array has a wrong shape, or a number is not finite.
        """
        self._commit(verbs.set_default(self.edit, self.bound, given), "default", merge)

    def start_with(self, edit: Edit) -> None:
        """Begin again with `edit`, an edit of this mesh, and without history. Its weights are not checked."""
        self._start(edit)

    def continue_from(self, other: Deformer) -> None:
        """Take over the edit and the history of `other`, a session of the same mesh that may have another field."""
        self._states, self._now, self._next_id = other._states, other._now, other._next_id

    @public
    def set_poses(self, poses: Iterable[KeyPose]) -> None:
        """Replace the key poses of the edit (`edit.poses`). The present pose does not change.

        Raises ValueError if an item is no key pose, or has the id of an unknown handle.
        """
        self._commit(replace(self.edit, poses=tuple(poses)), rebinds=False)

    def prepare(self, progress: Callable[[int], object] | None = None) -> None:
        """Evaluate the field at all vertices now, and not when their features are first needed.

        `progress` is called repeatedly, each time with the number of vertices that were evaluated since the last call.
        """
        self.bound.rows.prepare(progress)

    @property
    def features(self) -> Float32 | CompactFeatures:
        """Return the vertices' features (V, D) for `dfd.bind`: in full, or compact (see `Deformer`)."""
        return self.bound.rows.features

    @property
    def weights(self) -> Float32:
        """Return the weights (V, H) of Eq. 4 to 7, read-only. Each column is for a handle and all its counterparts."""
        return _read_only(weights_of(self.bound, self.edit))

    @property
    def following(self) -> Float32:
        """Return the weights (V, H) with which vertices follow the handles. Counterparts that do not move have none."""
        return following(self.bound, self.edit)

    @property
    def transforms(self) -> Float64:
        """Return the affine transforms (H, 3, 4) of the handles in mesh units, in the order of `handles`."""
        return np.array([handle.matrix for handle in self.handles]).reshape(-1, 3, 4)

    @property
    def vertices(self) -> Float64:
        """Return the posed vertices (V, 3) in mesh units, read-only: Eq. 1 and 8 with the rules of the preset."""
        return _read_only(self._shape(self.preset).of(self.edit))

    def report(self) -> Report:
        """Return how many vertices moved, how far they moved, and whether the handles reached their targets."""
        return report(self.mesh, self.edit, self.bound, self.vertices)

    def show(self, *, height: int = 640) -> Any:
        """Show the session in a notebook cell, in which the user can continue to edit; see `dfd.app.show`."""
        if Deformer.page is None:
            raise ValueError("Deformer.show: needs the app: import dfd.app, or call dfd.app.show(session)")
        return Deformer.page(self, height=height)

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

        `dfd.editing.edit_file.read_edit` explains how places are found, and the errors. `other_shape` also accepts a
        field of another shape. `transfer` transfers an edit by features.
        """
        deformer = cls(mesh, field, features=features, other_shape=other_shape)
        deformer._start(read_edit(path, deformer.mesh, other_shape=other_shape))
        return deformer


def _warn_of_settings(field: Field, preset: Preset) -> None:
    """With the preset "paper", warn if the field was distilled with other settings."""
    if preset == "paper":
        from dfd.distillation.settings import other_than_paper

        differ = other_than_paper(field.settings)
        if differ:
            more = f" and {len(differ) - 4} more settings" if len(differ) > 4 else ""
            told = f"other settings: {', '.join(differ[:4])}{more}; distill the field with preset='paper'"
            check.warn(f"Deformer: `preset` is 'paper', but the field was distilled with {told}", UserWarning)


def _read_only(array: NDArray[Any]) -> NDArray[Any]:
    """Return `array`, read-only; the arrays of an unpickled session are writable at first."""
    array.flags.writeable = False
    return array
