"""Find the up direction of a shape. Pictures of a shape on its side would give a field with less accurate weights."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from dfd.common.linear_algebra import Float64
from dfd.common.progress import Stages
from dfd.geometry.normalization import box_normalization
from dfd.geometry.topology import face_areas
from dfd.upright.candidates import AXES, Up, axis_frames, explicit_up, frame_facing
from dfd.upright.probe import UpProbe, find_probe
from dfd.upright.probe_views import CORNERS, SIDES, ProbeCameras
from dfd.upright.stability import StabilityCues

if TYPE_CHECKING:
    from dfd.encoders.encode import Encoder
    from dfd.mesh.mesh import Mesh

CLEAR = 0.9  # if no axis has at least this probability, the field is distilled for the two most probable axes
# If an axis has at least this probability after the pictures with +y as up, the search ends, because more pictures
# hardly ever change the result. This probability does not include `prior`.
EARLY_STOP_CONFIDENCE = 0.95
SURE = 0.97  # if an axis is this probable after pictures from the four sides, no pictures from between them are made
SAME = np.cos(np.radians(8))  # cosine of 8°; directions at a smaller angle are one candidate
NEARLY_PARALLEL = np.cos(np.radians(20))  # cosine of 20°; probabilities of axes at a smaller angle are added
GLTF_UP = 2.5  # added to the log-odds of +y for glTF files, because the glTF standard defines +y as up
UNALIGNED_PRIOR = 0.5  # factor of the result of `prior` if the shape is not aligned with the axes of the file


def resolve_up(mesh: Mesh, encoder: Encoder, up: str | tuple[float, float, float], *, stages: Stages) -> Up:
    """Return the up direction for the setting `up`, a result of `check_up`; "auto" calls `find_up`."""
    return find_up(mesh, encoder, stages=stages) if up == "auto" else explicit_up(mesh, up)


def find_up(mesh: Mesh, encoder: Encoder, *, probe: UpProbe | None = None, stages: Stages | None = None) -> Up:
    """Return the up direction of `mesh`, judged from encoded pictures and from its surface (see `StabilityCues`).

    The upright axis is chosen first, then its upper end. If no axis is probable enough, the result has two directions.

    `probe` must be learned from tokens of `encoder`; None is the package's. If the package has none, the result is +y.

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
    """Return the up direction of a shape aligned with the file's axes. Pictures are added until an axis is probable."""
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
    """Return the up direction of a shape not aligned with the file's axes; `frame[0]` is normal to a mirror plane.

    Pictures around all axes of the file give a first estimate. Then pictures around the most probable candidates are
    added. The axes of the file remain candidates, because the mirror normal may be wrong.
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
    """Return 2K frames (2K, 3, 3) in which a tilted shape may be upright. Frame 2k + 1 is frame 2k upside down.

    Up can be an axis of the file or one of `cues.stable_ups`. `form` (3, 3) is the quadratic form of `UpProbe.votes`.
    Its two main eigenvectors can be up too, and so can their projections onto the mirror plane.
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
    """Return the prior log-odds of `frame` without any picture; most files have a conventional up direction."""
    if np.allclose(frame[1], AXES["+y"]):
        return probe.file_up
    if np.allclose(frame[1], AXES["-y"]):
        return probe.file_down
    return probe.file_z if np.allclose(np.abs(frame[1]), AXES["+z"]) else 0.0


def decide(frames: Float64, odds: Float64) -> Up:
    """Return the most probable of `frames` (2K, 3, 3), given their log-odds; frame 2k + 1 is frame 2k upside down.

    Probabilities of nearly parallel axes are added, because pictures around them hardly differ.
    """
    chances = np.exp(odds - odds.max())
    of_axes = chances.reshape(-1, 2).sum(axis=1) / chances.sum()
    ups = frames[::2, 1]
    parallel = np.abs(ups @ ups.T) > NEARLY_PARALLEL
    first = int(of_axes.argmax())
    second = int(np.where(parallel[first], 0, of_axes).argmax())
    best, other = frames[[2 * each + int(odds[2 * each + 1] > odds[2 * each]) for each in (first, second)]]
    sure = float(of_axes[parallel[first]].sum())
    if sure < CLEAR:
        shares = np.array([sure, of_axes[parallel[second] & ~parallel[first]].sum()])
        return Up(best, sure, "averaged", np.stack([best, other]), shares / shares.sum())
    return Up(best, sure, "file" if np.allclose(best[1], AXES["+y"]) else "found")
