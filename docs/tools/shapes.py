"""The shapes of `try.md`, with all that the page asks of a server: `python docs/tools/shapes.py FOLDER`.

FOLDER gets `session.json`, and a folder for each shape: `mesh.bin`, `colors.bin`, `state.json` and `suggestions.json`
are messages of the app's server (`dfd.app.protocol`); `features.bin` is what one step of the compact features is worth,
as float32, and then their bytes. `grips.bin` is what handles with the reach "part" weigh, in bytes: the grip of each
vertex, and for each grip (V) weights in 255 steps.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

import dfd
from dfd.app.protocol.answers import FieldState, SampleEntry, SessionMessage, Suggestion, SuggestionsMessage
from dfd.app.protocol.parts import control_entries
from dfd.app.session.columns import Columns
from dfd.app.session.state import ViewState, feature_colors_message, state_message
from dfd.app.session.surface import mesh_messages
from dfd.common.errors import ArgumentError
from dfd.common.linear_algebra import Float64
from dfd.editing.suggestions import suggest_handles
from dfd.samples.implicit import Distance, Piece, Shape, capsule, chain, ellipsoid, rounded_box
from dfd.samples.polygonize import polygonize
from dfd.weights.compact import CompactFeatures

FACES = 20_000
SAMPLED = 9  # vertices of a grip: what most of them weigh stands for all
TOLERANCES = (0.01, 0.02, 0.04)  # of weights: the first that bytes meet
Triple = tuple[float, float, float]


def main(folder: Path) -> None:
    """Write all shapes."""
    meshes = {name: make() for name, make in SHAPES.items()}
    for name, mesh in meshes.items():
        write(dfd.Deformer(mesh, dfd.distill(mesh, progress=False)), name, folder / name)
        print(f"{name}: {sum(file.stat().st_size for file in (folder / name).iterdir()) / 1e6:.2f} MB", flush=True)
    write_session(meshes, folder)


def write_session(meshes: dict[str, dfd.Mesh], folder: Path) -> None:
    """Write what lists the shapes."""
    entries = [SampleEntry(name=name, title=name.capitalize(), faces=len(mesh.faces)) for name, mesh in meshes.items()]
    # The page has columns for the reach "part" and for a number, which is no word.
    controls = tuple(
        each.model_copy(update={"choices": ("part",)}) if each.name == "reach" else each for each in control_entries()
    )
    session = SessionMessage(
        session="0" * 32,
        resumed=False,
        dfd=version("dfd"),
        samples=tuple(entries),
        upload_bytes=0,
        formats=(),
        controls=controls,
    )
    (folder / "session.json").write_text(session.model_dump_json(), encoding="utf-8")


def write(deformer: dfd.Deformer, name: str, folder: Path) -> None:
    """Write what the page needs of the shape of a session that has just begun."""
    folder.mkdir(parents=True, exist_ok=True)
    mesh = deformer.mesh
    features = stored(deformer.features)
    planes = dfd.symmetry_planes(deformer.bound.field, mesh)
    suggested = suggest_handles(mesh, features, count=8, planes=planes)
    held = grips(deformer)
    # One handle is the page's pattern for all: look-alikes turn about its pivot.
    deformer.blend = "linear"
    deformer.add(suggested[0].vertex, instances="shared_pivot")
    view = ViewState(FieldState(status="ready", origin="prepared"), planes={"default": planes})
    state = state_message(view, deformer, Columns(deformer), after=0)
    places = tuple(
        Suggestion(vertex=each.vertex, position=tuple(mesh.vertices[each.vertex].tolist()), name=f"Part {number}")
        for number, each in enumerate(suggested, 1)
    )
    (shape,) = mesh_messages(mesh, number=1, name=name, warnings=())
    files = {
        "mesh.bin": shape,
        "colors.bin": feature_colors_message(deformer, request=0),
        "features.bin": packed(features),
        "grips.bin": held,
        "state.json": state.model_dump_json().encode(),
        "suggestions.json": SuggestionsMessage(suggestions=places).model_dump_json().encode(),
    }
    for file, data in files.items():
        (folder / file).write_bytes(data)


def grips(deformer: dfd.Deformer) -> bytes:
    """The file of what new handles weigh wherever they are put: most vertices share few columns."""
    of_vertex = deformer.bound.parts.grips()
    rows = []
    for number in range(of_vertex.max() + 1):
        own = np.flatnonzero(of_vertex == number)
        found = []
        for vertex in own[:: -(-len(own) // SAMPLED)].tolist():
            handle = deformer.add(vertex, instances="shared_pivot")
            found.append(deformer.following[:, 0])
            deformer.remove(handle)
        rows.append(np.rint(255 * np.median(found, axis=0)).astype(np.uint8))
    if len(rows) > 256:
        raise ArgumentError("mesh", f"must have at most 256 grips for a byte each, got {len(rows)}", "grips")
    return of_vertex.astype(np.uint8).tobytes() + np.concatenate(rows).tobytes()


def packed(features: CompactFeatures) -> bytes:
    """The file of compact features in bytes."""
    return np.float32(features.step).tobytes() + features.blocks.tobytes()


def stored(rows: Any) -> CompactFeatures:
    """Compact features of such rows in bytes, which are all that `dfd.wasm` reads."""
    for tolerance in TOLERANCES:
        features = dfd.compact(rows, tolerance=tolerance)
        if features.precision == "int8":
            return features
    raise ArgumentError("tolerance", f"must be larger for features of 8 bits, got {TOLERANCES}", "stored")


# --- shapes: upright, about 1 high and mirrored at x = 0, as those of `dfd.samples`


def modeled(pieces: list[Piece], low: Triple, high: Triple) -> dfd.Mesh:
    """The mesh of a shape within a box."""
    return dfd.Mesh(*polygonize(Shape(pieces), low, high, FACES))


def limb(part: str, points: list[Triple], radii: list[float], blend: float = 0.02, paired: bool = True) -> list[Piece]:
    """Capsules one after the other."""
    return [Piece(part, each, 0, paired, blend) for each in chain(points, radii)]


def wheel(center: Triple, radius: float, half_width: float, rounding: float = 0.012) -> Distance:
    """A disk about an axle along x."""
    origin = np.array(center)

    def distance(points: Float64) -> Float64:
        local = points - origin
        over = np.stack(
            [np.hypot(local[:, 1], local[:, 2]) - radius + rounding, np.abs(local[:, 0]) - half_width + rounding]
        )
        outside: Float64 = np.hypot(*np.maximum(over, 0)) + np.minimum(over.max(axis=0), 0) - rounding
        return outside

    return distance


def person() -> dfd.Mesh:
    """A person with the arms held off the body."""
    return modeled(
        [
            Piece("torso", capsule((0, 0.56, 0), (0, 0.70, 0), 0.085, 0.10)),
            Piece("torso", ellipsoid((0.055, 0.74, 0), (0.10, 0.075, 0.07)), 0, True, 0.06),
            Piece("torso", ellipsoid((0, 0.50, -0.005), (0.105, 0.075, 0.08)), blend=0.06),
            Piece("head", capsule((0, 0.80, 0), (0, 0.87, 0.01), 0.036), blend=0.03),
            Piece("head", ellipsoid((0, 0.945, 0.015), (0.066, 0.085, 0.08)), blend=0.02),
            Piece("head", ellipsoid((0, 0.935, 0.098), (0.012, 0.018, 0.018)), blend=0.015),
            Piece("head", ellipsoid((0.068, 0.945, 0.0), (0.010, 0.022, 0.014)), 0, True, 0.008),
            *limb("arm", [(0.135, 0.765, 0), (0.235, 0.62, -0.005), (0.31, 0.48, 0.03)], [0.045, 0.034, 0.024], 0.03),
            Piece("hand", ellipsoid((0.325, 0.445, 0.04), (0.022, 0.040, 0.032), roll=0.4), 0, True, 0.015),
            *limb("hand", [(0.335, 0.425, 0.055), (0.350, 0.375, 0.065)], [0.013, 0.010], 0.008),
            *limb("hand", [(0.338, 0.425, 0.035), (0.356, 0.368, 0.038)], [0.013, 0.010], 0.008),
            *limb("hand", [(0.315, 0.455, 0.065), (0.305, 0.425, 0.092)], [0.012, 0.010], 0.008),
            *limb("leg", [(0.062, 0.47, 0), (0.080, 0.27, 0.015), (0.090, 0.07, -0.01)], [0.070, 0.047, 0.032], 0.03),
            *limb("foot", [(0.092, 0.032, -0.015), (0.105, 0.028, 0.095)], [0.034, 0.028], 0.02),
        ],
        (-0.45, -0.05, -0.2),
        (0.45, 1.1, 0.25),
    )


def truck() -> dfd.Mesh:
    """A truck with a cab, a bed and four wheels."""
    wheels = [
        Piece("wheel", distance, instance, True, 0.006)
        for instance, z in ((0, 0.36), (2, -0.36))
        for distance in (wheel((0.235, 0.14, z), 0.14, 0.05), wheel((0.285, 0.14, z), 0.06, 0.02))
    ]
    return modeled(
        [
            Piece("bed", rounded_box((0, 0.20, -0.02), (0.17, 0.045, 0.62), 0.02)),
            Piece("bed", rounded_box((0, 0.27, -0.25), (0.27, 0.035, 0.40), 0.015), blend=0.01),
            Piece("bed", rounded_box((0.255, 0.37, -0.25), (0.018, 0.10, 0.40), 0.012), 0, True, 0.01),
            Piece("bed", rounded_box((0, 0.37, -0.64), (0.27, 0.10, 0.018), 0.012), blend=0.01),
            Piece("cab", rounded_box((0, 0.42, 0.36), (0.26, 0.20, 0.17), 0.05), blend=0.01),
            Piece("cab", rounded_box((0, 0.34, 0.56), (0.235, 0.12, 0.10), 0.04), blend=0.03),
            Piece("lamp", ellipsoid((0.16, 0.34, 0.66), (0.04, 0.04, 0.025)), 0, True, 0.008),
            Piece("mirror", capsule((0.26, 0.47, 0.47), (0.32, 0.47, 0.48), 0.012), 0, True, 0.006),
            Piece("mirror", ellipsoid((0.33, 0.48, 0.48), (0.018, 0.045, 0.03)), 0, True, 0.006),
            *wheels,
        ],
        (-0.45, -0.05, -0.8),
        (0.45, 0.75, 0.8),
    )


def plane() -> dfd.Mesh:
    """An airliner with two engines."""
    return modeled(
        [
            Piece("body", capsule((0, 0.30, -0.20), (0, 0.30, 0.52), 0.085, 0.085)),
            Piece("body", capsule((0, 0.30, -0.20), (0, 0.345, -0.62), 0.085, 0.030), blend=0.04),
            Piece("body", ellipsoid((0, 0.29, 0.56), (0.075, 0.072, 0.13)), blend=0.04),
            Piece("wing", _vane((0.05, 0.27, 0.10), (0.66, 0.33, -0.20), 0.15, 0.05, 0.024), 0, True, 0.03),
            Piece("wing", _vane((0.66, 0.33, -0.20), (0.685, 0.41, -0.25), 0.05, 0.03, 0.018), 0, True, 0.01),
            Piece("engine", capsule((0.25, 0.225, 0.06), (0.25, 0.225, 0.20), 0.042, 0.052), 0, True, 0.012),
            Piece("tail", _vane((0.02, 0.35, -0.54), (0.25, 0.37, -0.66), 0.08, 0.035, 0.017), 0, True, 0.02),
            Piece("fin", _vane((0, 0.36, -0.50), (0, 0.60, -0.68), 0.10, 0.05, 0.018), blend=0.02),
        ],
        (-0.8, 0.05, -0.85),
        (0.8, 0.75, 0.8),
    )


def _vane(root: Triple, tip: Triple, root_chord: float, tip_chord: float, thickness: float) -> Distance:
    """A wing: discs along z from root to tip, each a chord long and thin across."""
    points = np.linspace(root, tip, 12)
    chords = np.linspace(root_chord, tip_chord, 12)
    flat = 1 if root[0] != tip[0] else 0

    def radii(chord: float) -> Triple:
        sizes = [0.0, 0.0, chord]
        span = float(np.linalg.norm(np.subtract(tip, root))) / 11
        sizes[flat], sizes[1 - flat] = thickness, max(span * 1.5, 0.03)
        return (sizes[0], sizes[1], sizes[2])

    slices = [ellipsoid(tuple(point), radii(chord)) for point, chord in zip(points.tolist(), chords, strict=True)]
    return lambda at: np.min([each(at) for each in slices], axis=0)


def hand() -> dfd.Mesh:
    """An open hand: its palm lies across x, so that both sides of it are alike."""
    fingers = [
        ([(0, 0.50, 0.115), (0, 0.66, 0.150), (0, 0.80, 0.175)], 0.036),
        ([(0, 0.53, 0.040), (0, 0.72, 0.052), (0, 0.88, 0.060)], 0.038),
        ([(0, 0.52, -0.035), (0, 0.69, -0.045), (0, 0.84, -0.055)], 0.036),
        ([(0, 0.47, -0.105), (0, 0.59, -0.140), (0, 0.69, -0.165)], 0.031),
    ]
    return modeled(
        [
            Piece("palm", rounded_box((0, 0.36, 0.0), (0.048, 0.15, 0.145), 0.045)),
            Piece("palm", capsule((0, 0.05, 0), (0, 0.24, 0), 0.085, 0.08), blend=0.08),
            *[
                piece
                for points, radius in fingers
                for piece in limb("finger", points, [radius, 0.92 * radius, 0.75 * radius], 0.025, False)
            ],
            *limb("thumb", [(0, 0.30, 0.10), (0, 0.41, 0.215), (0, 0.51, 0.285)], [0.055, 0.043, 0.033], 0.04, False),
        ],
        (-0.15, -0.1, -0.35),
        (0.15, 1.05, 0.4),
    )


SHAPES: dict[str, Callable[[], dfd.Mesh]] = {
    "chair": lambda: dfd.samples.chair(FACES).mesh,
    "animal": lambda: dfd.samples.quadruped(FACES).mesh,
    "person": person,
    "truck": truck,
    "plane": plane,
    "hand": hand,
}

if __name__ == "__main__":
    main(Path(sys.argv[1]))
