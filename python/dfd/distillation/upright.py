"""Which way is up: encoders know things as they stand, and a shape that lies on its side loses much of its weights."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dfd.common.progress import Stages
from dfd.distillation.standing import Standing
from dfd.distillation.up import AXES, Up, axis_frames, file_up, said_up
from dfd.distillation.up_probe import UpProbe, find_probe
from dfd.distillation.views_around import CORNERS, SIDES, Around
from dfd.geometry.topology import face_areas
from dfd.mesh.normalization import box_normalization

if TYPE_CHECKING:
    from dfd.encoders.encode import Encoder
    from dfd.mesh.mesh import Mesh

__all__ = ["find_up", "said_or_found"]

# Of mean part precision, the wrong axis upright costs 0.030, upside down nothing, and two axes that share the pictures,
# one of them right, 0.006 (three 0.031): below this chance of the likeliest axis two of them cost less than a guess.
CLEAR = 0.8
# Looked at from four sides, a shape whose axis is so likely is never taken for another from eight (67 shapes, upright,
# with z up and without what files have by convention; four in five of the upright ones).
SURE = 0.97


def said_or_found(
    mesh: Mesh, encoder: Encoder, up: str | tuple[float, float, float], *, stages: Stages | None = None
) -> Up:
    """Return what `up`, checked by `check_up`, says; look for it where it is "auto"."""
    return find_up(mesh, encoder, stages=stages) if up == "auto" else said_up(mesh, up)


def find_up(mesh: Mesh, encoder: Encoder, *, probe: UpProbe | None = None, stages: Stages | None = None) -> Up:
    """Find which way is up in `mesh`, from what `encoder` sees of it and from how it would stand.

    The axis that stands upright is decided first, then which of its ends is up: weights suffer from a shape that lies
    on its side, not from one upside down. The +y of the file stays unless something else is clearly more likely, and
    where no axis is clear the two likeliest share the pictures.

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
        frames = candidates(standing)
        evidence = np.stack([standing.evidence(frame) for frame in frames])
        # What is tilted follows no convention of files.
        before = [prior(probe, frame) if lies_along_the_file(frames) else 0.0 for frame in frames]
        around = Around(mesh, encoder)
        seen = around.seen(frames, SIDES)
        up = decide(frames, probe.terms(seen, evidence) @ probe.odds + before)
        if up.confidence < SURE:
            seen = (seen + around.seen(frames, CORNERS)) / 2
            up = decide(frames, probe.terms(seen, evidence) @ probe.odds + before)
        return up


def candidates(standing: Standing) -> NDArray[np.float64]:
    """The frames (2K, 3, 3) that may be upright, each followed by the same upside down.

    Those are the file's axes; of a shape that lies along none of them the file's y, and how it would come to rest with
    its mirror plane upright.
    """
    frame = standing.frame()
    if np.array_equal(frame, np.eye(3)):
        return np.stack(axis_frames(np.eye(3)))
    found = axis_frames(np.eye(3))[2:4]
    for up in standing.resting(frame):
        found += [np.stack([frame[0], each, np.cross(frame[0], each)]) for each in (up, -up)]
    return np.stack(found)


def lies_along_the_file(frames: NDArray[np.float64]) -> bool:
    """Whether `candidates` are the file's axes."""
    return np.array_equal(frames, axis_frames(np.eye(3)))


def prior(probe: UpProbe, frame: NDArray[np.float64]) -> float:
    """Log-odds of `frame` before anything is looked at."""
    if np.allclose(frame[1], AXES["+y"]):
        return probe.file_up
    if np.allclose(frame[1], AXES["-y"]):
        return probe.file_down
    return probe.file_z if np.allclose(np.abs(frame[1]), AXES["+z"]) else 0.0


def decide(frames: NDArray[np.float64], odds: NDArray[np.float64]) -> Up:
    """Choose among `frames` (2K, 3, 3), each followed by the same upside down, by their log-odds (2K,)."""
    chances = np.exp(odds - odds.max())
    of_axes = chances.reshape(-1, 2).sum(axis=1) / chances.sum()
    ups = [2 * each + int(odds[2 * each + 1] > odds[2 * each]) for each in np.argsort(-of_axes, kind="stable")]
    best, sure = frames[ups[0]], float(of_axes.max())
    if sure < CLEAR:
        return Up(best, sure, "averaged", frames[ups[:2]])
    return Up(best, sure, "file" if np.allclose(best[1], AXES["+y"]) else "found")
