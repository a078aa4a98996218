"""Before and after one gesture with the defaults, on animals, people and things: `python docs/grips.py`, then look.

What is held is grabbed at one place and moved in one way. Nothing may tear, crease or spike, and nothing else may move.
Before it stand the parts of that place: the smallest, the one that a handle takes, and the one around it.
Meshes come from the folders that DFD_MESHES names, with ":" between them; what is not there is left out.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import count, islice
from pathlib import Path
from typing import Any

import numpy as np

import dfd
from dfd.pictures.contact_sheet import contact_sheet
from dfd.pictures.picture import picture, save_png
from dfd.segmentation.parts import Level

CELL = 260
LEVELS: tuple[Level, ...] = ("smaller", "part", "larger")
ROWS = 4  # on a page
Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Grip:
    """One gesture.

    Attributes
    ----------
    title, mesh
        What is done, and the file's name, with the folder where several have one name.
    at
        (3,) where it is grabbed: the nearest vertex, in the mesh's box from 0 to 1 along each axis.
    how
        What `Deformer.add` takes; lengths in diagonals of the box.
    verb
        A verb of `Deformer` with its arguments, instead.
    azimuth, elevation
        From where it is seen.
    """

    title: str
    mesh: str
    at: Vector
    how: dict[str, Any] = field(default_factory=dict)
    verb: tuple[str, float, dict[str, Any]] | None = None
    azimuth: float = 35.0
    elevation: float = 15.0

    def on(self, session: dfd.Deformer) -> int:
        """Make the gesture; the vertex that is held."""
        low, high = session.mesh.bounds
        place = low + (high - low) * np.asarray(self.at)
        vertex = int(np.linalg.norm(session.mesh.vertices - place, axis=1).argmin())
        how = dict(self.how)
        if "translation" in how:
            how["translation"] = tuple(session.mesh.diagonal * np.asarray(how["translation"]))
        handle = session.add(vertex, **how)
        if self.verb is not None:
            name, angle, options = self.verb
            getattr(session, name)(handle, angle, **options)
        return vertex


def main() -> None:
    """Draw all, or those whose titles hold a word."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("output", type=Path, nargs="?", default=Path("gallery"))
    parser.add_argument("--only", default="", help="a word of the titles")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    sessions = ((grip, _session(grip)) for grip in GRIPS if options.only in grip.title)
    rows = ((f"{grip.title}: {grip.mesh}", list(_cells(grip, one))) for grip, one in sessions if one is not None)
    for page in count(1):
        if not (shown := list(islice(rows, ROWS))):
            break
        path = options.output / f"grips_{page}.png"
        save_png(path, np.asarray(contact_sheet(shown, cell=CELL)))
        print(path, flush=True)


def _session(grip: Grip) -> dfd.Deformer | None:
    for folder in os.environ.get("DFD_MESHES", "nowhere").split(os.pathsep):
        stem = Path(grip.mesh).name
        for path in sorted(Path(folder).rglob(f"{stem}.*")):
            if path.suffix in (".obj", ".glb", ".off") and path.as_posix().rsplit(".", 1)[0].endswith(grip.mesh):
                mesh = dfd.load(path)
                return dfd.Deformer(mesh, dfd.distill(mesh, progress=False))
    return None


def _cells(grip: Grip, session: dfd.Deformer) -> Iterator[tuple[Any, str]]:
    """The parts there, what follows, the shape before, and after from two sides."""
    mesh, vertex = session.mesh, grip.on(session)
    moved, follows = session.vertices, session.following[:, 0]
    where: dict[str, Any] = {"elevation": grip.elevation, "frame": [mesh.vertices, moved], "resolution": CELL}
    dots = np.array([vertex])
    for level in LEVELS:
        inside = np.isin(np.arange(len(mesh.vertices)), session.part(vertex, level=level).indices)
        drawn = picture(mesh, weights=inside, handles=dots, azimuth=grip.azimuth, **where)
        yield drawn, f"{level}: {inside.mean():.0%}"
    told = session.report().handles[0]
    yield picture(mesh, weights=follows, handles=dots, azimuth=grip.azimuth, **where), f"{told}"
    for azimuth in (grip.azimuth, grip.azimuth + 60):
        yield picture(mesh, azimuth=azimuth, **where), ""
        yield picture(mesh, vertices=moved, azimuth=azimuth, **where), ""


GRIPS = [
    # An ear, horns, legs: parts that come in twos and fours.
    Grip("ear scaled", "horse", (0.67, 1.0, 0.86), {"scale": 2.0}, azimuth=30),
    Grip("legs longer", "horse", (0.78, 0.24, 0.65), {"scale": (1, 1.4, 1)}, azimuth=50),
    Grip("legs thicker", "fox", (0.8, 0.05, 0.7), {"scale": 1.5}, azimuth=50),
    Grip("legs longer", "spot", (0.8, 0.1, 0.2), {"scale": (1, 1.5, 1)}, azimuth=210),
    Grip("horns scaled", "spot", (0.8, 0.95, 0.15), {"scale": 1.8}, azimuth=200),
    Grip("legs thicker", "FourLeg/381", (0.62, 0.25, 0.8), {"scale": 1.4}, azimuth=30),
    Grip("horn scaled", "FourLeg/381", (0.88, 1.0, 0.77), {"scale": 1.8}, azimuth=100),
    # Faces, heads, hands.
    Grip("face scaled", "Bust/301", (0.85, 0.72, 0.75), {"scale": 1.4}, azimuth=20),
    Grip("head scaled", "human_neutral", (0.5, 0.97, 0.6), {"scale": 1.5}, azimuth=20),
    Grip("hand scaled", "human_neutral", (0.97, 0.8, 0.5), {"scale": 1.6}, azimuth=20),
    Grip("nose pulled", "human_neutral", (0.5, 0.92, 0.906), {"translation": (0, 0, 0.05)}, azimuth=50),
    Grip("belly pulled", "Human/5", (0.5, 0.6, 0.0), {"translation": (0, 0, -0.08)}, azimuth=130),
    Grip("belly pulled", "human_neutral", (0.5, 0.62, 0.8), {"translation": (0, 0, 0.08)}, azimuth=50),
    Grip("knee bent", "human_neutral", (0.55, 0.28, 0.6), verb=("bend", 60, {"towards": "back", "joint": "auto"})),
    Grip("jaw opened", "kaiju", (0.5, 0.858, 0.98), verb=("open", 25, {}), azimuth=60),
    Grip("tail up", "velociraptor", (0.5, 1.0, 0.0), verb=("bend", 50, {}), azimuth=70),
    # Twelve more.
    Grip("tail bent", "dog", (0.5, 0.6, 0.0), verb=("bend", 60, {}), azimuth=110),
    Grip("neck bent", "alpaca", (0.5, 0.6, 0.75), verb=("bend", 40, {"towards": "back"}), azimuth=70),
    Grip("tail swung", "kaiju", (0.5, 0.1, 0.0), verb=("bend", 60, {"towards": "left"}), azimuth=150, elevation=40),
    Grip("ear scaled", "Teddy/161", (0.2, 1.0, 0.5), {"scale": 1.6}, azimuth=30),
    Grip("wings bent", "Bird/241", (0.634, 0.861, 1.0), {"rotation": (0, 0, 30)}, azimuth=20, elevation=30),
    Grip("finger bent", "Hand/181", (0.9, 0.3, 1.0), verb=("bend", 40, {"towards": "down"}), azimuth=20),
    Grip("arm curled", "Octopus/121", (1.0, 0.6, 0.5), verb=("bend", 90, {}), azimuth=30, elevation=30),
    Grip("tail fin scaled", "Fish/223", (1.0, 0.5, 0.8), {"scale": 1.5}, azimuth=30),
    Grip("plates scaled", "stegosaurus", (0.5, 1.0, 0.45), {"scale": (1, 1.5, 1)}, azimuth=60),
    Grip("legs longer", "Chair/101", (0.9, 0.02, 0.9), {"scale": (1, 1.4, 1)}, azimuth=30),
    Grip("jaw opened", "anglerfish", (0.5, 0.231, 0.854), verb=("open", 25, {}), azimuth=40),
    Grip("head scaled", "knight", (0.5, 1.0, 0.5), {"scale": 1.4}, azimuth=30),
    Grip("sting lifted", "scorpion", (0.5, 1.0, 0.5), {"translation": (0, 0.12, 0)}, azimuth=50),
]  # fmt: skip

if __name__ == "__main__":
    main()
