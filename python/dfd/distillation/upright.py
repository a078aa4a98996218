"""Which way is up: encoders know things as they stand, and a shape that lies on its side loses much of its weights."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from dfd.common.progress import Stages
from dfd.distillation.side_views import look_from_sides
from dfd.distillation.standing import Standing, axis_frames
from dfd.distillation.up_probe import UpProbe, find_probe
from dfd.geometry.topology import face_areas
from dfd.mesh.normalization import normalization

if TYPE_CHECKING:
    from dfd.encoders.encode import Encoder
    from dfd.mesh.mesh import Mesh

__all__ = ["UP_WORDS", "Up", "check_up", "find_up", "said_up"]

AXES: dict[str, NDArray[np.float64]] = {
    f"{sign}{name}": float(f"{sign}1") * np.eye(3)[axis] for axis, name in enumerate("xyz") for sign in "+-"
}
UP_WORDS = ("auto", "file", *AXES)
RING = np.radians([-60.0, -30.0, 30.0, 60.0])  # about the normal of the mirror plane, beside each quarter turn
LEAST_EXTENT = 1e-6  # of the longest side: what has less along an axis has none


@dataclass(frozen=True, eq=False)
class Up:
    """Which way is up in a mesh.

    Attributes
    ----------
    frame
        (3, 3) rotation, rows in the mesh's coordinates: right, up, front.
    confidence
        How sure that is, 0 … 1; 1 when it was said.
    source
        "said", "file" (its own +y, because nothing could be found), or "found".
    """

    frame: NDArray[np.float64]
    confidence: float
    source: Literal["said", "file", "found"]

    @property
    def direction(self) -> NDArray[np.float64]:
        """(3,) unit, in the mesh's coordinates."""
        up: NDArray[np.float64] = self.frame[1]
        return up

    def __str__(self) -> str:
        """As `up` takes it: an axis, or three numbers."""
        named = next((name for name, axis in AXES.items() if np.allclose(axis, self.direction)), None)
        return named or ", ".join(f"{part:.3f}" for part in self.direction)


def check_up(up: Any) -> str | tuple[float, float, float]:
    """Return `up` as one of `UP_WORDS`, or as a unit direction.

    Raises
    ------
    ValueError
        If it is neither, nor three numbers with a length.
    """
    if isinstance(up, str):
        word = f"+{up}" if up in ("x", "y", "z") else up
        if word in UP_WORDS:
            return word
    else:
        try:
            vector = np.asarray(up, np.float64)
        except (TypeError, ValueError):
            vector = np.zeros(0)
        if vector.shape == (3,) and np.isfinite(vector).all() and np.abs(vector).max() > 0:
            vector = vector / np.abs(vector).max()  # so that no square overflows or vanishes
            x, y, z = (vector / np.linalg.norm(vector)).tolist()
            return x, y, z
    raise ValueError(f"distill: `up` must be one of {', '.join(UP_WORDS)}, or three numbers with a length, got {up!r}")


def said_up(mesh: Mesh, up: str | tuple[float, float, float]) -> Up:
    """The frame for an `up` that `check_up` has let pass, other than "auto".

    Raises
    ------
    ValueError
        If `mesh` has no extent along `up`.
    """
    if up == "file":
        return Up(np.eye(3), 1.0, "said")
    direction = AXES[up] if isinstance(up, str) else np.array(up)
    if np.ptp(mesh.vertices @ direction) <= LEAST_EXTENT * np.max(mesh.extents):
        raise ValueError(f"distill: `up` must be a direction that `mesh` has some extent along, got {up!r}")
    return Up(_upright_frame(direction), 1.0, "said")


def find_up(mesh: Mesh, encoder: Encoder, *, probe: UpProbe | None = None, stages: Stages | None = None) -> Up:
    """Find which way is up in `mesh`, from what `encoder` sees of its sides and from how it would stand.

    The file's own +y stays unless something else is clearly more likely.

    Parameters
    ----------
    probe
        What was learned about the encoder's tokens; None takes what comes with the package. Where there is nothing
        for this encoder, the file's up stays.

    Raises
    ------
    ValueError
        If all vertices are one point.
    """
    center, scale = normalization(mesh)
    probe = probe or find_probe(encoder)
    vertices = (mesh.vertices - center) * scale
    if probe is None or not probe.fits(encoder) or not face_areas(vertices, mesh.faces).sum() > 0:
        return Up(np.eye(3), 0.0, "file")
    with (stages or Stages(show=False)).stage("up"):
        standing = Standing(vertices, mesh.faces)
        frame = standing.frame()
        frames = candidates(frame)
        odds = probe.terms(look_from_sides(mesh, encoder, frame), standing, frames) @ probe.odds
        odds += [prior(probe, each) for each in frames]
        chances = np.exp(odds - odds.max())
        best = int(chances.argmax())
    return Up(frames[best], float(chances[best] / chances.sum()), "found")


def candidates(frame: NDArray[np.float64]) -> NDArray[np.float64]:
    """The frames (K, 3, 3) that may be upright: the file's axes first, and where it is tilted `frame` turned about."""
    found = axis_frames(np.eye(3))
    if not np.array_equal(frame, np.eye(3)):
        own = axis_frames(frame)
        found += own
        right = frame[0]
        for up in (each[1] for each in own if abs(each[1] @ right) < 0.5):
            for angle in RING[1:3]:
                turned = np.cos(angle) * up + np.sin(angle) * np.cross(right, up)
                found.append(np.stack([right, turned, np.cross(right, turned)]))
    return np.stack(found)


def prior(probe: UpProbe, frame: NDArray[np.float64]) -> float:
    """Log-odds of `frame` before anything is looked at."""
    if np.allclose(frame[1], AXES["+y"]):
        return probe.file_up
    return probe.file_z if np.allclose(np.abs(frame[1]), AXES["+z"]) else 0.0


def _upright_frame(up: NDArray[np.float64]) -> NDArray[np.float64]:
    """The frame with `up` in which the other axes of the file are turned least."""
    along = np.flatnonzero(np.isclose(np.abs(up), 1.0))
    if len(along):
        return axis_frames(np.eye(3))[2 * int(along[0]) + (up[along[0]] < 0)]
    right = np.eye(3)[0] if abs(up[0]) < 0.9 else np.eye(3)[2]
    right = right - (right @ up) * up
    right /= np.linalg.norm(right)
    frame: NDArray[np.float64] = np.stack([right, up, np.cross(right, up)])
    return frame
