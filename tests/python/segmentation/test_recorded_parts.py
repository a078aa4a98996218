"""Compare patches and parts with recorded ones. After a change that is meant, record again with `DFD_RECORD=1`.

Any change of a constant or a rule of the segmentation changes some of these numbers. So who makes one sees which shapes
it changes, and looks at them.
"""

import json
import os
from pathlib import Path

import numpy as np
import pytest
import trimesh
from prepared import sample_parts
from recording import rounded, same

import dfd
from bench.training.made_shapes import made_shape
from dfd.segmentation.alike import POSSIBLE
from dfd.segmentation.choose import candidates, ladder, probabilities
from dfd.segmentation.parts import Parts

RECORDED = Path(__file__).parent / "recorded"
PLACES, LEVELS = 16, (-2, -1, 0, 1)
TOLERANCES = 1e-4, 1e-6  # relative and absolute
DIFFERENT = 1  # number of places at which another machine may choose another part, because two are nearly as likely


def of_sample(name):
    sample, parts = sample_parts(name)
    return sample.mesh, parts


def waves(mesh):
    """Return the parts of a shape by cosines of the positions along random directions, and without planes."""
    random = np.random.default_rng(0)
    rows = np.cos(9 / mesh.diagonal * mesh.vertices @ random.normal(size=(3, 16)) + random.uniform(0, 7, 16))
    rows = (rows / np.linalg.norm(rows, axis=1, keepdims=True)).astype(np.float32)
    return mesh, Parts(mesh, lambda some: rows[some])


def mugs():
    """Return the parts of two cups, each with a loose ball inside, of a plate close to both, and of a tiny ball."""
    moved = trimesh.transformations.translation_matrix
    cup, ball = trimesh.creation.annulus(0.4, 0.5, 1.0), trimesh.creation.icosphere(3, 0.2)
    plate = trimesh.creation.cylinder(1.6, 0.1).subdivide_to_size(0.1).apply_transform(moved((0, 0, -0.56)))
    whole = [each.copy().apply_transform(moved((x, 0, 0))) for x in (-0.8, 0.8) for each in (cup, ball)]
    tiny = trimesh.creation.icosphere(2, 0.02).apply_transform(moved((0, 1.2, -0.49)))
    made = trimesh.util.concatenate([*(each.subdivide_to_size(0.15) for each in whole), plate, tiny])
    return waves(dfd.Mesh(made.vertices, made.faces))


SHAPES = {
    "quadruped": lambda: of_sample("quadruped"),
    "robot": lambda: of_sample("robot"),
    "insect": lambda: waves(made_shape(200).mesh),
    "mugs": mugs,
}


def found_at(parts, vertex):
    """Return numbers about the parts at a vertex, and about the likely part there."""
    found = candidates(parts._trees, int(parts._patches.of_vertex[vertex]))
    rungs, middle = ladder(found, parts._patches.area)
    chosen = rungs[middle]
    by_level = [parts.part(vertex, level) for level in LEVELS]
    followers = parts._alike.followers(found.regions[chosen], least=POSSIBLE)
    return {
        "levels": parts.levels(vertex),
        "candidates": len(found.regions),
        "clear": bool(found.clear),
        "votes": int(found.votes[chosen]),
        "shares": [each.share for each in by_level],
        "vertices": [int(each.mask.sum()) for each in by_level],
        "components": [each.components for each in by_level],
        "alone": parts.part(vertex, follow="none").share,
        "followers": sorted(each.probability for each in followers),
        "mirrored": parts.part(vertex, follow="mirror").share,
        "cues": found.cues[chosen].tolist(),
        "likely": float(probabilities(found)[chosen]),
    }


def told(mesh, parts):
    """Return numbers about the patches, about the parts at some places, and about the cut of a shape."""
    patches, trees = parts._patches, parts._trees
    own = {"patches": len(patches.area), "orbits": int(patches.orbit.max()) + 1, "regions": len(trees.areas)}
    for name, values in {
        "border": patches.borders.length,
        "concavity": np.abs(patches.borders.concavity),
        "links": patches.borders.length == 0,
        "places": np.sort(patches.area)[::100],
        "strength": trees.strength,
    }.items():
        own[name] = float(values.mean())
    cut = [(each.share, each.components, int(each.mask.sum()), each.vertex) for each in parts.cut()]
    places = np.linspace(0, len(mesh.vertices) - 1, PLACES).astype(int)[::2].tolist()
    return {"shape": own, "cut": cut, "places": [found_at(parts, vertex) for vertex in places]}


def written(document):
    """Return the text of a document: one line for the shape, for the cut and for each place."""
    few = rounded(document, 6)
    places = ",\n".join(map(json.dumps, few["places"]))
    return f'{{"shape": {json.dumps(few["shape"])},\n"cut": {json.dumps(few["cut"])},\n"places": [\n{places}]}}\n'


@pytest.mark.parametrize("name", SHAPES)
def test_parts_are_the_recorded_ones(name):
    file, now = RECORDED / f"{name}.json", told(*SHAPES[name]())
    if os.environ.get("DFD_RECORD"):
        file.write_text(written(now))
    recorded = json.loads(file.read_text())
    assert same(now["shape"], recorded["shape"], *TOLERANCES), (now["shape"], recorded["shape"])
    assert same(now["cut"], recorded["cut"], *TOLERANCES)
    pairs = enumerate(zip(now["places"], recorded["places"], strict=True))
    differ = [number for number, (one, other) in pairs if not same(one, other, *TOLERANCES)]
    assert len(differ) <= DIFFERENT, {n: (now["places"][n], recorded["places"][n]) for n in differ}
