"""The defaults that sessions, the command line, the app, Blender and edit files share: one object for each preset."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from dfd.common.preset import Preset
from dfd.symmetry.plane import DEFAULT_BAND

if TYPE_CHECKING:
    from dfd.posing.pose import Blend, Overlap
    from dfd.weights.bind import Falloff

__all__ = ["PRESETS", "WHOLE_SHAPE", "Defaults", "Instances", "SymmetryCandidates"]

Instances = Literal["own", "together", "only"]
SymmetryCandidates = Literal["any", "axes"]


@dataclass(frozen=True)
class Defaults:
    """What is meant where nothing else is said; what is left out here is as the preset "default" has it.

    Attributes
    ----------
    reach, falloff, instances
        Of a new handle, as in `Deformer.add`; its other controls change nothing unless they are given.
    overlap, blend, arrive, mirrored_locality, bridges
        Of a new session, as the properties of `Deformer`.
    band
        Half width of the zone in which the sides of a mirror plane blend, as a part of the mesh's longest side.
    candidates, threshold
        Which planes symmetry "auto" takes, as `dfd.symmetry_planes` has them.
    """

    # By what pictures say: with the paper's reach of 1 an ear widens the whole head, and with a linear falloff what is
    # pulled has a point. Wheels turn about their own axles, and legs grow where they stand.
    reach: float = 0.7
    falloff: Falloff = "smooth"
    instances: Instances = "own"
    overlap: Overlap = "add"
    blend: Blend = "linear"
    arrive: bool = True
    mirrored_locality: bool = True
    bridges: bool = True
    band: float = DEFAULT_BAND
    candidates: SymmetryCandidates = "any"
    threshold: float | Literal["relative"] = "relative"

    @property
    def handle(self) -> dict[str, Any]:
        """What of it holds for a handle, by the names of `Controls`."""
        return {name: getattr(self, name) for name in ("reach", "falloff", "instances")}

    @property
    def whole_shape(self) -> dict[str, Any]:
        """What of it holds for a whole edit, by the names of `Edit`."""
        return {name: getattr(self, name) for name in WHOLE_SHAPE}


WHOLE_SHAPE = ("overlap", "blend", "arrive", "mirrored_locality", "bridges")
PRESETS: dict[Preset, Defaults] = {
    "default": Defaults(),
    # Eq. 1 and 4 to 8 to the letter, and the planes of section 3.3.3 with its ε.
    "paper": Defaults(
        reach=1.0,
        falloff="linear",
        instances="together",
        overlap="paper",
        arrive=False,
        mirrored_locality=False,
        bridges=False,
        band=0.0,
        candidates="axes",
        threshold=0.1,
    ),
}
