"""The part of a session that holds for the whole shape: fixed points, symmetry, how handles are put together, D₀."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

from numpy.typing import ArrayLike

from dfd.common.preset import Preset
from dfd.editing.controls import Blend, Overlap
from dfd.editing.door import door
from dfd.editing.edit import Fixed, box_center, symmetry_on, with_preset
from dfd.editing.place import place_on
from dfd.editing.presets import SymmetryCandidates
from dfd.editing.steps import Steps
from dfd.posing.transforms import Transform
from dfd.symmetry.plane import SymmetryPlane

if TYPE_CHECKING:
    from dfd.field.field import Field

__all__ = ["WholeShape"]


class WholeShape(Steps):
    """What is set once for all handles of a session; every setting is a step."""

    field: Field

    @property
    def preset(self) -> Preset:
        """What new handles start with: "default", or "paper" for Eq. 1 and 4 to 8 to the letter.

        Set, it puts everything that the preset says (`dfd.editing.presets.PRESETS`) in the place of what was there: how
        handles are put together, the band of the plane, and reach, falloff and instances of every handle. It is one
        step, and each of them can be set apart afterwards.
        """
        return self.edit.preset

    @preset.setter
    def preset(self, preset: Preset) -> None:
        with door("Deformer.preset"):
            self._commit(with_preset(self.edit, preset, self.mesh))

    def fix(self, at: Any, *, strength: float = 1.0) -> None:
        """Hold a point or a region in place, and with it all that looks like it (Eq. 6).

        Parameters
        ----------
        at
            As in `Deformer.add`.
        strength
            In [0, 1]: how much of the weight there is taken away; 1 is Eq. 6.

        Raises
        ------
        ValueError
            If it is no place, is fixed or a handle already, `strength` lies outside [0, 1], or nothing would be left of
            a handle that is to arrive.
        """
        with door("Deformer.fix"):
            fixed = Fixed(place_on(self.mesh, at), strength)
            self._commit(replace(self.edit, fixed=(*self.fixed, fixed)))

    def release(self, at: Any) -> None:
        """Take back a `fix`.

        Raises
        ------
        ValueError
            If that point or region is not fixed.
        """
        with door("Deformer.release"):
            self._commit(self.edit.released(place_on(self.mesh, at)))

    @property
    def symmetry(self) -> SymmetryPlane | None:
        """The plane across which handles act on both sides, or None; set as by `set_symmetry`."""
        return self.edit.symmetry

    @symmetry.setter
    def symmetry(self, plane: SymmetryPlane | str | None) -> None:
        with door("Deformer.symmetry"):
            self._set_symmetry(plane)

    def set_symmetry(
        self,
        plane: SymmetryPlane | str | None,
        *,
        band: float | None = None,
        candidates: SymmetryCandidates | None = None,
        threshold: float | Literal["relative"] | None = None,
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

        Raises
        ------
        ValueError
            If it is no such plane, `band` is negative or not finite, "auto" finds no plane, or `candidates` or
            `threshold` is given for another one.
        """
        with door("Deformer.set_symmetry"):
            self._set_symmetry(plane, band=band, candidates=candidates, threshold=threshold)

    def _set_symmetry(self, plane: SymmetryPlane | str | None, **how: Any) -> None:
        how |= {"field": self.field, "preset": self.preset}
        chosen = None if plane is None else symmetry_on(self.mesh, plane, **how)
        self._commit(replace(self.edit, symmetry=chosen))

    @property
    def overlap(self) -> Overlap:
        """How weights that meet are put together.

        "add": displacements add, and handles at rest change nothing. "interpolate": every handle lands where it was
        sent. "normalize": weights that sum to more than 1 are divided by their sum. "paper": Eq. 1 to the letter.
        """
        return self.edit.overlap

    @overlap.setter
    def overlap(self, overlap: Overlap) -> None:
        with door("Deformer.overlap"):
            self._commit(replace(self.edit, overlap=overlap))

    @property
    def blend(self) -> Blend:
        """How transforms are blended: "linear" (Eq. 1), "dual_quaternion" or "polar"."""
        return self.edit.blend

    @blend.setter
    def blend(self, blend: Blend) -> None:
        with door("Deformer.blend"):
            self._commit(replace(self.edit, blend=blend))

    @property
    def arrive(self) -> bool:
        """Whether handles arrive where they are sent although fixed points take from them.

        If so, a handle's weights are divided by what the fixed points leave of them at the handle; at most 1. If not,
        they are those of Eq. 6, and fixed points shorten the move.
        """
        return self.edit.arrive

    @arrive.setter
    def arrive(self, arrive: bool) -> None:
        with door("Deformer.arrive"):
            self._commit(replace(self.edit, arrive=arrive))

    @property
    def mirrored_locality(self) -> bool:
        """Whether locality and radius are measured from a handle's mirror image as well, where there is a plane.

        If not, they are measured from the handle alone (Eq. 7), and what a handle moves on the other side of the plane
        loses its weight with the way around to it.
        """
        return self.edit.mirrored_locality

    @mirrored_locality.setter
    def mirrored_locality(self, mirrored_locality: bool) -> None:
        with door("Deformer.mirrored_locality"):
            self._commit(replace(self.edit, mirrored_locality=mirrored_locality))

    @property
    def bridges(self) -> bool:
        """Whether distances along the surface cross small gaps between components, as `dfd.Geodesics` says."""
        return self.edit.bridges

    @bridges.setter
    def bridges(self, bridges: bool) -> None:
        with door("Deformer.bridges"):
            self._commit(replace(self.edit, bridges=bridges))

    @property
    def default(self) -> Transform | None:
        """D₀ of Eq. 1, what happens to what no handle holds; None is nothing."""
        return self.edit.default

    def set_default(
        self,
        *,
        translation: ArrayLike | None = None,
        rotation: ArrayLike | None = None,
        scale: ArrayLike | None = None,
        pivot: ArrayLike | None = None,
    ) -> None:
        """Set D₀ of Eq. 1, what happens to what no handle holds; with nothing given it stays where it is.

        The pivot is the center of the box if left out; the rest is as in `Deformer.add`.

        Raises
        ------
        ValueError
            If a number is not finite or of another shape.
        """
        with door("Deformer.set_default"):
            transform = Transform().changed(translation=translation, rotation=rotation, scale=scale, pivot=pivot)
            transform.matrix(box_center(self.mesh))
            self._commit(replace(self.edit, default=None if transform == Transform() else transform))
