"""Finds the up direction: encoders know upright objects, and weights on a shape that lies on its side are worse."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from dfd.common.linear_algebra import Float64
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

# Below this probability of the likeliest axis, the two likeliest have their own pictures and features, side by side.
CLEAR = 0.9
# If four pictures around the file's up, without the prior, give an axis this probability, twenty more pictures hardly
# ever change it.
EARLY_STOP_CONFIDENCE = 0.95
SURE = 0.97  # likewise after pictures along all axes; below, pictures from the corners are added
SAME = np.cos(np.radians(8))  # directions within this angle are one candidate
ALIKE = np.cos(np.radians(20))  # axes within this angle hold a shape upright alike
# Log-odds for +y in glTF files, beside the learned prior of all files: their standard says that +y is up. Of 360 glTF
# files that stand upright, the pictures and stability of 80 spoke against +y, by less than this in all but 14.
GLTF_UP = 2.5
UNALIGNED_PRIOR = 0.5  # factor of the prior for a shape aligned with none of the file's axes


def resolve_up(
    mesh: Mesh, encoder: Encoder, up: str | tuple[float, float, float], *, stages: Stages | None = None
) -> Up:
    """Return the direction of `up`, checked by `check_up`; found from pictures if it is "auto"."""
    return find_up(mesh, encoder, stages=stages) if up == "auto" else explicit_up(mesh, up)


def find_up(mesh: Mesh, encoder: Encoder, *, probe: UpProbe | None = None, stages: Stages | None = None) -> Up:
    """Find the up direction of `mesh` from pictures seen by `encoder` and from stability.

    The upright axis is decided first, then which of its ends is up: weights suffer from a shape on its side, not from
    one upside down. The file's +y is kept unless another axis is clearly more likely; if none is clear, the two
    likeliest each get pictures.

    `probe` is the one learned for the encoder's tokens; None takes the package's. Without one, the file's up is kept.

    Raises ValueError if `probe` was learned from another encoder.
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
        says_up = mesh.scene is not None and mesh.scene.gltf is not None
        return look(standing, frame, around, replace(probe, file_up=probe.file_up + GLTF_UP * says_up))


def _along_the_file(standing: StabilityCues, frame: Float64, around: ProbeCameras, probe: UpProbe) -> Up:
    """Choose among the file's axes, stopping as soon as the pictures are conclusive."""
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


def _tilted(standing: StabilityCues, frame: Float64, around: ProbeCameras, probe: UpProbe) -> Up:
    """Choose the up of a shape that is aligned with no axis of the file; `frame` holds its mirror plane.

    Pictures along all axes give a first estimate, pictures of the likeliest candidates the final one. The file's axes
    remain candidates, because the mirror plane may be wrong.
    """

    def found() -> Up:
        frames = candidates(standing, frame, probe.votes(seen)[0])
        evidence = np.stack([standing.evidence(each) for each in frames])
        before = UNALIGNED_PRIOR * np.array([prior(probe, each) for each in frames])
        return decide(frames, probe.terms(seen, frames[:, 1], evidence) @ probe.odds[2] + before)

    seen = around.seen(np.stack(axis_frames(np.eye(3))), SIDES)
    seen += around.seen(found().frames, CORNERS)
    return found()


def candidates(standing: StabilityCues, frame: Float64, form: Float64) -> Float64:
    """The frames (2K, 3, 3) in which a tilted shape may be upright, each followed by the same upside down.

    Their ups are the file's axes, the stable poses with an upright mirror plane, and the main axes of the pictures'
    quadratic form `form` (3, 3), projected into the mirror plane and unprojected.
    """
    normal = frame[0]
    seen = np.linalg.eigh(form)[1].T[::-1][:2]
    leaned = [each / np.linalg.norm(each) for each in seen - np.outer(seen @ normal, normal) if each @ each > 0.25]
    found = [AXES["+y"], AXES["+z"], AXES["+x"]]
    for up in [*standing.stable_ups(frame), *leaned, *seen]:
        if all(abs(up @ other) < SAME for other in found):
            found.append(up)
    return np.stack([frame_facing(sign * up, normal) for up in found for sign in (1.0, -1.0)])


def prior(probe: UpProbe, frame: Float64) -> float:
    """Log-odds of `frame` by the convention of files."""
    if np.allclose(frame[1], AXES["+y"]):
        return probe.file_up
    if np.allclose(frame[1], AXES["-y"]):
        return probe.file_down
    return probe.file_z if np.allclose(np.abs(frame[1]), AXES["+z"]) else 0.0


def decide(frames: Float64, odds: Float64) -> Up:
    """Choose among `frames` (2K, 3, 3), each followed by the same upside down, by their log-odds (2K,).

    Axes that are alike speak for each other: the doubt between them costs little, a second set of pictures more.
    """
    chances = np.exp(odds - odds.max())
    of_axes = chances.reshape(-1, 2).sum(axis=1) / chances.sum()
    ups = frames[::2, 1]
    alike = np.abs(ups @ ups.T) > ALIKE
    first = int(of_axes.argmax())
    second = int(np.where(alike[first], 0, of_axes).argmax())
    best, other = frames[[2 * each + int(odds[2 * each + 1] > odds[2 * each]) for each in (first, second)]]
    sure = float(of_axes[alike[first]].sum())
    if sure < CLEAR:
        shares = np.array([sure, of_axes[alike[second] & ~alike[first]].sum()])
        return Up(best, sure, "averaged", np.stack([best, other]), shares / shares.sum())
    return Up(best, sure, "file" if np.allclose(best[1], AXES["+y"]) else "found")
