"""Which way is up: encoders know things as they stand, and a shape that lies on its side loses much of its weights."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dfd.common.progress import Stages
from dfd.distillation.side_views import look_from_sides
from dfd.distillation.standing import Standing
from dfd.distillation.up import AXES, Up, axis_frames, file_up, said_up
from dfd.distillation.up_probe import UpProbe, find_probe
from dfd.geometry.topology import face_areas
from dfd.mesh.normalization import box_normalization

if TYPE_CHECKING:
    from dfd.encoders.encode import Encoder
    from dfd.mesh.mesh import Mesh

__all__ = ["find_up", "said_or_found"]

RING = np.radians([-60.0, -30.0, 30.0, 60.0])  # about the normal of the mirror plane, beside each quarter turn


def said_or_found(
    mesh: Mesh, encoder: Encoder, up: str | tuple[float, float, float], *, stages: Stages | None = None
) -> Up:
    """Return what `up`, checked by `check_up`, says; look for it where it is "auto"."""
    return find_up(mesh, encoder, stages=stages) if up == "auto" else said_up(mesh, up)


def find_up(mesh: Mesh, encoder: Encoder, *, probe: UpProbe | None = None, stages: Stages | None = None) -> Up:
    """Find which way is up in `mesh`, from what `encoder` sees of its sides and from how it would stand.

    The +y of a file that the shape lies along stays unless something else is clearly more likely.

    Parameters
    ----------
    probe
        What was learned about the encoder's tokens; None takes what comes with the package. Where there is nothing
        for this encoder, the file's up stays.

    Raises
    ------
    ValueError
        If `probe` was learned from another encoder.
    """
    if probe is not None and not probe.fits(encoder):
        raise ValueError(f"find_up: `probe` was learned from another encoder than {encoder!r}")
    probe = probe or find_probe(encoder)
    box = box_normalization(*mesh.bounds) if len(mesh.faces) else None
    if probe is None or box is None:
        return file_up()
    vertices = (mesh.vertices - box[0]) * box[1]
    if not face_areas(vertices, mesh.faces).sum() > 0:
        return file_up()
    with (stages or Stages(show=False)).stage("up"):
        standing = Standing(vertices, mesh.faces)
        frame = standing.frame()
        frames = candidates(frame)
        odds = probe.terms(look_from_sides(mesh, encoder, frame), standing, frames) @ probe.odds
        if np.array_equal(frame, np.eye(3)):  # what does not lie along the file's axes follows no convention of files
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
