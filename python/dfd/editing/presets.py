"""What can be said of a handle and of a whole shape, and the defaults of each preset, for every door.

Sessions, the command line, the app, Blender and edit files take both from here; it imports neither SciPy nor pydantic.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from dfd.common.described import About
from dfd.common.preset import Preset
from dfd.symmetry.plane import DEFAULT_BAND

if TYPE_CHECKING:
    from dfd.posing.pose import Overlap
    from dfd.weights.bind import Falloff

LARGEST = 1e38  # what the kernels compute with are 32-bit floats
# Of the reach "part": where weights would end by features alone, so that the far end of a part follows nearly in full,
# and the number that it is on a shape of which no part ends anywhere, such as a ball.
WITHIN_PART, PARTLESS_REACH = 6.0, 0.7

Instances = Literal["own_pivot", "shared_pivot", "only"]
Reach = float | Literal["part"]
SymmetryCandidates = Literal["any", "axes"]
BlendRule = Literal["auto", "linear", "dual_quaternion"]  # `dfd.posing.pose.Blend`, or what fits the edit

# What a handle takes hold of besides where it is: the fields of `dfd.editing.controls.Controls`.
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
        "Curve from 1 at the handle to 0 at its reach: linear (Eq. 5), smooth, sharp, root, sphere or constant.",
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
        slider=(0.0, 1.0, 0.01),
    ),
    "strength": About("From 0 to 1: a factor for what follows.", 0.0, 1.0, metavar="S", slider=(0.0, 1.0, 0.05)),
    "instances": About(
        "Look-alikes move about their own pivots, about the handle's (shared_pivot, the paper), or not at all (only).",
        metavar="own_pivot|shared_pivot|only",
        label="Look-alikes",
    ),
    "level": About(
        "Look-alikes follow in full; off: as much as they are alike. What is hardly alike never does.",
        label="Look-alikes follow in full",
    ),
    "excluded_instances": About("A place on an instance that does not move along.", metavar="PLACE", repeated=True),
    "mask": About(
        "Nothing follows beyond: part (the handle's), part:NAME, group:NAME, 'x>0', ball:x,y,z,r or box:x,y,z,x,y,z.",
        metavar="REGION",
    ),
    "mask_feather": About(
        "How far beyond that region the weight fades to 0, mesh units or % of the box.",
        0.0,
        LARGEST,
        metavar="W|P%",
        label="Limit's edge",
        slider=(0.0, 0.3, 0.005),
    ),
}
# What holds for all handles of a shape: fields of `dfd.editing.edit.Edit`, properties of `Deformer`.
WHOLE_SHAPE = {
    "overlap": About("Where weights meet: add, interpolate, normalize or paper (Eq. 1).", metavar="RULE"),
    "blend": About(
        "How transforms blend: linear (Eq. 1), dual_quaternion, or auto: linear up to turns of 30°.",
        metavar="RULE",
        label="Blending",
    ),
    "reach_targets": About("Whether handles reach their target although fixed points hold back."),
    "mirrored_locality": About("Whether locality and radius start at the handle's mirror image as well."),
    "bridges": About("Whether locality and radius reach across small gaps."),
}


@dataclass(frozen=True)
class Defaults:
    """What is meant where nothing else is said; what is left out here is as the preset "default" has it."""

    # By what pictures and people's labels say: any one number is too wide for an ear and too narrow for a leg, and with
    # a linear falloff what is pulled has a point. Wheels turn about their own axles, legs grow where they stand, and by
    # as much as the leg that is held, so that nothing tips over.
    # reach, falloff, instances, level: of a new handle, as in `Deformer.add`; its other controls change nothing unless
    # they are given
    reach: Reach = "part"
    falloff: Falloff = "smooth"
    instances: Instances = "own_pivot"
    level: bool = True
    # pivot: about what a handle turns and scales that says nothing of it: as `Deformer.add` has it, or the point held
    pivot: Literal["auto", "point"] = "auto"
    # overlap to bridges: of a new session, as the properties of `Deformer`
    overlap: Overlap = "add"
    blend: BlendRule = "auto"
    reach_targets: bool = True
    mirrored_locality: bool = True
    bridges: bool = True
    # band: half width of the zone in which the sides of a mirror plane blend, as a part of the mesh's longest side
    band: float = DEFAULT_BAND
    # candidates, threshold: which planes symmetry "auto" takes, as `dfd.symmetry_planes` has them
    candidates: SymmetryCandidates = "any"
    threshold: float | Literal["relative"] = "relative"

    @property
    def handle(self) -> dict[str, Any]:
        """What of it holds for a handle, by the names of `Controls`."""
        return {name: getattr(self, name) for name in ("reach", "falloff", "instances", "level")}

    @property
    def whole_shape(self) -> dict[str, Any]:
        """What of it holds for a whole edit, by the names of `Edit`."""
        return {name: getattr(self, name) for name in WHOLE_SHAPE}


PRESETS: dict[Preset, Defaults] = {
    "default": Defaults(),
    # Eq. 1 and 4 to 8 to the letter, and the planes of section 3.3.3 with its ε.
    "paper": Defaults(
        reach=1.0,
        falloff="linear",
        instances="shared_pivot",
        level=False,
        pivot="point",
        overlap="paper",
        blend="linear",
        reach_targets=False,
        mirrored_locality=False,
        bridges=False,
        band=0.0,
        candidates="axes",
        threshold=0.1,
    ),
}
