"""The part of a session that holds for the whole shape: fixed points, symmetry, how handles are put together, D₀."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike

from dfd.editing.controls import Blend, Overlap
from dfd.editing.door import door
from dfd.editing.edit import Fixed, box_center, symmetry_on
from dfd.editing.place import place_on
from dfd.editing.steps import Steps
from dfd.posing.transforms import Transform
from dfd.symmetry.plane import SymmetryPlane

if TYPE_CHECKING:
    from dfd.field.field import Field

__all__ = ["WholeShape"]


class WholeShape(Steps):
    """What is set once for all handles of a session; every setting is a step."""

    field: Field

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
            self._set_symmetry(plane, None)

    def set_symmetry(self, plane: SymmetryPlane | str | None, *, band: float | None = None) -> None:
        """Let every handle act on both sides of a plane, mirrored on the other side (Eq. 8).

        Parameters
        ----------
        plane
            A plane; "x", "y" or "z" for the plane across that axis through the center of the box; "x=0.1" for one
            elsewhere along it; "auto" for the plane across which the shape looks most alike; None for no symmetry.
        band
            Half width, in mesh units, of the zone in which the sides blend; 0 is Eq. 8 to the letter, which tears what
            lies across the plane. If left out: the plane's own, or 3 % of the longest side for an axis or "auto".

        Raises
        ------
        ValueError
            If it is no such plane, `band` is negative or not finite, or "auto" finds no plane.
        """
        with door("Deformer.set_symmetry"):
            self._set_symmetry(plane, band)

    def _set_symmetry(self, plane: SymmetryPlane | str | None, band: float | None) -> None:
        chosen = None if plane is None else symmetry_on(self.mesh, plane, band, field=self.field)
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
