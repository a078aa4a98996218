"""`python -m bench.training.learn_up`: learn which way is up, and judge it on families that were left out.

The shapes are those under CC0 in the folder DFD_MESHES, the samples of dfd, and a folder given with `--lessons`. All
stand +y up. Equal folders give equal files. docs/learned.md names the sources of the package's probe.
"""

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

import dfd
from bench.quality.shapes import SAMPLES
from bench.tables import to_markdown
from bench.training.sources import RESULTS, kept_arrays, run, upright_files
from bench.training.up_lessons import FRAMES, LESSONS, TRUE, UpLesson, learned_odds, learned_votes, left_out_odds
from dfd.common.linear_algebra import Float64
from dfd.encoders.encode import Encoder
from dfd.encoders.learned_file import encoder_identity
from dfd.field.cache_key import FIELD_VERSION, hash_key
from dfd.mesh.normalization import normalization
from dfd.upright import probe_views
from dfd.upright.find_up import CLEAR, EARLY_STOP_CONFIDENCE
from dfd.upright.probe import FOLDER, UpProbe
from dfd.upright.probe_views import CORNERS, SIDES, ProbeCameras, ViewTokens
from dfd.upright.stability import StabilityCues

REPORT, KEPT_VIEWS = RESULTS / "up.md", RESULTS / "views_around"
KEPT = 0.99  # least fraction of upright files whose axis is among the axes with pictures
# Least fraction of the shapes of DFD_MESHES and samples whose axis is the likeliest; many have no clear up.
KEPT_OWN = 0.97
KEPT_UP = 0.985  # least fraction of upright files that are not taken for upside down
Z_SHARE = 0.35  # of the log-odds of the file's +y, for its ±z, as many files have z up
PRIORS, LOSSES = np.arange(0, 12, 0.05), np.arange(0, 6, 0.1)


def main(arguments: Sequence[str] | None = None) -> None:
    """Learn, judge and write."""
    run(arguments, __spec__.name, __doc__, FOLDER, REPORT, lessons_of, learn, report)


def lessons_of(folder: Path, more: Path | None, encoder: Encoder) -> Iterator[UpLesson]:
    """Yield the lesson of every shape."""
    for path in upright_files(folder, more):
        known = LESSONS if more and path.is_relative_to(more) else ""
        yield lesson(f"{known}{path.parent.name}/{path.stem}", dfd.load(path), encoder)
    for name, make in SAMPLES.items():
        yield lesson(name, make().mesh, encoder)


def lesson(name: str, mesh: dfd.Mesh, encoder: Encoder) -> UpLesson:
    """Return the lesson of one shape, +y up."""
    print(name, flush=True)
    center, scale = normalization(mesh)
    vertices = (mesh.vertices - center) * scale
    cues = StabilityCues(vertices, mesh.faces)
    evidence = np.stack([cues.evidence(frame) for frame in FRAMES])
    sides, corners = (cached_tokens(mesh, encoder, FRAMES, eyes) for eyes in (SIDES, CORNERS))
    of_frames = map(ViewTokens, np.split(sides.tokens, len(FRAMES)), np.split(sides.axes, len(FRAMES)))
    rotation = Rotation.random(rng=np.random.default_rng([0, *name.encode()])).as_matrix()
    tilted = cached_tokens(mesh, encoder, FRAMES @ rotation, SIDES)
    tilted = replace(tilted, axes=tilted.axes @ rotation.T)
    tilted_cues = StabilityCues(vertices @ rotation.T, mesh.faces)
    return UpLesson(name, tuple(of_frames), corners, evidence, rotation, tilted, tilted_cues)


def cached_tokens(mesh: dfd.Mesh, encoder: Encoder, frames: Float64, eyes: Float64) -> ViewTokens:
    """Return `ProbeCameras.seen`, from a file if it exists, because pictures take minutes."""
    key = {
        "field_version": FIELD_VERSION,
        "around": hashlib.sha256(Path(probe_views.__file__).read_bytes()).hexdigest(),
        "mesh": mesh.content_hash,
        "frames": frames.round(6).tolist(),
        "eyes": eyes.round(6).tolist(),
        **encoder.settings(),
    }
    path = KEPT_VIEWS / f"{hash_key(key)}.npz"
    return ViewTokens(**kept_arrays(path, lambda: vars(ProbeCameras(mesh, encoder).seen(frames, eyes))))


def learn(lessons: tuple[UpLesson, ...], encoder: Encoder) -> UpProbe:
    """Return the probe of all lessons; its odds and priors fit votes that were learned without the judged shape."""
    votes, odds = learned_votes(lessons).without(), learned_odds(lessons)
    up, down = least_priors(lessons)
    return UpProbe(votes.mean, votes.form, votes.vector, odds, up, down, Z_SHARE * up, *encoder_identity(encoder))


def with_priors(odds: Float64, up: int, priors: tuple[float, float]) -> Float64:
    """Add to `odds` (…, 6) those of the file's +y along frame `up`, of its −y, and of its ±z along the next axis."""
    z = (up // 2 + 1) % 3
    added = np.zeros(len(FRAMES))
    added[[up, up ^ 1]] = priors
    added[[2 * z, 2 * z + 1]] = Z_SHARE * priors[0]
    return odds + added


def of_axes(odds: Float64) -> Float64:
    """Return the log-odds (…, 3) that either frame of an axis is up, from those of frames (…, 6)."""
    return np.logaddexp(odds[..., ::2], odds[..., 1::2])


def decided(odds: Float64, up: int, priors: tuple[float, float]) -> tuple[int, int]:
    """Return the likeliest axis and frame if frame `up` is the file's +y.

    `odds` (7, 6) are those of `left_out_odds`. As in `dfd.upright.find_up`, pictures around the file's +y decide alone
    if they are certain.
    """
    axes = of_axes(odds[up])
    sure = np.exp(axes.max() - np.logaddexp.reduce(axes)) >= EARLY_STOP_CONFIDENCE
    found = with_priors(odds[up if sure else -1], up, priors)
    axis = int(of_axes(found).argmax())
    return axis, 2 * axis + int(found[2 * axis + 1] > found[2 * axis])


def least_priors(lessons: tuple[UpLesson, ...]) -> tuple[float, float]:
    """Return the log-odds of the file's +y and −y: the least of +y with which enough shapes keep their axis and up.

    The axis is among the two with pictures for `KEPT` of all shapes, and the likeliest for `KEPT_OWN` of those that
    are not from `--lessons`. `KEPT_UP` of all keep their up. The log-odds of −y are the largest with which this holds.
    """
    odds = left_out_odds(lessons, "name")
    rows = np.stack([each[-1] for each in odds.values()])
    own = np.array([not name.startswith(LESSONS) for name in odds])
    for up, loss in product(PRIORS, LOSSES):
        found = with_priors(rows, TRUE, (up, up - loss))
        axes = of_axes(found)
        first, second = np.argsort(-axes, axis=1).T[:2] == TRUE // 2
        doubtful = axes.max(axis=1) - np.logaddexp.reduce(axes, axis=1) < np.log(CLEAR)
        fallen = first & (found[:, TRUE ^ 1] > found[:, TRUE])
        kept = (first | (doubtful & second)).mean() >= KEPT and first[own].mean() >= KEPT_OWN
        if kept and fallen.mean() <= 1 - KEPT_UP:
            break
    return float(up), float(up - loss)


def report(lessons: tuple[UpLesson, ...]) -> str:
    """Return a report: how often the upright axis, and in brackets the up direction, is found by other lessons."""
    priors = least_priors(lessons)
    own = [each for each in lessons if not each.name.startswith(LESSONS)]
    blocks = [
        "# Which way is up",
        f"{len(lessons)} shapes, of which {len(own)} are from DFD_MESHES or samples; those are judged. Log-odds of the "
        f"file's +y: {priors[0]:.2f}, of −y: {priors[1]:.2f}, of ±z: {Z_SHARE * priors[0]:.2f}.",
    ]
    for left_out, group in (("its family", "family"), ("itself", "name")):
        odds, rows = left_out_odds(lessons, group), []
        for family in [*dict.fromkeys(each.family for each in own), "all"]:
            some = [odds[each.name] for each in own if family in (each.family, "all")]
            # If the file's +y is [0, 1], its z is the axis after it, the shape's up.
            rows.append([family, len(some), *(_found(some, ups, priors) for ups in ([TRUE], [0, 1], range(6)))])
        columns = ("family", "shapes", "kept upright", "found z up", "found, 6 directions")
        blocks += [f"Each judged without {left_out}:", to_markdown(columns, rows)]
    return "\n\n".join(blocks) + "\n"


def _found(odds: Sequence[Float64], ups: Sequence[int], priors: tuple[float, float]) -> str:
    found = [decided(each, up, priors) for each in odds for up in ups]
    axis, direction = np.mean([[axis == TRUE // 2, frame == TRUE] for axis, frame in found], axis=0)
    return f"{axis:.2f} ({direction:.2f})"


if __name__ == "__main__":
    main()
