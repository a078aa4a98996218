"""The controls of a handle, which shape its weights."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any

from dfd.common import check
from dfd.common.described import Brief, Tagged, check_fields
from dfd.common.errors import ArgumentError, within
from dfd.common.preset import Preset
from dfd.editing.influence.regions import Region
from dfd.editing.points import Place, place_on
from dfd.editing.presets import CONTROLS, PRESETS, Counterparts, Reach
from dfd.weights.bind import Falloff

if TYPE_CHECKING:
    from dfd.mesh.mesh import Mesh

__all__ = ["Controls", "Counterparts", "Falloff", "controls_of", "controls_on", "length_on"]

DEFAULTS = PRESETS["default"]


@dataclass(frozen=True, repr=False)
class Controls(Brief):
    """The controls of a handle; `dfd.editing.presets.CONTROLS` describes each field.

    The preset "default" gives the values that are left out. Lengths are in mesh units. Only one of `radius` and
    `locality` may be given.

    Raises ValueError if a number is out of its bounds, a name is unknown, or a place or a region is invalid.
    """

    reach: Annotated[Reach, CONTROLS["reach"]] = DEFAULTS.reach
    falloff: Annotated[Falloff, CONTROLS["falloff"]] = DEFAULTS.falloff
    locality: Annotated[float, CONTROLS["locality"]] = 0.0
    radius: Annotated[float | None, CONTROLS["radius"]] = None
    strength: Annotated[float, CONTROLS["strength"]] = 1.0
    counterparts: Annotated[Counterparts, CONTROLS["counterparts"]] = DEFAULTS.counterparts
    excluded_counterparts: Annotated[tuple[Place, ...], CONTROLS["excluded_counterparts"]] = ()
    mask: Annotated[Annotated[Region, Tagged("kind")] | None, CONTROLS["mask"]] = None
    mask_feather: Annotated[float, CONTROLS["mask_feather"]] = 0.0

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
        """Return the controls that shape the column of weights, with defaults in place of all others."""
        return Controls(**{name: getattr(self, name) for name, said in CONTROLS.items() if said.affects == "weights"})

    def changed(self, **given: Any) -> Controls:
        """Return changed controls. None keeps a value; of `radius` and `locality`, giving one resets the other.

        Raises ValueError as `Controls` does.
        """
        parts = {name: value for name, value in given.items() if value is not None}
        if "radius" in parts and "locality" not in parts:
            parts["locality"] = 0.0
        elif "locality" in parts and "radius" not in parts:
            parts["radius"] = None
        if isinstance(parts.get("mask"), str):  # "everywhere"
            parts["mask"] = None
        return replace(self, **parts) if parts else self


def controls_of(preset: Preset) -> Controls:
    """Return the controls of a new handle."""
    return Controls(**PRESETS[preset].handle)


def controls_on(mesh: Mesh, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the controls in `given` for `Controls.changed`, without those that are None.

    Lengths become mesh units; regions and places become those of `mesh`.

    Raises ValueError if a length is neither a number nor a percentage, or `excluded_counterparts` is no list of points.
    Raises ValueError if `mask` is no region or holds no vertex. Raises TypeError if a control is unknown.
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
    """Return the places of a list, without duplicates."""
    if isinstance(places, str) or not isinstance(places, Iterable) or getattr(places, "ndim", 1) == 0:
        raise ArgumentError("excluded_counterparts", f"must be a list of vertices or points, got {places!r}")
    found = tuple(dict.fromkeys(place_on(mesh, at) for at in places))
    if any(place.region is not None for place in found):
        raise ArgumentError("excluded_counterparts", "must be a list of vertices or points, got a region")
    return found


def length_on(mesh: Mesh, name: str, value: Any) -> float:
    """Return a length in mesh units, from a number or a text such as "20%" of the diagonal of the mesh's box.

    Raises ValueError if `value` is neither, or out of the bounds of the control `name`.
    """
    length, unit = value, 1.0
    if isinstance(value, str):
        try:
            length, unit = float(value.removesuffix("%")), mesh.diagonal / 100 if value.endswith("%") else 1.0
        except ValueError:
            raise ArgumentError(name, f"must be a length or a percentage such as 20%, got {value!r}") from None
    return unit * check.number(None, name, length, minimum=0.0, exclusive=CONTROLS[name].exclusive)
