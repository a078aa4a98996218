"""Find the up direction, because features of a shape that lies on its side give worse weights."""

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

# Below this probability of the likeliest axis, pictures of the two likeliest axes give concatenated features.
CLEAR = 0.9
# If four pictures around the file's up give an axis this probability without the prior, twenty more pictures hardly
# ever change the result.
EARLY_STOP_CONFIDENCE = 0.95
SURE = 0.97  # the same after pictures along all axes; below it, pictures from the corners are added
SAME = np.cos(np.radians(8))  # directions within this angle are one candidate
ALIKE = np.cos(np.radians(20))  # the probabilities of axes within this angle are added
# Log-odds for +y in glTF files, whose standard says that +y is up. They are added to the learned prior of all files.
# For 80 of 360 upright glTF files, pictures and stability favored another axis; for 14, by more than these log-odds.
GLTF_UP = 2.5
UNALIGNED_PRIOR = 0.5  # factor of the prior for a shape that is aligned with no axis of the file


def resolve_up(
    mesh: Mesh, encoder: Encoder, up: str | tuple[float, float, float], *, stages: Stages | None = None
) -> Up:
    """Return the up direction for the setting `up`, a result of `check_up`; "auto" finds it from pictures."""
    return find_up(mesh, encoder, stages=stages) if up == "auto" else explicit_up(mesh, up)


def find_up(mesh: Mesh, encoder: Encoder, *, probe: UpProbe | None = None, stages: Stages | None = None) -> Up:
    """Find the up direction of `mesh` from the tokens of pictures and from stability.

    First the upright axis is chosen, and then its upper end. Weights are worse for a shape on its side, but not for a
    shape upside down. +y is kept unless another axis is clearly likelier. If no axis is clear, the two likeliest axes
    have pictures.

    `probe` was learned from the tokens of `encoder`; None takes the package's probe. Without a probe, +y is kept.

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
        cues, cameras = StabilityCues(vertices, mesh.faces), ProbeCameras(mesh, encoder)
        frame = cues.frame()
        choose = _among_file_axes if np.array_equal(frame, np.eye(3)) else _among_candidates
        says_up = mesh.scene is not None and mesh.scene.gltf is not None
        return choose(cues, frame, cameras, replace(probe, file_up=probe.file_up + GLTF_UP * says_up))


def _among_file_axes(cues: StabilityCues, frame: Float64, cameras: ProbeCameras, probe: UpProbe) -> Up:
    """Choose an axis of the file, with more pictures until the result is conclusive."""
    frames = np.stack(axis_frames(frame))
    ups, evidence = frames[:, 1], np.stack([cues.evidence(each) for each in frames])
    before = np.array([prior(probe, each) for each in frames])
    as_filed = ups @ AXES["+y"] == 1
    seen = cameras.seen(frames[as_filed], SIDES)
    at_once = probe.terms(seen, ups, evidence) @ probe.odds[0]
    if decide(frames, at_once).confidence >= EARLY_STOP_CONFIDENCE:
        return decide(frames, at_once + before)
    seen += cameras.seen(frames[~as_filed], SIDES)
    up = decide(frames, probe.terms(seen, ups, evidence) @ probe.odds[1] + before)
    if up.confidence < SURE:
        seen += cameras.seen(frames, CORNERS)
        up = decide(frames, probe.terms(seen, ups, evidence) @ probe.odds[1] + before)
    return up


def _among_candidates(cues: StabilityCues, frame: Float64, cameras: ProbeCameras, probe: UpProbe) -> Up:
    """Choose the up of a shape that is aligned with no axis of the file; the first row of `frame` is its mirror normal.

    Pictures along all axes give a first estimate. Pictures of its likeliest candidates are then added. The axes of the
    file remain candidates, because the mirror plane may be wrong.
    """

    def found() -> Up:
        frames = candidates(cues, frame, probe.votes(seen)[0])
        evidence = np.stack([cues.evidence(each) for each in frames])
        before = UNALIGNED_PRIOR * np.array([prior(probe, each) for each in frames])
        return decide(frames, probe.terms(seen, frames[:, 1], evidence) @ probe.odds[2] + before)

    seen = cameras.seen(np.stack(axis_frames(np.eye(3))), SIDES)
    seen += cameras.seen(found().frames, CORNERS)
    return found()


def candidates(cues: StabilityCues, frame: Float64, form: Float64) -> Float64:
    """Return the frames (2K, 3, 3) in which a tilted shape may be upright, each followed by its upside-down frame.

    Their ups are the axes of the file, the stable poses with an upright mirror plane, and the main axes of the
    quadratic form `form` (3, 3) of the pictures. These main axes are used both unchanged and projected into the mirror
    plane.
    """
    normal = frame[0]
    seen = np.linalg.eigh(form)[1].T[::-1][:2]
    leaned = [each / np.linalg.norm(each) for each in seen - np.outer(seen @ normal, normal) if each @ each > 0.25]
    found = [AXES["+y"], AXES["+z"], AXES["+x"]]
    for up in [*cues.stable_ups(frame), *leaned, *seen]:
        if all(abs(up @ other) < SAME for other in found):
            found.append(up)
    return np.stack([frame_facing(sign * up, normal) for up in found for sign in (1.0, -1.0)])


def prior(probe: UpProbe, frame: Float64) -> float:
    """Return the prior log-odds of `frame` by the conventions of files."""
    if np.allclose(frame[1], AXES["+y"]):
        return probe.file_up
    if np.allclose(frame[1], AXES["-y"]):
        return probe.file_down
    return probe.file_z if np.allclose(np.abs(frame[1]), AXES["+z"]) else 0.0


def decide(frames: Float64, odds: Float64) -> Up:
    """Choose among `frames` (2K, 3, 3), each followed by its upside-down frame, by their log-odds (2K,).

    Probabilities of nearly parallel axes are added. A choice between them matters less than a second set of pictures.
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
