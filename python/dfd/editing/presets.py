"""The defaults of each preset, for every interface.

Sessions, the command line, the app, Blender and edit files read them here. The module imports no SciPy or pydantic.
"""

from dataclasses import dataclass
from typing import Any, Literal

from dfd.common.preset import Preset
from dfd.symmetry.plane import DEFAULT_BAND
from dfd.weights.bind import Falloff

LARGEST = 1e38  # bound of numbers, because the kernels compute with 32-bit floats
PARTLESS_REACH = 0.7  # stands for the reach "part" on a shape without parts that end, such as a ball

Counterparts = Literal["own_pivot", "shared_pivot", "only"]
Reach = float | Literal["part"]
SymmetryCandidates = Literal["any", "axes"]


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
    # exact_distances: whether distances of Eq. 7 start only at the handle, stay on its component and use all vertices.
    # Otherwise they also start at the handle's mirror image, cross small gaps, and use 6,000 samples.
    exact_distances: bool = False
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
        exact_distances=True,
        band=0.0,
        candidates="axes",
        threshold=0.1,
    ),
}
