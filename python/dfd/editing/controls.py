"""How a handle's weights are shaped, and how an edit's handles are put together: the choices, by the field's names."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

from dfd.common import check
from dfd.common.preset import Preset
from dfd.editing.influence.regions import Region
from dfd.editing.points import Place, place_on
from dfd.editing.presets import PRESETS, Instances
from dfd.posing.pose import Blend, Overlap
from dfd.weights.bind import Falloff

if TYPE_CHECKING:
    from dfd.mesh.mesh import Mesh

__all__ = [
    "CONTROL_NAMES",
    "Blend",
    "Controls",
    "Falloff",
    "Instances",
    "Overlap",
    "controls_of",
    "controls_on",
    "controls_with_places",
    "radius_on",
]

DEFAULTS = PRESETS["default"]
LARGEST = 1e38  # what the kernels compute with are 32-bit floats


@dataclass(frozen=True)
class Controls:
    """What a handle takes hold of besides where it is; what is left out is as the preset "default" has it.

    Attributes
    ----------
    reach
        Feature distance at which the weight is 0, above 0: W = max(1 − d / reach, 0); 1 is Eq. 5. "auto" stops at the
        largest gap of the handle's own distances (`dfd.weights.reach`), "part" takes the part that the handle is on,
        with its look-alikes, and hardly anything beyond it (`dfd.segmentation`).
    falloff
        The curve from 1 at the handle to 0 at `reach`, by the names of `dfd.bind`.
    locality
        λ of Eq. 7, at least 0: 0 reaches everything that looks alike, more stays nearer.
    radius
        Distance over the surface, mesh units, at which the weight is smoothly 0; None is no limit. It is the other
        spelling of `locality`, so only one of them may be given.
    strength
        In [0, 1], a factor for all of its weights.
    instances
        "together": all that look alike move about one pivot (the paper); "own": each about its own; "only": no other.
    level
        Whether all instances follow with full weight.
    without_instances
        Places, one on each instance that does not move along; the handle's own always does.
    within
        Region beyond which nothing follows; None is everywhere.
    within_width
        Distance beyond that region, mesh units, over which the weight falls smoothly to 0; 0 is a hard edge.
    """

    reach: float | str = DEFAULTS.reach
    falloff: Falloff = DEFAULTS.falloff
    locality: float = 0.0
    radius: float | None = None
    strength: float = 1.0
    instances: Instances = DEFAULTS.instances
    level: bool = False
    without_instances: tuple[Place, ...] = ()
    within: Region | None = None
    within_width: float = 0.0

    def __post_init__(self) -> None:
        """Check them, once."""
        keep = object.__setattr__
        if isinstance(self.reach, str) and self.reach not in ("auto", "part"):
            raise ValueError(f'Controls: `reach` must be "auto", "part" or a number above 0, got {self.reach!r}')
        if not isinstance(self.reach, str):
            reach = check.number("Controls", "reach", self.reach, minimum=0.0, maximum=LARGEST, exclusive=True)
            keep(self, "reach", reach)
        check.choice("Controls", "falloff", self.falloff, Falloff)
        keep(self, "locality", check.number("Controls", "locality", self.locality, minimum=0.0, maximum=LARGEST))
        if self.radius is not None:
            keep(self, "radius", check.number("Controls", "radius", self.radius, minimum=0.0, exclusive=True))
            if self.locality != 0.0:
                both = f"{self.radius:g} and {self.locality:g}"
                raise ValueError(f"Controls: `radius` and `locality` must not be given both, got {both}")
        keep(self, "strength", check.number("Controls", "strength", self.strength, minimum=0.0, maximum=1.0))
        check.choice("Controls", "instances", self.instances, Instances)
        if not isinstance(self.level, bool):
            raise ValueError(f"Controls: `level` must be True or False, got {self.level!r}")
        width = check.number("Controls", "within_width", self.within_width, minimum=0.0, maximum=LARGEST)
        keep(self, "within_width", width)
        off: object = self.without_instances
        if not isinstance(off, tuple) or any(not isinstance(one, Place) or one.region is not None for one in off):
            raise ValueError(f"Controls: `without_instances` must be places that are points, got {off!r}")
        if self.within is not None and not isinstance(self.within, Region):
            raise ValueError(f"Controls: `within` must be a region, got {type(self.within).__name__}")

    @cached_property
    def of_column(self) -> Controls:
        """Those that shape the column of weights: all but how instances share it."""
        return replace(self, instances="together", level=False, without_instances=())

    def changed(self, **given: Any) -> Controls:
        """The controls with some of them exchanged; None leaves one, and of `radius` and `locality` one ends the other.

        Raises
        ------
        ValueError
            As `Controls` does.
        """
        parts = {name: value for name, value in given.items() if value is not None}
        if "radius" in parts and "locality" not in parts:
            parts["locality"] = 0.0
        elif "locality" in parts and "radius" not in parts:
            parts["radius"] = None
        if isinstance(parts.get("within"), str):  # "everywhere"
            parts["within"] = None
        return replace(self, **parts) if parts else self


CONTROL_NAMES = tuple(each.name for each in fields(Controls))  # those of the arguments of `Deformer.add`, too


def controls_of(preset: Preset) -> Controls:
    """Those of a new handle."""
    return Controls(**PRESETS[preset].handle)


def controls_with_places(mesh: Mesh, controls: Controls) -> Controls:
    """`controls` with the vertices of their places where those of `mesh` lie."""
    if not controls.without_instances:
        return controls
    return replace(controls, without_instances=_points_on(mesh, controls.without_instances))


def controls_on(mesh: Mesh, given: dict[str, Any]) -> dict[str, Any]:
    """The controls of `given` as `Controls.changed` takes them: lengths in mesh units, regions and places of `mesh`.

    What else `given` holds, such as the other arguments of a call, does not count.

    Raises
    ------
    ValueError
        If a length is neither a number nor a percentage, `without_instances` is no list of points, or `within` is no
        region or holds no vertex.
    """
    found = {name: given[name] for name in CONTROL_NAMES if name in given}
    if given.get("without_instances") is not None:
        found["without_instances"] = _points_on(mesh, given["without_instances"])
    if given.get("radius") is not None:
        found["radius"] = radius_on(mesh, given["radius"])
    if given.get("within_width") is not None:
        found["within_width"] = length_on(mesh, "within_width", given["within_width"])
    within = given.get("within")
    if within is not None and not (isinstance(within, str) and within == "everywhere"):
        found["within"] = place_on(mesh, within).region
        if found["within"] is None:
            raise ValueError(f"`within` must be a region, got {within!r}")
    return found


def _points_on(mesh: Mesh, places: Any) -> tuple[Place, ...]:
    """The places of a list of them, once each."""
    if isinstance(places, str) or not isinstance(places, Iterable):
        raise ValueError(f"`without_instances` must be a list of vertices or points, got {places!r}")
    found = tuple(dict.fromkeys(place_on(mesh, at) for at in places))
    if any(place.region is not None for place in found):
        raise ValueError("`without_instances` must be a list of vertices or points, got a region")
    return found


def radius_on(mesh: Mesh, radius: Any) -> float:
    """A radius in mesh units, as `length_on` reads it.

    Raises
    ------
    ValueError
        If it is no length, or not above 0.
    """
    return length_on(mesh, "radius", radius, exclusive=True)


def length_on(mesh: Mesh, name: str, value: Any, *, exclusive: bool = False) -> float:
    """A length in mesh units, from a number or from a text such as "20%", of the diagonal of the mesh's box.

    Raises
    ------
    ValueError
        In the name of `name`, if it is neither, or negative, or with `exclusive` 0.
    """
    length, unit = value, 1.0
    if isinstance(value, str):
        try:
            length, unit = float(value.removesuffix("%")), mesh.diagonal / 100 if value.endswith("%") else 1.0
        except ValueError:
            raise ValueError(f"`{name}` must be a length or a percentage such as 20%, got {value!r}") from None
    return unit * check.number(name, name, length, minimum=0.0, exclusive=exclusive)
