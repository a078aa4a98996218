"""What a field depends on besides its mesh and its encoder."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal, TypedDict

import numpy as np

from dfd.common import check
from dfd.distillation.up import check_up
from dfd.views.cameras import Framing
from dfd.views.render import LARGEST_RESOLUTION, LARGEST_VIEWS, Supervision

__all__ = ["DistillOptions", "DistillSettings", "MetricChoice"]

MetricChoice = Literal["learned", "none"]


@dataclass(frozen=True, kw_only=True)
class DistillSettings:
    """The settings of `dfd.distill`, where each is explained; they check themselves when made.

    Raises
    ------
    ValueError
        If one is out of its range.
    """

    views: int = 24
    resolution: int = 518
    framing: Framing = "shape"
    simplify_to: int | None = None
    up: str | tuple[float, float, float] = "auto"
    supervision: Supervision = "barycentric"
    mirrored: bool = True
    smoothing: float = 0.3
    metric: MetricChoice = "learned"
    octaves: int = 5
    steps: int = 1000
    batch: int = 192
    learning_rate: float = 2e-2
    seed: int = 0

    def __post_init__(self) -> None:
        def whole(name: str, minimum: int, maximum: int | None = None) -> int:
            return check.whole("distill", name, getattr(self, name), minimum=minimum, maximum=maximum)

        if not isinstance(self.mirrored, bool | np.bool_):
            raise ValueError(f"distill: `mirrored` must be True or False, got {self.mirrored!r}")
        smoothing = check.number("distill", "smoothing", self.smoothing, minimum=0.0, maximum=2.0)
        # The ablation is of the paper's own loss.
        smoothing = 0.0 if self.supervision == "vertex" else smoothing
        metric = check.choice("distill", "metric", self.metric, MetricChoice)
        checked = {
            "views": whole("views", 1, LARGEST_VIEWS),
            "resolution": whole("resolution", 1, LARGEST_RESOLUTION),
            "framing": check.choice("distill", "framing", self.framing, Framing),
            "simplify_to": None if self.simplify_to is None else whole("simplify_to", 4),
            "up": check_up(self.up),
            "supervision": check.choice("distill", "supervision", self.supervision, Supervision),
            "mirrored": bool(self.mirrored),
            "smoothing": smoothing,
            "metric": metric if smoothing > 0 else "none",  # it was learned from features that had spread
            "octaves": whole("octaves", 0, 16),
            "steps": whole("steps", 1),
            "batch": whole("batch", 1),
            "learning_rate": check.number("distill", "learning_rate", self.learning_rate, minimum=0.0, exclusive=True),
            "seed": whole("seed", 0, 2**63 - 1),
        }
        for name, value in checked.items():
            object.__setattr__(self, name, value)  # NumPy's numbers as Python's

    def of_pictures(self) -> dict[str, Any]:
        """Return what `dfd.views.render.render` goes by."""
        names = ("views", "resolution", "framing", "simplify_to", "supervision", "mirrored")
        return {name: getattr(self, name) for name in names}

    def of_fit(self) -> dict[str, Any]:
        """Return what a fit goes by."""
        return {name: getattr(self, name) for name in ("octaves", "steps", "batch", "learning_rate", "seed")}

    def as_dict(self) -> dict[str, Any]:
        """Return all settings by name, as JSON holds them."""
        return asdict(self)


class DistillOptions(TypedDict, total=False):
    """The same names and types, for programs that check the keywords of `dfd.distill` without running it."""

    views: int
    resolution: int
    framing: Framing
    simplify_to: int | None
    up: str | tuple[float, float, float]
    supervision: Supervision
    mirrored: bool
    smoothing: float
    metric: MetricChoice
    octaves: int
    steps: int
    batch: int
    learning_rate: float
    seed: int
