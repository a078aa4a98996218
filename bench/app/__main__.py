"""`python -m bench.app clicks [FOLDER]` and `python -m bench.app waits`: measure the app in Chromium.

`clicks` plays gestures of a user who means a certain part, and counts the clicks on proposals until the part is right.
A place is random, and the meant part is the kind of part of a sample there, or the set of segments that a person means
there (`bench.quality.alike`, on meshes of FOLDER). The user clicks the proposal with the largest IoU, if it is above
the present one, until the IoU is at least 0.8 or no proposal is better.

`waits` times what a user waits for, on the samples: until the page shows a sign, such as a progress bar, a word or the
result, and until the result is there.

Both need Node, the client's packages (`npm ci`) and the built page.
"""

import argparse
import json
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import dfd
import dfd.samples
from bench.quality.alike import alike_shapes, meant
from bench.tables import to_markdown
from dfd.app.options import SAMPLE_FACES, SAMPLES, OpenedFile, SessionOptions
from dfd.app.web.launch import RunningApp
from dfd.geometry.topology import face_areas

HERE = Path(__file__).parent
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
GOOD = 0.8  # IoU from which a part is right; `bench.quality.people` measures 0.77 between two people
GESTURES = 30
ON_A_SHAPE = 3  # gestures on each labelled mesh


def run(script: str, options: SessionOptions, task: Any = None) -> Any:
    """Run a script of this folder in Node with a new server, and return the JSON that it prints."""
    with tempfile.TemporaryDirectory() as data:
        os.environ["DFD_DATA"] = data
        app = RunningApp(options)
        app.start()
        browser = next(filter(None, map(shutil.which, BROWSERS)), "")
        environment = {**os.environ, "DFD_URL": app.url, "DFD_CHROMIUM": browser, "DFD_PATIENCE": "600000"}
        try:
            told = subprocess.run(
                ["node", HERE / script],
                input=json.dumps(task),
                env=environment,
                stdout=subprocess.PIPE,
                text=True,
                check=True,
            )
        finally:
            app.stop()
    return json.loads(told.stdout)


Gesture = dict[str, Any]  # the vertex of the place, and one or two lists of meant vertices


def sample_gestures(name: str, count: int, generator: np.random.Generator) -> tuple[list[float], list[Gesture]]:
    """Return the area of each vertex of a sample, and `count` gestures. All parts of one kind are meant."""
    sample = getattr(dfd.samples, name)(SAMPLE_FACES)
    area = vertex_areas(sample.mesh)
    places = generator.choice(len(area), count, p=area / area.sum())
    found = [
        {"vertex": int(at), "meant": [sample.vertices_of(sample.parts[sample.labels[at]]).tolist()]} for at in places
    ]
    return area.tolist(), found


def labelled_gestures(folder: Path, count: int) -> Iterator[tuple[str, dfd.Mesh, list[float], list[Gesture]]]:
    """Yield meshes of `folder`, one of each category, with the areas of their vertices and gestures; `count` in all."""
    for shape in alike_shapes(folder, quick=True):
        mesh, own = shape.mesh, min(ON_A_SHAPE, count)
        if own == 0:
            return
        count -= own
        sets = [each for _, each in zip(range(own), meant(shape, face_areas(mesh.vertices, mesh.faces)), strict=False)]
        gestures = [
            {
                "vertex": int(mesh.faces[each.place.face, 0]),
                "meant": [np.unique(mesh.faces[faces]).tolist() for faces in (each.flat, each.closed)],
            }
            for each in sets
        ]
        yield shape.name, mesh, vertex_areas(mesh).tolist(), gestures


def vertex_areas(mesh: dfd.Mesh) -> np.ndarray:
    """Return for each vertex a third of the area of its faces."""
    thirds = np.repeat(face_areas(mesh.vertices, mesh.faces) / 3, 3)
    return np.bincount(mesh.faces.ravel(), thirds, len(mesh.vertices))


def clicks(folder: Path | None, count: int) -> None:
    """Print a table with a row for each gesture, and the means."""
    rows: list[list[Any]] = []

    def add(name: str, options: SessionOptions, area: list[float], gestures: Sequence[Gesture]) -> None:
        task = {"area": area, "gestures": gestures, "good": GOOD}
        for gesture, found in zip(gestures, run("clicks.mjs", options, task), strict=True):
            rows.append([name, gesture["vertex"], found["before"], found["clicks"], found["after"], found["best"]])

    generator = np.random.default_rng(0)
    of_samples = count if folder is None else count // 3
    for i, name in enumerate(SAMPLES):
        own = len(range(i, of_samples, len(SAMPLES)))
        add(name, SessionOptions(mesh=name), *sample_gestures(name, own, generator))
    with tempfile.TemporaryDirectory() as place:
        for name, mesh, area, gestures in labelled_gestures(folder, count - of_samples) if folder else ():
            shape, field = Path(place) / "shape.ply", Path(place) / "shape.field.safetensors"
            mesh.save(shape)
            dfd.distill(mesh, progress=False).save(field)
            opened = [OpenedFile(path.name, path) for path in (shape, field)]
            add(name, SessionOptions(mesh=opened[0], field=opened[1]), area, gestures)
    print(to_markdown(["shape", "vertex", "IoU before", "clicks", "IoU after", "best IoU of all choices"], rows, ".2f"))
    before, taken, after, best = (np.array([row[k] for row in rows], float) for k in (2, 3, 4, 5))
    right = after >= np.minimum(GOOD, best - 0.01)
    shares = [f"{np.mean(right & some):.0%}" for some in (taken == 0, taken == 1, taken > 1)]
    print(f"\n{len(rows)} gestures; IoU before {before.mean():.2f}, after {after.mean():.2f}, best {best.mean():.2f}")
    print(f"right from the start {shares[0]}, after one click {shares[1]}, after more {shares[2]}, ", end="")
    print(f"never {np.mean(~right):.0%}; {taken.mean():.2f} clicks on average")


def waits() -> None:
    """Print a table with the waiting times of all steps on each sample."""
    rows = [
        [name, each["step"], each["sign"], each["done"], each["task"]]
        for name in SAMPLES
        for each in run("waits.mjs", SessionOptions(), name)
    ]
    print(to_markdown(["sample", "step", "sign, ms", "done, ms", "longest script, ms"], rows, ".0f"))


def main() -> None:
    """Measure, and print tables."""
    parser = argparse.ArgumentParser("python -m bench.app", description=__doc__)
    parser.add_argument("verb", choices=("clicks", "waits"))
    parser.add_argument("folder", type=Path, nargs="?", help="clicks: labelled meshes; without it, only samples")
    parser.add_argument("--gestures", type=int, default=GESTURES, help="clicks: number of gestures (%(default)s)")
    given = parser.parse_args()
    if given.verb == "waits":
        waits()
    else:
        clicks(given.folder, given.gestures)


if __name__ == "__main__":
    main()
