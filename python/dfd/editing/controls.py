"""The controls of a handle: their types, defaults and descriptions, for every interface."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any

from dfd.common import check
from dfd.common.described import About, Brief, Tagged, about, check_fields
from dfd.common.errors import ArgumentError, within
from dfd.common.preset import Preset
from dfd.editing.points import Place, place_on
from dfd.editing.presets import PRESETS, Counterparts, Reach
from dfd.editing.regions import Region
from dfd.segmentation.follow import Follow
from dfd.weights.bind import Falloff

if TYPE_CHECKING:
    from dfd.mesh.mesh import Mesh

DEFAULTS = PRESETS["default"]


@dataclass(frozen=True, repr=False)
class Controls(Brief):
    """The controls of a handle.

    Values that are left out are those of the preset "default". Lengths are in mesh units. `radius` and `locality` must
    not be given together.

    Raises ValueError if a number is out of its bounds, a word is unknown, or a place or a region is invalid.
    """

    reach: Annotated[
        Reach,
        About(
            'Feature distance at which the weight is 0 (1 in Eq. 5). With "part", weights end at the part\'s border.',
            0.0,
            check.LARGEST,
            exclusive=True,
            metavar="R|part",
            slider=(0.05, 1.5, 0.01),
        ),
    ] = DEFAULTS.reach
    falloff: Annotated[
        Falloff,
        About(
            "Curve of the weight from 1 at the handle to 0 at a numeric reach: linear (Eq. 5), smooth, sharp, root, "
            "sphere or constant.",
            metavar="CURVE",
        ),
    ] = DEFAULTS.falloff
    locality: Annotated[
        float,
        About(
            "λ of Eq. 7: a higher value lowers the weights of distant surface more; 0 ignores the distance.",
            0.0,
            check.LARGEST,
            metavar="λ",
            slider=(0.0, 20.0, 0.5),
        ),
    ] = 0.0
    radius: Annotated[
        float | None,
        About(
            "Replaces locality: the distance along the surface at which the weight smoothly reaches 0, in mesh units "
            "or % of the bounding box's diagonal.",
            0.0,
            check.LARGEST,
            exclusive=True,
            metavar="R|P%",
            unit="length",
            slider=(0.0, 1.0, 0.01),
        ),
    ] = None
    strength: Annotated[
        float, About("Factor from 0 to 1 for the handle's weights.", 0.0, 1.0, metavar="S", slider=(0.0, 1.0, 0.05))
    ] = 1.0
    level: Annotated[
        int,
        About(
            "Size of the part at the handle: 0 for the most likely part, −1 for the next smaller one, 1 for the next "
            "larger one, and so on.",
            metavar="N",
        ),
    ] = 0
    follow: Annotated[
        Follow,
        About(
            "Who follows the handle: all parts that look alike, only mirror images of its part, or none.",
            metavar="all|mirror|none",
            affects="pose",
            label="Who follows",
        ),
    ] = "all"
    counterparts: Annotated[
        Counterparts,
        About(
            "How counterparts move: about their own pivots, or about the handle's pivot, as in the paper "
            "(shared_pivot).",
            metavar="own_pivot|shared_pivot",
            affects="pose",
            label="Counterparts",
        ),
    ] = DEFAULTS.counterparts
    excluded_counterparts: Annotated[
        tuple[Place, ...],
        About("Place on a counterpart that does not follow.", metavar="PLACE", repeated=True, affects="pose"),
    ] = ()
    detach: Annotated[
        bool,
        About(
            "Whether contacts of the part with other pieces of the mesh open, instead of stretching. Small pieces that "
            "touch only the part then stay in place.",
            affects="pose",
        ),
    ] = False
    mask: Annotated[
        Annotated[Region, Tagged("kind")] | None,
        About(
            "Region outside which no vertex follows: part (the handle's part), part:NAME, group:NAME, 'x>0', "
            "ball:x,y,z,r or box:x,y,z,x,y,z.",
            metavar="REGION",
        ),
    ] = None
    mask_feather: Annotated[
        float,
        About(
            "Width of the fade to 0 outside the mask, in mesh units or % of the bounding box's diagonal.",
            0.0,
            check.LARGEST,
            metavar="W|P%",
            unit="length",
            label="Limit's edge",
            slider=(0.0, 0.3, 0.005),
        ),
    ] = 0.0

    def __post_init__(self) -> None:
        check_fields(self)
        if self.radius is not None and self.locality != 0.0:
            both = f"{self.radius:g} and {self.locality:g}"
            raise ArgumentError("radius", f"and `locality` must not be given both, got {both}", "Controls")
        off: object = self.excluded_counterparts
        if not isinstance(off, tuple) or any(not isinstance(one, Place) or one.region is not None for one in off):
            raise ArgumentError("excluded_counterparts", f"must be places that are points, got {off!r}", "Controls")
        if self.mask is not None and not isinstance(self.mask, Region):
            raise ArgumentError("mask", f"must be a region, got {type(self.mask).__name__}", "Controls")

    @cached_property
    def of_column(self) -> Controls:
        """Return a copy in which all controls that do not change weights have their defaults."""
        return Controls(**{name: getattr(self, name) for name, said in CONTROLS.items() if said.affects == "weights"})

    def changed(self, **given: Any) -> Controls:
        """Return the controls with the `given` values; a value of None changes nothing.

        A new `radius` resets `locality`, and a new `locality` resets `radius`. Raises ValueError as `Controls` does.
        """
        parts = {name: value for name, value in given.items() if value is not None}
        if "radius" in parts and "locality" not in parts:
            parts["locality"] = 0.0
        elif "locality" in parts and "radius" not in parts:
            parts["radius"] = None
        if isinstance(parts.get("mask"), str):  # the text "everywhere" removes the mask
            parts["mask"] = None
        return replace(self, **parts) if parts else self


# The command-line help needs this table, so this module imports neither SciPy nor pydantic: both import slowly.
CONTROLS = {name: said for name, (_, said) in about(Controls).items() if said is not None}


_OF_PRESET = {preset: Controls(**rules.handle) for preset, rules in PRESETS.items()}


def controls_of(preset: Preset) -> Controls:
    """Return the controls that a new handle has in a preset."""
    return _OF_PRESET[preset]


def controls_on(mesh: Mesh, given: Mapping[str, Any]) -> dict[str, Any]:
    """Convert the `given` controls to arguments of `Controls.changed`. Controls that are None are left out.

    Lengths are converted to mesh units, `mask` to a region, and `excluded_counterparts` to places on `mesh`.

    Raises ValueError if a length is neither a number nor a percentage, or `excluded_counterparts` is no list of points.
    Raises ValueError if `mask` is no region or contains no vertex. Raises TypeError if a control is unknown.
    """
    found = {name: value for name, value in dict(given).items() if value is not None}
    check.keywords(found, CONTROLS, "control of a handle")
    for name, value in found.items():
        if name == "excluded_counterparts":
            found[name] = _points_on(mesh, value)
        elif CONTROLS[name].unit == "length":
            found[name] = length_on(mesh, name, value)
        elif name == "mask" and not (isinstance(value, str) and value == "everywhere"):
            with within(name):
                found[name] = place_on(mesh, value).region
            if found[name] is None:
                raise ArgumentError("mask", f"must be a region, got {value!r}")
    return found


def _points_on(mesh: Mesh, places: Any) -> tuple[Place, ...]:
    """Return the places (`Place`) for a list of vertices or points, without duplicates."""
    if isinstance(places, str) or not isinstance(places, Iterable) or getattr(places, "ndim", 1) == 0:
        raise ArgumentError("excluded_counterparts", f"must be a list of vertices or points, got {places!r}")
    found = tuple(dict.fromkeys(place_on(mesh, at) for at in places))
    if any(place.region is not None for place in found):
        raise ArgumentError("excluded_counterparts", "must be a list of vertices or points, got a region")
    return found


def length_on(mesh: Mesh, name: str, value: Any) -> float:
    """Return the length `value` of the control `name` in mesh units.

    `value` is a number in mesh units, or a text such as "20%": a percentage of the diagonal of the bounding box.

    Raises ValueError if `value` is neither a number nor such a text, or is out of the control's bounds.
    """
    length, unit = value, 1.0
    if isinstance(value, str):
        try:
            length, unit = float(value.removesuffix("%")), mesh.diagonal / 100 if value.endswith("%") else 1.0
        except ValueError:
            raise ArgumentError(name, f"must be a length or a percentage such as 20%, got {value!r}") from None
    return unit * check.number(None, name, length, minimum=0.0, exclusive=CONTROLS[name].exclusive)
