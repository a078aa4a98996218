"""The controls of a handle, and the defaults of each preset, for every interface.

Sessions, the command line, the app, Blender and edit files read them here. The module imports no SciPy or pydantic.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from dfd.common.described import About
from dfd.common.preset import Preset
from dfd.symmetry.plane import DEFAULT_BAND

if TYPE_CHECKING:
    from dfd.weights.bind import Falloff

LARGEST = 1e38  # bound of numbers, because the kernels compute with 32-bit floats
PARTLESS_REACH = 0.7  # stands for the reach "part" on a shape without parts that end, such as a ball

Counterparts = Literal["own_pivot", "shared_pivot", "only"]
Reach = float | Literal["part"]
SymmetryCandidates = Literal["any", "axes"]

# The controls of a handle: the fields of `dfd.editing.controls.Controls`.
CONTROLS = {
    "reach": About(
        'Feature distance at which the weight is 0: 1 is Eq. 5; "part" ends with the part.',
        0.0,
        LARGEST,
        exclusive=True,
        metavar="R|part",
        slider=(0.05, 1.5, 0.01),
    ),
    "falloff": About(
        "Curve from 1 at the handle to 0 at a numeric reach: linear (Eq. 5), smooth, sharp, root, sphere or constant.",
        metavar="CURVE",
    ),
    "locality": About(
        "λ of Eq. 7: 0 reaches all that looks alike, more stays nearer.",
        0.0,
        LARGEST,
        metavar="λ",
        slider=(0.0, 20.0, 0.5),
    ),
    "radius": About(
        "In place of locality: distance along the surface where the weight is smoothly 0, mesh units or % of the box.",
        0.0,
        exclusive=True,
        metavar="R|P%",
        unit="length",
        slider=(0.0, 1.0, 0.01),
    ),
    "strength": About("From 0 to 1: a factor for what follows.", 0.0, 1.0, metavar="S", slider=(0.0, 1.0, 0.05)),
    "counterparts": About(
        "Counterparts move about their own pivots, about the handle's (shared_pivot, the paper), or not at all (only).",
        metavar="own_pivot|shared_pivot|only",
        affects="pose",
        label="Counterparts",
    ),
    "excluded_counterparts": About(
        "A place on a counterpart that does not move along.", metavar="PLACE", repeated=True, affects="pose"
    ),
    "mask": About(
        "Nothing follows beyond: part (the handle's), part:NAME, group:NAME, 'x>0', ball:x,y,z,r or box:x,y,z,x,y,z.",
        metavar="REGION",
    ),
    "mask_feather": About(
        "How far beyond that region the weight fades to 0, mesh units or % of the box.",
        0.0,
        LARGEST,
        metavar="W|P%",
        unit="length",
        label="Limit's edge",
        slider=(0.0, 0.3, 0.005),
    ),
}


@dataclass(frozen=True)
class Rules:
    """Everything that differs between the presets, with the values of the preset "default"."""

    # reach, falloff, counterparts: controls of a new handle. In pictures and labels of people, any one number for reach
    # is too wide for an ear and too narrow for a leg. A linear falloff pulls the surface into a point.
    reach: Reach = "part"
    falloff: Falloff = "smooth"
    counterparts: Counterparts = "own_pivot"
    # pivot: the pivot of a handle if none is given: as in `Deformer.add`, or the held point
    pivot: Literal["auto", "point"] = "auto"
    # equalize: whether counterparts follow as much as the held component; otherwise as much as they resemble it
    equalize: bool = True
    # overlap, blend: how overlapping weights and transforms combine; "auto" is linear up to rotations of `MOST_LINEAR`
    overlap: Literal["add", "paper"] = "add"
    blend: Literal["auto", "linear"] = "auto"
    # reach_targets: whether handles get back the weight that fixed points take from them at their own places (Eq. 6)
    reach_targets: bool = True
    # mirrored_locality: whether distances of Eq. 7 also start at the handle's mirror image. bridges: whether they cross
    # small gaps between components. sampled_distances: whether samples represent a large mesh.
    mirrored_locality: bool = True
    bridges: bool = True
    sampled_distances: bool = True
    # band: half width of the blend band at a mirror plane, relative to the longest side of the box (Eq. 8)
    band: float = DEFAULT_BAND
    # candidates, threshold: candidates of symmetry "auto", as in `dfd.symmetry_planes`
    candidates: SymmetryCandidates = "any"
    threshold: float | Literal["relative"] = "relative"

    @property
    def handle(self) -> dict[str, Any]:
        """Return the controls of a new handle, by their names."""
        return {name: getattr(self, name) for name in ("reach", "falloff", "counterparts")}


PRESETS: dict[Preset, Rules] = {
    "default": Rules(),
    # Eq. 1 and 4 to 8 to the letter, and the planes of section 3.3.3 with its ε.
    "paper": Rules(
        reach=1.0,
        falloff="linear",
        counterparts="shared_pivot",
        pivot="point",
        equalize=False,
        overlap="paper",
        blend="linear",
        reach_targets=False,
        mirrored_locality=False,
        bridges=False,
        sampled_distances=False,
        band=0.0,
        candidates="axes",
        threshold=0.1,
    ),
}
