"""`python -m bench.training.learn_up`: learn an up probe (`dfd.upright.probe`), and test it.

The training shapes are the CC0 models in the folder that DFD_MESHES names, the samples of dfd, and the models in the
folder `--lessons`. Their up is +y. Training on equal files writes equal files. docs/learned.md lists the models.
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
from bench.training.sources import RESULTS, cached_arrays, run, upright_files
from bench.training.up_lessons import FRAMES, LESSONS, TRUE, UpLesson, learned_odds, learned_votes, left_out_odds
from dfd.common.linear_algebra import Float64
from dfd.encoders.encode import Encoder
from dfd.encoders.learned_file import encoder_identity
from dfd.field.cache_key import FIELD_VERSION, hash_key
from dfd.geometry.normalization import normalization
from dfd.upright import probe_views
from dfd.upright.find_up import CLEAR, EARLY_STOP_CONFIDENCE
from dfd.upright.probe import FOLDER, UpProbe
from dfd.upright.probe_views import CORNERS, SIDES, ProbeCameras, ViewTokens
from dfd.upright.stability import StabilityCues

REPORT, VIEWS_CACHE = RESULTS / "up.md", RESULTS / "views_around"
# Priors are accepted if these statements hold for at least the given fractions of all shapes.
KEPT = 0.99  # the upright axis is the likeliest, or, if the result is doubtful (see `CLEAR`), the second likeliest
KEPT_OWN = 0.97  # the upright axis is the likeliest (fraction of the samples and the shapes from DFD_MESHES)
KEPT_UP = 0.985  # the shape is not found upside down
Z_SHARE = 0.35  # prior log-odds of ±z in a file, divided by those of +y; many files have z up
# Prior log-odds of +y to try, and numbers to subtract from them to obtain the prior log-odds of −y.
PRIORS, LOSSES = np.arange(0, 12, 0.05), np.arange(0, 6, 0.1)


def main(arguments: Sequence[str] | None = None) -> None:
    """Learn the probe, test it, and write the probe and a report."""
    run(arguments, __spec__.name, __doc__, FOLDER, REPORT, lessons_of, learn, report)


def lessons_of(folder: Path, more: Path | None, encoder: Encoder) -> Iterator[UpLesson]:
    """Yield the training data (the lesson) of every shape."""
    for path in upright_files(folder, more):
        known = LESSONS if more and path.is_relative_to(more) else ""
        yield lesson(f"{known}{path.parent.name}/{path.stem}", dfd.load(path), encoder)
    for name, make in SAMPLES.items():
        yield lesson(name, make().mesh, encoder)


def lesson(name: str, mesh: dfd.Mesh, encoder: Encoder) -> UpLesson:
    """Return the lesson of one shape, whose up is +y."""
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
    """Return the result of `ProbeCameras.seen`, from a file if it exists, because rendering takes minutes."""
    key = {
        "field_version": FIELD_VERSION,
        "around": hashlib.sha256(Path(probe_views.__file__).read_bytes()).hexdigest(),
        "mesh": mesh.content_hash,
        "frames": frames.round(6).tolist(),
        "eyes": eyes.round(6).tolist(),
        **encoder.settings(),
    }
    path = VIEWS_CACHE / f"{hash_key(key)}.npz"
    return ViewTokens(**cached_arrays(path, lambda: vars(ProbeCameras(mesh, encoder).seen(frames, eyes))))


def learn(lessons: tuple[UpLesson, ...], encoder: Encoder) -> UpProbe:
    """Return the probe of all lessons. Votes on a shape, for odds and priors, are learned without the shape."""
    votes, odds = learned_votes(lessons).without(), learned_odds(lessons)
    up, down = least_priors(lessons)
    return UpProbe(votes.mean, votes.form, votes.vector, odds, up, down, Z_SHARE * up, *encoder_identity(encoder))


def with_priors(odds: Float64, up: int, priors: tuple[float, float]) -> Float64:
    """Add prior log-odds to `odds` (…, 6): `priors` of a file's +y (frame `up`) and −y, and those of its ±z."""
    z = (up // 2 + 1) % 3
    added = np.zeros(len(FRAMES))
    added[[up, up ^ 1]] = priors
    added[[2 * z, 2 * z + 1]] = Z_SHARE * priors[0]
    return odds + added


def of_axes(odds: Float64) -> Float64:
    """Return the log-odds (…, 3) that one of the two frames of an axis is up, from log-odds of frames (…, 6)."""
    return np.logaddexp(odds[..., ::2], odds[..., 1::2])


def decided(odds: Float64, up: int, priors: tuple[float, float]) -> tuple[int, int]:
    """Return the index of the likeliest axis, and of its likelier frame, for a file whose +y is frame `up`.

    `odds` (7, 6) come from `left_out_odds`. As in `dfd.upright.find_up`, if the pictures around the file's +y make an
    axis certain, only these pictures are used.
    """
    axes = of_axes(odds[up])
    sure = np.exp(axes.max() - np.logaddexp.reduce(axes)) >= EARLY_STOP_CONFIDENCE
    found = with_priors(odds[up if sure else -1], up, priors)
    axis = int(of_axes(found).argmax())
    return axis, 2 * axis + int(found[2 * axis + 1] > found[2 * axis])


def least_priors(lessons: tuple[UpLesson, ...]) -> tuple[float, float]:
    """Return the first prior log-odds of +y and −y, from `PRIORS` and `LOSSES`, that are accepted (see `KEPT`)."""
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
    """Return a report: how often probes learned from other shapes find the upright axis, and the up direction."""
    priors = least_priors(lessons)
    own = [each for each in lessons if not each.name.startswith(LESSONS)]
    blocks = [
        "# Which way is up",
        f"{len(lessons)} shapes, of which {len(own)} are from DFD_MESHES or samples; these are tested. Prior log-odds "
        f"of +y: {priors[0]:.2f}, of −y: {priors[1]:.2f}, of ±z: {Z_SHARE * priors[0]:.2f}.",
    ]
    for left_out, group in (("its family", "family"), ("itself", "name")):
        odds, rows = left_out_odds(lessons, group), []
        for family in [*dict.fromkeys(each.family for each in own), "all"]:
            some = [odds[each.name] for each in own if family in (each.family, "all")]
            # If the +y of a file is frame 0 or 1 of the shape, the file's z is the upright axis.
            rows.append([family, len(some), *(_found(some, ups, priors) for ups in ([TRUE], [0, 1], range(6)))])
        columns = ("family", "shapes", "kept upright", "found z up", "found, 6 directions")
        blocks += [f"Fraction of correct axes (directions) if learned without {left_out}:", to_markdown(columns, rows)]
    return "\n\n".join(blocks) + "\n"


def _found(odds: Sequence[Float64], ups: Sequence[int], priors: tuple[float, float]) -> str:
    found = [decided(each, up, priors) for each in odds for up in ups]
    axis, direction = np.mean([[axis == TRUE // 2, frame == TRUE] for axis, frame in found], axis=0)
    return f"{axis:.2f} ({direction:.2f})"


if __name__ == "__main__":
    main()
