"""Which way is up: encoders know things as they stand, and a shape that lies on its side loses much of its weights."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dfd.common.progress import Stages
from dfd.geometry.topology import face_areas
from dfd.mesh.normalization import box_normalization
from dfd.upright.candidates import AXES, Up, axis_frames, explicit_up, file_up, frame_facing
from dfd.upright.probe import UpProbe, find_probe
from dfd.upright.probe_views import CORNERS, SIDES, ProbeCameras
from dfd.upright.stability import StabilityCues

if TYPE_CHECKING:
    from dfd.encoders.encode import Encoder
    from dfd.mesh.mesh import Mesh

__all__ = ["find_up", "resolve_up"]

# Of mean part precision, the wrong axis upright costs 0.030, upside down nothing, and two axes that share the pictures,
# one of them right, 0.006 (three 0.031): below this chance of the likeliest axis two of them cost less than a guess.
CLEAR = 0.8
# Looked at from its four sides as the file has it, a shape whose axis is so likely, whatever files have by convention,
# is hardly ever taken for another after twenty more pictures.
EARLY_STOP_CONFIDENCE = 0.95
SURE = 0.97  # looked at along all axes, likewise; else from the corners too
SAME = np.cos(np.radians(8))  # ups nearer than that to each other are one
UNALIGNED_PRIOR = 0.5  # of what files have by convention counts for a shape that lies along none of its file's axes


def resolve_up(
    mesh: Mesh, encoder: Encoder, up: str | tuple[float, float, float], *, stages: Stages | None = None
) -> Up:
    """Return what `up`, checked by `check_up`, says; look for it where it is "auto"."""
    return find_up(mesh, encoder, stages=stages) if up == "auto" else explicit_up(mesh, up)


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
        standing, around = StabilityCues(vertices, mesh.faces), ProbeCameras(mesh, encoder)
        frame = standing.frame()
        look = _along_the_file if np.array_equal(frame, np.eye(3)) else _tilted
        return look(standing, frame, around, probe)


def _along_the_file(standing: StabilityCues, frame: NDArray[np.float64], around: ProbeCameras, probe: UpProbe) -> Up:
    """The axis of the file, and its end, that are up: by as few pictures as leave no doubt."""
    frames = np.stack(axis_frames(frame))
    ups, evidence = frames[:, 1], np.stack([standing.evidence(each) for each in frames])
    before = np.array([prior(probe, each) for each in frames])
    as_filed = ups @ AXES["+y"] == 1
    seen = around.seen(frames[as_filed], SIDES)
    at_once = probe.terms(seen, ups, evidence) @ probe.odds[0]
    if decide(frames, at_once).confidence >= EARLY_STOP_CONFIDENCE:
        return decide(frames, at_once + before)
    seen += around.seen(frames[~as_filed], SIDES)
    up = decide(frames, probe.terms(seen, ups, evidence) @ probe.odds[1] + before)
    if up.confidence < SURE:
        seen += around.seen(frames, CORNERS)
        up = decide(frames, probe.terms(seen, ups, evidence) @ probe.odds[1] + before)
    return up


def _tilted(standing: StabilityCues, frame: NDArray[np.float64], around: ProbeCameras, probe: UpProbe) -> Up:
    """Which way is up in a shape whose mirror plane is `frame`'s and that lies along no axis of the file.

    Pictures along all axes tell roughly, then also those that show the likeliest as they would stand. It may yet stand
    upright in its file, without a mirror plane that says so.
    """

    def found() -> Up:
        frames = candidates(standing, frame, probe.votes(seen)[0])
        evidence = np.stack([standing.evidence(each) for each in frames])
        before = UNALIGNED_PRIOR * np.array([prior(probe, each) for each in frames])
        return decide(frames, probe.terms(seen, frames[:, 1], evidence) @ probe.odds[2] + before)

    seen = around.seen(np.stack(axis_frames(np.eye(3))), SIDES)
    seen += around.seen(found().frames, CORNERS)
    return found()


def candidates(standing: StabilityCues, frame: NDArray[np.float64], form: NDArray[np.float64]) -> NDArray[np.float64]:
    """The frames (2K, 3, 3) in which a tilted shape may be upright, each followed by the same upside down.

    Those are the file's axes, how it would come to rest with its mirror plane upright, and the axes along which the
    pictures' quadratic form (3, 3) is largest, leaned into the mirror plane and as they are.
    """
    normal = frame[0]
    seen = np.linalg.eigh(form)[1].T[::-1][:2]
    leaned = [each / np.linalg.norm(each) for each in seen - np.outer(seen @ normal, normal) if each @ each > 0.25]
    found = [AXES["+y"], AXES["+z"], AXES["+x"]]
    for up in [*standing.stable_ups(frame), *leaned, *seen]:
        if all(abs(up @ other) < SAME for other in found):
            found.append(up)
    return np.stack([frame_facing(sign * up, normal) for up in found for sign in (1.0, -1.0)])


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
