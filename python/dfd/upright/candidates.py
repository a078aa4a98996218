"""Convert up directions: from the arguments of users to frames, and from frames to the settings of a field.

A frame is a rotation matrix (3, 3). Its rows are right, up and front in the mesh's coordinates.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from dfd.common.linear_algebra import Float64

if TYPE_CHECKING:
    from dfd.mesh.mesh import Mesh

AXES: dict[str, Float64] = {
    f"{sign}{name}": float(f"{sign}1") * np.eye(3)[axis] for axis, name in enumerate("xyz") for sign in "+-"
}
UP_WORDS = ("auto", "file", *AXES)
LEAST_PERPENDICULAR = 0.1  # a right vector is used if its component perpendicular to up has at least this length
LEAST_EXTENT = 1e-6  # an extent along a direction counts as 0 up to this fraction of the bounding box's longest side


@dataclass(frozen=True, eq=False)
class Up:
    """The up direction of a mesh."""

    frame: Float64 = field(default_factory=lambda: np.eye(3))  # (3, 3); by default, up is +y, as in most files
    # Probability, 0 to 1, that the upright axis is `direction` or nearly parallel to it; 1 if `source` is "said"
    confidence: float = 0.0
    # "said": the setting `up` is not "auto". "file": +y is the most probable, or nothing was measured (confidence 0).
    # "found": another direction is the most probable. "averaged": features of the two most probable ones are combined.
    source: Literal["said", "file", "found", "averaged"] = "file"
    # `shared` and `shares` are None if pictures are rendered for `frame` only.
    shared: Float64 | None = None  # (K, 3, 3) the frames for which pictures are rendered, the most probable first
    shares: Float64 | None = None  # (K,) the probabilities of `shared`, with sum 1

    @property
    def frames(self) -> Float64:
        """Return the frames (K, 3, 3) for which pictures are rendered; see `dfd.views.render.render`."""
        return self.frame[None] if self.shared is None else self.shared

    @property
    def settings(self) -> dict[str, Any]:
        """Return the entries for a field's settings, as JSON values."""
        shared = {}
        if self.shared is not None and self.shares is not None:
            shared = {"up_shared": self.shared[:, 1].tolist(), "up_shares": self.shares.tolist()}
        return {
            "up_direction": self.direction.tolist(),
            "up_confidence": self.confidence,
            "up_source": self.source,
            **shared,
        }

    @property
    def direction(self) -> Float64:
        """Return the unit up direction (3,) in the mesh's coordinates."""
        return self.frame[1]

    def __str__(self) -> str:
        """Return the direction as a value of the setting `up`: an axis, or three numbers."""
        return _named(self.direction)

    @property
    def sentence(self) -> str:
        """Return a text for users about the up direction."""
        return up_sentence(self.settings)


def up_sentence(settings: Mapping[str, Any]) -> str:
    """Return a text for users about the up direction in a field's `settings`, or "" if they contain none."""
    if "up_source" not in settings:
        return ""
    up, source, sure = _named(settings["up_direction"]), settings["up_source"], settings["up_confidence"]
    if source == "averaged":
        shared = " and ".join(map(_named, settings["up_shared"]))
        return f"{up}, {sure:.0%} sure: features of {shared} are combined"
    if source == "said":
        return up
    if source == "found":
        return f"{up}, {sure:.0%} sure"
    if sure == 0:
        return f"{up} by the file's convention: the up direction could not be measured"
    return f"{up} as in the file, {sure:.0%} sure"


def _named(direction: ArrayLike) -> str:
    """Return the name of an axis, or the three numbers of another direction."""
    named = next((name for name, axis in AXES.items() if np.allclose(axis, direction)), None)
    return named or ", ".join(f"{part:.3f}" for part in np.asarray(direction))


def axis_frames(frame: Float64) -> list[Float64]:
    """Return six frames (3, 3). Their up directions are right, −right, up, −up, front and −front of `frame`."""
    found = []
    for axis in range(3):
        for sign in (1.0, -1.0):
            up, right = sign * frame[axis], frame[0 if axis == 1 else (axis + 1) % 3]
            found.append(np.stack([right, up, np.cross(right, up)]))
    return found


def check_up(up: Any) -> str | tuple[float, float, float]:
    """Return `up` as one of `UP_WORDS`, or as a unit direction. `up` can be a text such as "0, 0, 1".

    Raises ValueError if `up` is neither a word nor a direction, or the direction is 0.
    """
    word = f"+{up}" if isinstance(up, str) and up in ("x", "y", "z") else up
    if isinstance(word, str) and word in UP_WORDS:
        return word
    try:
        vector = np.asarray(up.split(",") if isinstance(up, str) else up, np.float64)
    except (TypeError, ValueError):
        pass
    else:
        if vector.shape == (3,) and np.isfinite(vector).all() and np.abs(vector).max() > 0:
            vector = vector / np.abs(vector).max()  # prevents overflow and underflow of the squares
            x, y, z = (vector / np.linalg.norm(vector)).tolist()
            return x, y, z
    raise ValueError(f"distill: `up` must be one of {', '.join(UP_WORDS)}, or three numbers, not all 0, got {up!r}")


def explicit_up(mesh: Mesh, up: str | tuple[float, float, float]) -> Up:
    """Return the direction for a result of `check_up` except "auto". Raises ValueError if `mesh` is flat along it."""
    if up == "file":
        return Up(np.eye(3), 1.0, "said")
    direction = AXES[up] if isinstance(up, str) else np.array(up)
    if np.ptp(mesh.vertices @ direction) <= LEAST_EXTENT * np.max(mesh.extents):
        raise ValueError(f"distill: `up` must be a direction along which `mesh` has an extent, got {up!r}")
    axis = int(np.abs(direction).argmax())
    if np.count_nonzero(direction) == 1:
        return Up(axis_frames(np.eye(3))[2 * axis + int(direction[axis] < 0)], 1.0, "said")
    right = np.eye(3)[0] if abs(direction[0]) < 0.9 else np.eye(3)[2]
    return Up(frame_facing(direction, right), 1.0, "said")


def frame_facing(up: Float64, right: Float64) -> Float64:
    """Return the frame with the up vector `up`, and the right vector nearest to `right`; both are unit vectors (3,)."""
    perpendicular = right - (right @ up) * up
    if np.linalg.norm(perpendicular) < LEAST_PERPENDICULAR:
        perpendicular = np.cross(up, np.eye(3)[np.abs(up).argmin()])
    perpendicular /= np.linalg.norm(perpendicular)
    return np.stack([perpendicular, up, np.cross(perpendicular, up)])
