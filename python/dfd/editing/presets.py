"""The defaults of each preset, for sessions, the command line, the app, Blender and edit files.

This module imports neither SciPy nor pydantic, so that `dfd --help` starts quickly.
"""

from dataclasses import dataclass
from typing import Any, Literal

from dfd.common.preset import Preset
from dfd.symmetry.plane import DEFAULT_BAND
from dfd.weights.bind import Falloff

PARTLESS_REACH = 0.7  # the reach, a feature distance, that replaces "part" on a shape without parts, such as a ball

Counterparts = Literal["own_pivot", "shared_pivot"]
Reach = float | Literal["part"]
SymmetryCandidates = Literal["any", "axes"]


@dataclass(frozen=True)
class Rules:
    """The settings in which the presets differ. The default values of the fields are those of the preset "default"."""

    # reach, falloff, counterparts: controls of a new handle
    reach: Reach = "part"
    falloff: Falloff = "smooth"
    counterparts: Counterparts = "own_pivot"
    # pivot: the default pivot of a handle: "auto" is the base of a limb, else the part's middle; "point" is the handle
    pivot: Literal["auto", "point"] = "auto"
    # equalize: whether the weights of less similar counterparts are raised to those of the handle's own component
    equalize: bool = True
    # overlap, blend: arguments of `dfd.pose`. "auto" is "linear" without rotations (`Edit.blending`).
    overlap: Literal["add", "paper"] = "add"
    blend: Literal["auto", "linear"] = "auto"
    # reach_targets: whether all weights of a handle are scaled up if fixed points lower the weight at the handle itself
    # (Eq. 6), so that the handle fully reaches its target
    reach_targets: bool = True
    # exact_distances: whether distances along the surface (Eq. 7) start only at the handle, do not cross gaps, and use
    # all vertices. If False, distances start at the handle and its mirror image, may cross small gaps, and use samples.
    exact_distances: bool = False
    # band: half width of the band in which both sides of a mirror plane are blended, as a fraction of the longest side
    # of the bounding box. In Eq. 8, there is no band: the value is 0.
    band: float = DEFAULT_BAND
    # candidates, threshold: arguments of `dfd.symmetry_planes` for the symmetry "auto"
    candidates: SymmetryCandidates = "any"
    threshold: float | Literal["relative"] = "relative"

    @property
    def handle(self) -> dict[str, Any]:
        """Return the controls of a new handle, by their names."""
        return {name: getattr(self, name) for name in ("reach", "falloff", "counterparts")}


PRESETS: dict[Preset, Rules] = {
    "default": Rules(),
    # Exactly Eq. 1 and Eq. 4 to 8. The candidate planes and their threshold ε are those of the paper's section 3.3.3.
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
