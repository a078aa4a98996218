"""Find the up direction of a shape; weights are worse if the pictures show the shape on its side."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from dfd.common.linear_algebra import Float64
from dfd.common.progress import Stages
from dfd.geometry.topology import face_areas
from dfd.mesh.normalization import box_normalization
from dfd.upright.candidates import AXES, Up, axis_frames, explicit_up, frame_facing
from dfd.upright.probe import UpProbe, find_probe
from dfd.upright.probe_views import CORNERS, SIDES, ProbeCameras
from dfd.upright.stability import StabilityCues

if TYPE_CHECKING:
    from dfd.encoders.encode import Encoder
    from dfd.mesh.mesh import Mesh

# Probability of the likeliest axis below which pictures are rendered for the two likeliest axes.
CLEAR = 0.9
# Probability of an axis, after four pictures around the file's up and without the prior, at which the search ends.
# Twenty more pictures then hardly ever change the result.
EARLY_STOP_CONFIDENCE = 0.95
SURE = 0.97  # probability of an axis, after pictures around all axes, at which no pictures from the corners are added
SAME = np.cos(np.radians(8))  # cosine of the angle below which two directions are one candidate
ALIKE = np.cos(np.radians(20))  # cosine of the angle below which the probabilities of two axes are added
# Log-odds of +y in glTF files, whose standard defines +y as up, in addition to the learned prior of all files. In 80 of
# 360 upright glTF files, pictures and stability favored another axis; in 14, by more than these log-odds.
GLTF_UP = 2.5
UNALIGNED_PRIOR = 0.5  # factor of the prior if the shape is not aligned with the axes of the file


def resolve_up(mesh: Mesh, encoder: Encoder, up: str | tuple[float, float, float], *, stages: Stages) -> Up:
    """Return the up direction for the setting `up`, a result of `check_up`; "auto" calls `find_up`."""
    return find_up(mesh, encoder, stages=stages) if up == "auto" else explicit_up(mesh, up)


def find_up(mesh: Mesh, encoder: Encoder, *, probe: UpProbe | None = None, stages: Stages | None = None) -> Up:
    """Return the up direction of `mesh`, found from the tokens of pictures and from cues of the surface.

    First the upright axis is chosen, because weights are worse for a shape on its side, but not upside down. Then its
    upper end is chosen. If no axis is clear, pictures are rendered for the two likeliest axes.

    `probe` was learned from the tokens of `encoder`; None takes the package's probe. Without a probe, the result is +y.

    Raises ValueError if `probe` was learned from another encoder.
    """
    if probe is not None and not probe.fits(encoder):
        raise ValueError(f"find_up: `probe` was learned from another encoder than {encoder!r}")
    probe = probe or find_probe(encoder)
    box = box_normalization(*mesh.bounds) if len(mesh.faces) else None
    if probe is None or box is None:
        return Up()
    vertices = (mesh.vertices - box[0]) * box[1]
    if not face_areas(vertices, mesh.faces).sum() > 0:
        return Up()
    with (stages or Stages(show=False)).stage("up"):
        cues, cameras = StabilityCues(vertices, mesh.faces), ProbeCameras(mesh, encoder)
        frame = cues.frame()
        choose = _among_file_axes if np.array_equal(frame, np.eye(3)) else _among_candidates
        is_gltf = mesh.scene is not None and mesh.scene.gltf is not None
        return choose(cues, frame, cameras, replace(probe, file_up=probe.file_up + GLTF_UP * is_gltf))


def _among_file_axes(cues: StabilityCues, frame: Float64, cameras: ProbeCameras, probe: UpProbe) -> Up:
    """Choose an axis of the file; pictures are added until the result is conclusive."""
    frames = np.stack(axis_frames(frame))
    ups, evidence = frames[:, 1], np.stack([cues.evidence(each) for each in frames])
    before = np.array([prior(probe, each) for each in frames])
    is_file_up = ups @ AXES["+y"] == 1
    seen = cameras.seen(frames[is_file_up], SIDES)
    odds = probe.terms(seen, ups, evidence) @ probe.odds[0]
    if decide(frames, odds).confidence >= EARLY_STOP_CONFIDENCE:
        return decide(frames, odds + before)
    seen += cameras.seen(frames[~is_file_up], SIDES)
    up = decide(frames, probe.terms(seen, ups, evidence) @ probe.odds[1] + before)
    if up.confidence < SURE:
        seen += cameras.seen(frames, CORNERS)
        up = decide(frames, probe.terms(seen, ups, evidence) @ probe.odds[1] + before)
    return up


def _among_candidates(cues: StabilityCues, frame: Float64, cameras: ProbeCameras, probe: UpProbe) -> Up:
    """Choose the up of a shape that is not aligned with the file; the first row of `frame` is its mirror normal.

    Pictures around all axes of the file give a first estimate. Then pictures around its likeliest candidates are added.
    The axes of the file remain candidates, because the mirror normal may be wrong.
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

    Candidates are the axes of the file, the stable poses with an upright mirror plane, and the two main axes of the
    pictures' quadratic form `form` (3, 3), with and without projection to the mirror plane.
    """
    normal = frame[0]
    main = np.linalg.eigh(form)[1].T[::-1][:2]
    projected = [each / np.linalg.norm(each) for each in main - np.outer(main @ normal, normal) if each @ each > 0.25]
    found = [AXES["+y"], AXES["+z"], AXES["+x"]]
    for up in [*cues.stable_ups(frame), *projected, *main]:
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
    """Return the likeliest of `frames` (2K, 3, 3), each followed by its upside-down frame, by their log-odds (2K,).

    Probabilities of nearly parallel axes are added, because their pictures hardly differ.
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
