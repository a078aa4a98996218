"""Define `Transform`: translation, rotation and scale about a pivot, as a (3, 4) affine matrix for `dfd.pose`.

A rotation is a *rotation vector in degrees*: its direction is the axis and its length the angle, right-handed.
(0, 90, 0) rotates by 90° about y. Rotation vectors need no order of axes and have no gimbal lock. Half the vector is
half the rotation, and angles can exceed 360°. A rotation can also be given as a quaternion (x, y, z, w), the order of
glTF. It is converted to a rotation vector, and so is a
`scipy.spatial.transform.Rotation`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from dfd.common import check
from dfd.common.described import About, Brief, Written
from dfd.common.errors import ArgumentError
from dfd.common.linear_algebra import Float64
from dfd.common.read_only import ReadOnlyArrays
from dfd.posing.arguments import read_affine
from dfd.posing.polar import polar_decomposition

Vector = tuple[float, float, float]
Frame = tuple[Vector, Vector, Vector]  # three orthonormal vectors
PivotAt = Literal["base", "middle", "point", "plane", "hinge"]

NOT_UNIT = 1e-3  # a quaternion whose length differs from 1 by more than this gives a warning
DIAGONAL = 1e-12  # entries of a stretch beside its diagonal, up to this fraction of the largest one, count as 0
LARGEST_ANGLE = 1e9  # degrees; for larger angles, float64 has too few digits to remove whole turns

# A description of each motion of a handle. `towards` and `open` are converted to fields of `Transform`; all others are
# such fields.
_of_pose, _of_part = partial(About, affects="pose"), partial(About, affects="pose", of_part=True)
MOTIONS = {
    "translation": _of_pose("Move the handle, in mesh units.", metavar="X Y Z", option="translate", unit="length"),
    "rotation": _of_pose(
        "Rotate the handle: the vector's direction is the axis, and its length the angle in degrees.",
        metavar="X Y Z",
        option="rotate",
        unit="angle",
    ),
    "scale": _of_pose("Scale the handle: one factor, or three along the axes.", metavar="S | X Y Z"),
    "pivot": _of_pose(
        "Center of rotation and scale; by default the base of a limb, and the middle of other parts.",
        metavar="X Y Z|base|middle|point|plane|hinge",
        unit="position",
    ),
    "axes": _of_pose(
        "Use the surface's normal at the handle as the third axis of scale, instead of z.", metavar="normal"
    ),
    "bend": _of_part(
        "Bend the held part along its own axis: the angle by which its tip rotates.", metavar="DEGREES", unit="angle"
    ),
    "towards": _of_part(
        "Direction in which --bend moves the tip; by default up, or to the front if the part is upright.",
        metavar="up|down|left|right|front|back|X Y Z",
    ),
    "twist": _of_part("Twist the held part about its own axis.", metavar="DEGREES", unit="angle"),
    "joint": _of_part(
        "Position of the bend on the axis: the whole length (spread), the place where the part is already bent or "
        "narrow (auto), the place of the handle (here), or a number from 0 (base) to 1 (tip).",
        0.0,
        1.0,
        metavar="spread|auto|here|0…1",
    ),
    "open": _of_part(
        "Rotate the held part about its hinge, away from the rest of the shape, as a jaw opens.",
        metavar="DEGREES",
        unit="angle",
    ),
}


@dataclass(frozen=True, repr=False)
class Transform(ReadOnlyArrays, Brief):
    """Scale, then rotation, then translation, about a pivot: p ↦ pivot + translation + R A S Aᵀ (p − pivot).

    R rotates, S scales, and the columns of A are `axes`. Before this map, bend and twist move the held part:
    the vertices with at least half of the handle's largest weight.

    Raises ValueError if an attribute has a wrong array shape, is not finite or exceeds `check.LARGEST`. Raises
    ValueError if a rotation is the quaternion 0 or outside ±1e9 degrees, or `axes` are not orthonormal. Raises
    ValueError if `pivot_at` is unknown, `pivot_at` is given without `pivot`, or `joint` lies outside [0, 1].

    Parameters
    ----------
    translation
        (3,) in mesh units.
    rotation
        (3,) rotation vector in degrees, a quaternion (x, y, z, w), or a `scipy.spatial.transform.Rotation`.
    scale
        One factor, or (3,) along `axes`. 0 flattens, a negative factor mirrors.
    pivot, pivot_at
        (3,) center of rotation and scale in mesh units, and the name of this place; None is the handle's position.
    axes
        (3, 3) orthonormal vectors, one per row; None stands for the axes of the mesh.
    bend, twist
        The rotation of the held part's tip, as a rotation vector (3,) in degrees, and its angle about the part's axis.
    joint
        The position of bend and twist on the axis, from base (0) to tip (1); None distributes them over its length.
    """

    translation: Annotated[Vector, MOTIONS["translation"]] = (0.0, 0.0, 0.0)  # in mesh units
    # A rotation vector in degrees. A quaternion (x, y, z, w) is converted to the shorter rotation.
    rotation: Annotated[Vector, Written(tuple[float, ...]), MOTIONS["rotation"]] = (0.0, 0.0, 0.0)
    # Factors along `axes`; one number becomes three. 0 flattens, a negative factor mirrors.
    scale: Annotated[Vector, Written(float | Vector), MOTIONS["scale"]] = (1.0, 1.0, 1.0)
    # In mesh units. None is the handle's position, or in an edit's default transform, the center of the bounding box.
    pivot: Annotated[Vector | None, MOTIONS["pivot"]] = None
    # Three orthonormal vectors along which `scale` acts, the columns of A; None is the mesh's axes.
    axes: Annotated[Frame | None, MOTIONS["axes"]] = None
    # The name of the pivot, as in `Deformer.add`; None if the pivot was given as a position.
    pivot_at: Annotated[PivotAt | None, _of_part("Place of the pivot on the held part, as a word such as base.")] = None
    bend: Annotated[Vector, MOTIONS["bend"]] = (0.0, 0.0, 0.0)  # rotation vector of the held part's tip, in degrees
    twist: Annotated[float, MOTIONS["twist"]] = 0.0  # rotation of the tip about the part's axis, in degrees
    # The position of bend and twist on the axis, from base (0) to tip (1); None distributes them over its length.
    joint: Annotated[float | None, MOTIONS["joint"]] = None
    linear: Float64 = field(init=False, repr=False, compare=False)  # (3, 3) read-only, R A S Aᵀ

    def __post_init__(self) -> None:
        """Check the attributes, and compute `linear`, which does not depend on the pivot."""
        keep = object.__setattr__
        keep(self, "translation", vector("translation", self.translation))
        keep(self, "rotation", rotation_vector(self.rotation))
        keep(
            self, "scale", _triple(np.broadcast_to(_numbers("scale", self.scale, ((), (3,)), "one number or 3"), (3,)))
        )
        if self.pivot is not None:
            keep(self, "pivot", vector("pivot", self.pivot))
        for name, numbers in (("translation", self.translation), ("scale", self.scale), ("pivot", self.pivot)):
            check.bounded("Transform", name, numbers or (0.0,))
        if self.axes is not None:
            rows = check.array("Transform", "axes", self.axes, (3, 3), dtype=np.float64)
            check.bounded("Transform", "axes", rows.ravel().tolist())  # so that the products do not overflow
            if np.abs(rows @ rows.T - np.eye(3)).max() > 1e-6:
                raise ArgumentError("axes", f"must be 3 unit vectors at right angles, got {rows.tolist()}", "Transform")
            keep(self, "axes", tuple(_triple(row) for row in rows))
        if self.pivot_at is not None:
            check.choice("Transform", "pivot_at", self.pivot_at, PivotAt)
            if self.pivot is None:
                raise ArgumentError("pivot", "must be given when `pivot_at` is", "Transform")
        keep(self, "bend", _angles("bend", self.bend))
        most = LARGEST_ANGLE
        keep(self, "twist", check.number("Transform", "twist", self.twist, minimum=-most, maximum=most))
        if self.joint is not None:
            keep(self, "joint", check.number("Transform", "joint", self.joint, minimum=0.0, maximum=1.0))
        keep(self, "linear", _linear(self.rotation, self.scale, self.axes))

    @classmethod
    def of_matrix(cls, matrix: ArrayLike, pivot: ArrayLike = (0.0, 0.0, 0.0)) -> Transform:
        """Return the transform with an affine `matrix` (3, 4) or (4, 4) in mesh units, about a `pivot` (3,).

        The linear part A = R S is divided into a rotation R and a stretch S along `axes`, the polar decomposition. A
        reflection becomes negative factors of `scale`.

        Raises ValueError if `matrix` has another array shape, is not finite, or has another bottom row than 0 0 0 1.
        """
        affine = read_affine("Transform", "matrix", matrix, None)[0]
        at = np.asarray(vector("pivot", pivot))
        translation = affine[:, :3] @ at + affine[:, 3] - at
        return cls(**_polar(affine[:, :3]), translation=_triple(translation), pivot=_triple(at))

    def with_matrix(self, matrix: ArrayLike, position: Vector) -> Transform:
        """Return the transform of a handle at `position` with another `matrix`; its pivot, bend and twist are kept.

        Raises ValueError as `of_matrix` does.
        """
        made = Transform.of_matrix(matrix, position if self.pivot is None else self.pivot)
        return replace(self, **{name: getattr(made, name) for name in ("translation", "rotation", "scale", "axes")})

    def changed(self, *, pivot_at: PivotAt | None = None, **given: Any) -> Transform:
        """Return the transform with the `given` attributes. An attribute that is None in `given` does not change.

        "auto" sets `pivot` or `axes` to None, and "spread" sets `joint` to None. `pivot_at` is the name of a new
        `pivot`. If it is left out, a new pivot has no name.

        Warns if `scale` becomes 0 in all directions. Raises ValueError as `Transform` does.
        """
        changes: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
        for name in ("pivot", "axes"):
            if isinstance(changes.get(name), str) and changes[name] == "auto":
                changes[name] = None
        if "pivot" in changes and (
            pivot_at is not None or changes["pivot"] is None or not np.array_equal(changes["pivot"], self.pivot or ())
        ):
            changes["pivot_at"] = pivot_at
        if changes.get("joint") == "spread":
            changes["joint"] = None
        result = replace(self, **changes) if changes else self
        if "scale" in changes and not any(result.scale):
            check.warn("Transform: `scale` is 0, so the held part collapses into its pivot", UserWarning)
        return result

    @property
    def rests(self) -> bool:
        """Return whether the transform moves no point, for any pivot and axes."""
        return self.translation == (0.0, 0.0, 0.0) and not self.turns and not self.bends

    @property
    def turns(self) -> bool:
        """Return whether the transform rotates or scales, so that its pivot matters."""
        return self.rotation != (0.0, 0.0, 0.0) or self.scale != (1.0, 1.0, 1.0)

    @property
    def bends(self) -> bool:
        """Return whether the transform bends or twists the held part."""
        return self.bend != (0.0, 0.0, 0.0) or self.twist != 0.0

    def matrix(self, center: Vector = (0.0, 0.0, 0.0)) -> Float64:
        """Return the (3, 4) affine matrix in mesh units. If `pivot` is None, the pivot is `center`.

        Raises ValueError if the matrix is not finite because `center` is too large.
        """
        pivot = np.asarray(center if self.pivot is None else self.pivot)
        matrix = np.empty((3, 4))
        matrix[:, :3] = self.linear
        with np.errstate(over="ignore", invalid="ignore"):
            matrix[:, 3] = pivot + np.asarray(self.translation) - self.linear @ pivot
        if not np.isfinite(matrix).all():
            reason = "is too large with this `scale` and `pivot`: the matrix is not finite"
            raise ArgumentError("translation", reason, "Transform")
        matrix.flags.writeable = False
        return matrix


def rotation_matrix(rotation: ArrayLike) -> Float64:
    """Return the matrix R (3, 3) of a rotation vector in degrees or a quaternion (x, y, z, w).

    Raises ValueError if `rotation` has neither 3 nor 4 finite numbers, or is the quaternion 0.
    """
    from scipy.spatial.transform import Rotation  # slow to import; the help of the command line does not need it

    degrees = np.asarray(rotation_vector(rotation))
    angle = float(np.linalg.norm(degrees))
    # Whole turns are exact in degrees, so they are removed before the conversion to radians.
    within = degrees if angle < 360.0 else degrees * (np.fmod(angle, 360.0) / angle)
    return Rotation.from_rotvec(within, degrees=True).as_matrix()


def rotation_vector(rotation: ArrayLike) -> Vector:
    """Return `rotation` as a rotation vector in degrees; a quaternion is converted to the shorter rotation."""
    wanted = "a rotation vector in degrees (3 numbers) or a quaternion x y z w (4 numbers)"
    rotation = rotvec_of(rotation)
    numbers = _numbers("rotation", rotation, ((3,), (4,)), wanted)
    if len(numbers) == 3:
        return _angles("rotation", numbers)
    from scipy.spatial.transform import Rotation

    largest = np.abs(numbers).max()
    if largest == 0.0:
        raise ArgumentError("rotation", "must be a quaternion other than 0", "Transform")
    # The division prevents overflow and underflow of the squares.
    length = float(largest * np.linalg.norm(numbers / largest))
    if abs(length - 1.0) > NOT_UNIT:
        check.warn(f"Transform: `rotation` is a quaternion of length {length:.3g}, normalized to 1", UserWarning)
    return _triple(Rotation.from_quat(numbers / largest).as_rotvec(degrees=True))


def rotvec_of(value: Any) -> Any:
    """Return `value`, or the rotation vector in degrees of one `scipy.spatial.transform.Rotation`."""
    return value.as_rotvec(degrees=True) if hasattr(value, "as_rotvec") else value


def _polar(linear: Float64) -> dict[str, Any]:
    """Return `rotation`, `scale` and `axes` of a linear map (3, 3). If the stretch is diagonal, `axes` is None."""
    from scipy.spatial.transform import Rotation

    w, x, y, z, *stretch = polar_decomposition(linear[np.newaxis])[0]
    xx, yy, zz, yz, zx, xy = stretch
    symmetric = np.eye(3) + np.array([[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]])
    found: dict[str, Any] = {"rotation": _triple(Rotation.from_quat([x, y, z, w]).as_rotvec(degrees=True))}
    if max(abs(yz), abs(zx), abs(xy)) <= DIAGONAL * np.abs(symmetric).max():
        return found | {"scale": _triple(symmetric.diagonal()), "axes": None}
    sizes, columns = np.linalg.eigh(symmetric)
    columns[:, 2] *= np.sign(np.linalg.det(columns))
    return found | {"scale": _triple(sizes), "axes": tuple(_triple(axis) for axis in columns.T)}


def _angles(name: str, value: ArrayLike) -> Vector:
    angles = vector(name, rotvec_of(value))
    if max(map(abs, angles)) > LARGEST_ANGLE:
        raise ArgumentError(name, f"must stay within ±{LARGEST_ANGLE:g} degrees, got {angles}", "Transform")
    return angles


def vector(name: str, value: ArrayLike) -> Vector:
    """Return `value` as three finite numbers."""
    return _triple(_numbers(name, value, ((3,),), "3 numbers"))


def frame_of_normal(normal: ArrayLike) -> Frame:
    """Return a right-handed frame of three orthonormal vectors. The third is along `normal` (3,), which is not 0."""
    along = np.asarray(normal, np.float64)
    along = along / np.linalg.norm(along)
    # Of the coordinate axes, the one whose angle to the normal is nearest to 90° gives the most accurate result.
    beside = np.eye(3)[np.abs(along).argmin()]
    across = beside - (beside @ along) * along
    across /= np.linalg.norm(across)
    return (_triple(across), _triple(np.cross(along, across)), _triple(along))


def _linear(rotation: Vector, scale: Vector, axes: Frame | None) -> Float64:
    """Return the read-only matrix R A S Aᵀ (3, 3): R rotates, S scales, and the columns of A are `axes`."""
    linear: Float64
    if axes is None:
        linear = rotation_matrix(rotation) * np.asarray(scale)
    else:
        columns = np.asarray(axes).T
        linear = rotation_matrix(rotation) @ (columns * np.asarray(scale)) @ columns.T
    linear.flags.writeable = False
    return linear


def _numbers(name: str, value: Any, shapes: tuple[tuple[int, ...], ...], wanted: str) -> Float64:
    """Return `value` as an array of one of `shapes`, which are () or (N,); `wanted` describes them in messages."""
    single = np.isscalar(value) or getattr(value, "ndim", 1) == 0
    numbers: Float64 = check.array("Transform", name, value, () if single else ("N",), dtype=np.float64)
    numbers = numbers.reshape(()) if single else numbers
    if numbers.shape not in shapes:
        raise ArgumentError(name, f"must be {wanted}, got shape {numbers.shape}", "Transform")
    return numbers


def _triple(numbers: Float64) -> Vector:
    x, y, z = (float(number) for number in numbers)
    return (x, y, z)
