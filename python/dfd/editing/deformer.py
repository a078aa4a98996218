"""The editing session: handles that stay live, fixed points, symmetry, undo, and the posed shape at any moment."""

from __future__ import annotations

import os
from collections.abc import Callable, Hashable
from contextlib import AbstractContextManager
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from dfd.common import check
from dfd.common.errors import called, public
from dfd.common.linear_algebra import Float32, Float64
from dfd.common.preset import Preset
from dfd.editing import verbs
from dfd.editing.edit import Edit, Fixed, Handle, edit_on, with_preset
from dfd.editing.edit_file import read_edit, write_edit
from dfd.editing.history import History
from dfd.editing.influence.handle_weights import HandleWeights
from dfd.editing.presets import SymmetryCandidates
from dfd.editing.report import Report, report
from dfd.editing.shape import PosedShape
from dfd.field.compatibility import check_compatible
from dfd.field.field import Field
from dfd.mesh.mesh import MeshLike, as_mesh
from dfd.posing.transforms import Transform
from dfd.symmetry.plane import SymmetryPlane
from dfd.weights.compact import CompactFeatures

if TYPE_CHECKING:
    from dfd.editing.influence.counterparts import Counterpart
    from dfd.editing.influence.regions import VertexSet
    from dfd.segmentation.parts import Level


class Deformer:
    """One editing session of one shape.

    Nothing is ever baked: every handle keeps the numbers it was given and can be changed or removed at any time, and
    `vertices` always follows from the resting mesh. A new handle costs one column of weights, a frame of a drag what
    the handles that move cost, however many others rest.

    Every change is a step that `undo` takes back, without limit. With `merge`, a change joins the step before if that
    one was about the same handle, place or setting: a drag is one plain move and then merged ones, and `undo` takes it
    back whole.

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
        asked for points in space alone. Otherwise it is asked once they are needed: with the preset "paper" for full
        ones, else above 16,384 vertices for compact ones, whose weights are within 0.01 of exact, judged by a sample
        (`features.error`).
    other_shape
        Take a field of another shape all the same.

    Raises ValueError if there is no such preset, or `features` is not finite or not one row of the field's width per
    vertex; without `features` and `other_shape`, if the field was distilled from another shape
    (`dfd.field.compatibility.check_compatible`).

    Warns
    -----
    UserWarning
        If a part of the mesh lies far outside the box of the field's shape.
    """

    # Slots alone, so that a setting with a misspelled name raises AttributeError.
    __slots__ = ("__weakref__", "_history", "_next_id", "_posed", "_weights", "field", "mesh")
    page: Callable[..., Any] | None = None  # what shows a session: `dfd` puts the app's there

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
        start = Edit(preset=preset)
        if features is None and not other_shape:
            check_compatible(self.field, self.mesh, allowed_by="other_shape=True")
        self._weights = HandleWeights(self.mesh, field, features)
        self._posed = PosedShape(self.mesh, self._weights)
        self._start(start)

    def _start(self, edit: Edit) -> None:
        self._follow(edit.preset)
        self._history = History(edit)
        self._next_id = 1 + max((handle.id for handle in edit.handles), default=0)

    def __repr__(self) -> str:
        """Say how much is being done to what."""
        counts = (len(self.handles), "handle"), (len(self.fixed), "fixed point")
        told = [f"{count} {what}" if count == 1 else f"{count} {what}s" for count, what in counts]
        return f"Deformer({self.mesh!r}, {', '.join(told)})"

    # --- steps

    @property
    def edit(self) -> Edit:
        """The present state, an immutable value."""
        return self._history.present

    @property
    def handles(self) -> tuple[Handle, ...]:
        """The live handles, in the order in which they came."""
        return self.edit.handles

    @public
    def handle(self, handle: int) -> Handle:
        """The handle of that id; ValueError if there is none."""
        return self.edit.handle(handle)

    @public
    def counterparts(self, handle: int) -> list[tuple[Counterpart, bool]]:
        """The places that look like the one a handle holds, and whether each moves along (`excluded_counterparts`).

        Its own is the first, then come the others, the most alike first. `Counterpart.vertex` and
        `Counterpart.position` say where each is.

        Raises ValueError if there is no such handle.
        """
        return self._weights.counterparts(self.edit, self.edit.handle(handle))

    @property
    def fixed(self) -> tuple[Fixed, ...]:
        """The fixed points and regions, in the order in which they came."""
        return self.edit.fixed

    @property
    def can_undo(self) -> bool:
        """Whether there is a step to take back."""
        return self._history.can_undo

    @property
    def can_redo(self) -> bool:
        """Whether there is a step that was taken back."""
        return self._history.can_redo

    def undo(self) -> bool:
        """Take the newest step back; False if there is none."""
        return self._history.undo()

    def redo(self) -> bool:
        """Take a step again that was taken back; False if there is none."""
        return self._history.redo()

    def step(self, topic: Hashable = None, *, merge: bool = False) -> AbstractContextManager[None]:
        """`with deformer.step():` makes one step of all changes inside; if one of them fails, none of them happens.

        With `merge` it joins the step before if that one was about the same `topic`, which may be anything but None.
        """
        return self._history.step(topic, merge=merge)

    def _commit(self, edit: Edit, topic: Hashable = None, merge: bool = False, *, rebinds: bool = True) -> None:
        """Take a step; one that may change weights is refused where a handle could not arrive."""
        if rebinds:
            self._weights.by_features.check_arrivals(edit)
        self._history.commit(edit, topic=topic, merge=merge)

    # --- handles

    @public
    def add(self, at: Any, *, name: str | None = None, **given: Any) -> int:
        """Take hold of the shape and return the new handle's id.

        Parameters
        ----------
        at
            A vertex index; any point (3,) in mesh units, on the surface or off it; an array of vertex indices or a
            mask (V,), or a region of `dfd.editing.influence.regions`, all of which is held; a text, see
            `dfd.editing.points.find`, or "part@1,2,3" for the part that holds a place, "piece@812" for that part
            without its counterparts.
        translation
            (3,) in mesh units.
        rotation
            (3,) rotation vector in degrees (axis times angle, right-handed), or a quaternion (x, y, z, w).
        scale
            One factor, or (3,) along `axes`, before the rotation.
        pivot
            About which it turns and scales: (3,) in mesh units; "base", where the part that it holds leaves the rest of
            the shape; the "middle" of that part; "point", the handle itself, of a region its center; "plane", the point
            of the plane of symmetry that is nearest to it; "hinge", the middle between the outermost points of the
            part's border. If left out, the base of a limb, which is longer than wide and borders on the rest once, and
            the middle of anything else, such as a wheel, on the plane of symmetry if the part lies across it; with the
            preset "paper" the handle itself.
        axes
            (3, 3) orthonormal vectors, one a row, along which it scales; "normal" for a frame whose third vector is the
            surface's normal at the handle; the mesh's own if left out.
        bend, towards
            Degrees by which the tip of the part that it holds is bent along the part's own axis, every cross-section
            moving rigidly, `towards` "up", "down", "left", "right", "front", "back" or a direction (3,), by default up,
            and where the part runs upright to the front; or a rotation vector (3,). Each counterpart bends along its
            own axis. What is bent is then moved by the rest of the transform.
        twist
            Degrees by which the tip turns about the part's own axis.
        joint
            Where along the axis bend and twist happen: "spread" over its length, as if left out, at the most bent or
            the narrowest place ("auto"), at the handle ("here"), or a number from 0 at the base to 1 at the tip.
        open
            Degrees by which it turns about its hinge, away from the rest, as a jaw opens; sets `rotation` and `pivot`.
        name
            For people.
        **given
            What follows it, as `dfd.editing.presets.CONTROLS` says: `reach`, `falloff`, `locality`,
            `radius`, `strength`, `counterparts`, `excluded_counterparts`, `mask` and `mask_feather`. What is left
            out, or None, is as the preset has it. `mask="part"` is the part that the handle is on.

        Raises ValueError if a number is not finite, of another shape or out of its range, a name is unknown, a region
        is empty, a point lies farther from the shape than the diagonal of its box, the place is taken, or fixed points
        leave nothing of the handle.
        """
        new = self._next_id
        self._commit(verbs.add(self.edit, self._weights, new, at, name=name, **given))
        self._next_id += 1
        return new

    @public
    def move(self, handle: int, *, merge: bool = False, **given: Any) -> None:
        """Set parts of a handle's transform, always from the resting shape; what is left out stays. Nothing is rebound.

        Parameters
        ----------
        handle
            The handle's id.
        translation, rotation, scale, bend, towards, twist, joint, open
            As in `add`.
        pivot, axes
            As in `add`; "auto" returns them to what they are where nothing is said.
        merge
            Join the step before if that one was about the same handle.

        Raises ValueError if there is no such handle, or a number is not finite or of another shape.
        """
        edit = verbs.move(self.edit, self._weights, handle, given)
        self._commit(edit, ("handle", handle), merge, rebinds=False)

    def bend(
        self, handle: int, angle: ArrayLike, *, towards: Any = None, joint: Any = None, merge: bool = False
    ) -> None:
        """Bend what a handle holds along its own axis, as `bend` of `add` says."""
        self.move(handle, bend=angle, towards=towards, joint=joint, merge=merge)

    def twist(self, handle: int, angle: float, *, joint: Any = None, merge: bool = False) -> None:
        """Twist what a handle holds about its own axis, as `twist` of `add` says."""
        self.move(handle, twist=angle, joint=joint, merge=merge)

    def open(self, handle: int, angle: float, *, merge: bool = False) -> None:
        """Turn what a handle holds about its hinge, as a jaw opens: `open` of `add`."""
        self.move(handle, open=angle, merge=merge)

    @public
    def change(
        self, handle: int, *, at: Any = None, name: str | None = None, merge: bool = False, **controls: Any
    ) -> None:
        """Set where a handle is, what follows it, or its name, as in `add`; what is left out stays.

        Of `radius` and `locality` the one that is given ends the other; `mask="everywhere"` takes the limit away, and
        `excluded_counterparts=[]` switches all on.

        Raises ValueError as in `add`, or if there is no such handle.
        """
        self._commit(verbs.change(self.edit, self._weights, handle, at, name, controls), ("handle", handle), merge)

    @public
    def remove(self, handle: int, *, merge: bool = False) -> None:
        """Let go of a handle; ValueError if there is no such handle."""
        self._commit(self.edit.removed(handle), ("handle", handle), merge)

    @public
    def apply(self, edit: Edit, *, merge: bool = False) -> None:
        """Replace everything by `edit`, as one step; `Edit()` clears the session.

        Its preset is the session's from then on.

        Raises ValueError if a vertex of `edit` is none of the mesh, or a region of it is empty there.
        """
        self._follow(edit.preset)
        self._commit(edit_on(self.mesh, edit), "edit", merge)
        self._next_id = max(self._next_id, 1 + max((handle.id for handle in edit.handles), default=0))

    @public
    def part(self, at: Any, *, level: Level = "part", alike: bool = True) -> VertexSet:
        """Find the part of the shape that holds a place: a region for `add`, `fix` and `mask`.

        Parameters
        ----------
        at
            As in `add`; of a region, the part that its middle is on.
        level, alike
            As in `dfd.Parts.part`.

        Raises ValueError if `at` is no place, or the mesh has no face with an area.
        """
        return verbs.part_at(self._weights, at, level, alike=alike)

    # --- the whole shape

    @property
    def preset(self) -> Preset:
        """What new handles start with and how handles act together (`dfd.editing.presets.PRESETS`).

        Setting it is one step. It also gives every handle the preset's reach, falloff and counterparts, and the plane
        its band.
        """
        return self.edit.preset

    @preset.setter
    def preset(self, preset: Preset) -> None:
        with called("Deformer.preset"):
            self._commit(with_preset(self.edit, preset, self.mesh))
            self._follow(preset)

    def _follow(self, preset: Preset) -> None:
        """Let the paper's session ask for full features, and warn where its field was distilled otherwise."""
        from dfd.distillation.settings import DistillSettings

        if preset == "paper":
            self._weights.rows.full = True
        made = self.field.settings
        paper = DistillSettings(preset="paper").as_dict() if preset == "paper" else {}
        if differ := [name for name, value in paper.items() if name != "seed" and name in made and made[name] != value]:
            more = f" and {len(differ) - 4} more settings" if len(differ) > 4 else ""
            check.warn(
                f"Deformer: `preset` 'paper' is the paper's session, but the field differs from the paper's in "
                f"{', '.join(differ[:4])}{more}; distill it with preset='paper'",
                UserWarning,
            )

    @public
    def fix(self, at: Any, *, strength: float = 1.0, merge: bool = False) -> None:
        """Hold a point or a region in place, and with it all that looks like it (Eq. 6).

        Parameters
        ----------
        at
            As in `Deformer.add`.
        strength
            In [0, 1]: how much of the weight there is taken away; 1 is Eq. 6.

        Raises ValueError if it is no place, is fixed or a handle already, `strength` lies outside [0, 1], or nothing
        would be left of a handle that is to arrive.
        """
        place = verbs.place_of(self._weights, at)
        self._commit(replace(self.edit, fixed=(*self.fixed, Fixed(place, strength))), ("fixed", place), merge)

    @public
    def release(self, at: Any, *, merge: bool = False) -> None:
        """Take back a `fix`; ValueError if that point or region is not fixed."""
        place = verbs.place_of(self._weights, at)
        self._commit(self.edit.released(place), ("fixed", place), merge)

    @property
    def symmetry(self) -> SymmetryPlane | None:
        """The plane across which handles act on both sides, or None; set as by `set_symmetry`."""
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
            A plane; "x", "y" or "z" for the plane across that axis through the center of the box; "x=0.1" for one
            elsewhere along it; "auto" for the plane across which the shape looks most alike; None for no symmetry.
        band
            Half width, in mesh units, of the zone in which the sides blend; 0 is Eq. 8 to the letter, which tears what
            lies across the plane. If left out: the plane's own, or for a text the preset's.
        candidates, threshold
            What "auto" chooses from, as `dfd.symmetry_planes` takes them; the preset's if left out.

        Raises ValueError if it is no such plane, `band` is negative or not finite, "auto" finds no plane, or
        `candidates` or `threshold` is given for another one.
        """
        how: dict[str, Any] = {"candidates": candidates, "threshold": threshold}
        self._commit(verbs.set_symmetry(self.edit, self._weights, plane, band, **how), "symmetry", merge)

    @property
    def default(self) -> Transform | None:
        """D₀ of Eq. 1, what happens to what no handle holds; None is nothing."""
        return self.edit.default

    @public
    def set_default(self, *, merge: bool = False, **given: Any) -> None:
        """Set D₀ of Eq. 1, what happens to what no handle holds; with nothing given it stays where it is.

        The pivot is the center of the box if left out; the rest is as in `Deformer.add`.

        Raises ValueError if a number is not finite or of another shape.
        """
        self._commit(verbs.set_default(self.edit, self._weights, given), "default", merge)

    # --- what comes of it

    def prepare(self, progress: Callable[[int], object] | None = None) -> None:
        """Ask the field for the vertices' features now rather than when they are first needed.

        It is the one long step of a session; `progress` is called with the number of further vertices that are done.
        """
        self._weights.rows.prepare(progress)

    @property
    def features(self) -> Float32 | CompactFeatures:
        """(V, D) features of the vertices, what `dfd.bind` takes: full unit rows or compact ones, see `Deformer`."""
        return self._weights.rows.features

    @property
    def weights(self) -> Float32:
        """(V, H) weights of the handles, in the order of `handles`, column-major and read-only, fixed once given."""
        return self._weights.by_features.of(self.edit)[0]

    @property
    def following(self) -> Float32:
        """(V, H) how much vertices follow each handle: `weights`, less what their counterparts change of them."""
        return self._weights.following(self.edit)

    @property
    def bound(self) -> HandleWeights:
        """The weights with all that they are made of, for programs that show them."""
        return self._weights

    @property
    def transforms(self) -> Float64:
        """(H, 3, 4) affine transforms of the handles, mesh units, in the order of `handles`."""
        return np.array([handle.matrix for handle in self.handles]).reshape(-1, 3, 4)

    @property
    def vertices(self) -> Float64:
        """(V, 3) the posed shape in mesh units, read-only: Eq. 1 and 8, as the preset has them."""
        return self._posed.of(self.edit)

    def report(self) -> Report:
        """What the present edit does to the shape, for people: how much moved, how far, and whether handles arrived."""
        return report(self.mesh, self.edit, self._weights, self.vertices)

    def show(self, *, height: int = 640) -> Any:
        """Show the session in a cell of a notebook, where it can be gone on with; see `dfd.app.show`."""
        if Deformer.page is None:
            raise ValueError("Deformer.show: the app shows a session: import dfd.app, or call dfd.app.show(session)")
        return Deformer.page(self, height=height)

    # --- files

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the present edit, without its history, as the JSON document of `dfd.editing.edit_file`.

        Where the field was read from a file it says which one, and which one the mesh was read from.

        Raises OSError if `path` cannot be written; a file that was there stays as it was.
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
        """Open a session with the edit in `path`, made on `mesh` or on another resolution of the same shape.

        With `other_shape` an edit or a field of another shape is taken all the same: places go by their positions, and
        lengths stay what they are. `dfd.editing.transfer` carries an edit over by what things look like.

        Raises OSError if `path` cannot be read. Raises ValueError if it is no edit, or one of another shape; the
        message names the key and what was found there. Warns if a vertex of the edit is no longer where it was, and
        counts as a point of space.
        """
        deformer = cls(mesh, field, features=features, other_shape=other_shape)
        deformer._start(read_edit(path, deformer.mesh, other_shape=other_shape))
        return deformer
