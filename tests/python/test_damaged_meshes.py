"""Use every control on damaged meshes, without a crash, a hang or NaN.

DFD_DAMAGED is the number of damaged meshes, by default 6. With DFD_MESHES, the meshes in this folder are also used,
damaged and undamaged.
"""

import faulthandler
import os
import warnings
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from damage import damaged
from every_control import use_every_control
from made_field import field_of

import dfd
from dfd.geometry.simplify import simplify

COUNT = int(os.environ.get("DFD_DAMAGED", "6"))
FOLDER = os.environ.get("DFD_MESHES")
FILES = sorted(path for path in Path(FOLDER).rglob("*") if path.suffix in (".obj", ".glb")) if FOLDER else []
SHAPES = ["chair", "quadruped", "robot", *FILES]
MOST_FACES = 1200  # of a shape before it is damaged
LONGEST = 600  # seconds after which a test counts as a hang


@pytest.fixture(autouse=True)
def _no_hang():
    """Print the stack and stop the process after a hang; ignore warnings for users."""
    faulthandler.dump_traceback_later(LONGEST, exit=True)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        yield
    faulthandler.cancel_dump_traceback_later()


@cache
def shape(number):
    """Return a sample, or a mesh in DFD_MESHES, with few faces."""
    source = SHAPES[number % len(SHAPES)]
    mesh = dfd.load(source) if isinstance(source, Path) else getattr(dfd.samples, source)(4000).mesh
    return simplify(mesh, MOST_FACES)


def rippled(mesh, seed):
    """Return a field with random weights; its features vary more over the surface for larger `seed % 4`."""
    return field_of(mesh, seed, octaves=seed % 4)


@pytest.mark.parametrize(
    "seed", [1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(COUNT) if seed != 1)]
)
def test_damaged_meshes_go_through_every_control(seed):
    mesh, _ = damaged(shape(seed), seed)
    use_every_control(mesh, rippled(mesh, seed), seed)


@pytest.mark.slow
@pytest.mark.skipif(not FILES, reason="DFD_MESHES names no folder of meshes")
@pytest.mark.parametrize("path", FILES if COUNT >= 50 else FILES[:3], ids=lambda path: path.stem)
def test_meshes_of_the_world_go_through_every_control(path):
    mesh = dfd.load(path)
    use_every_control(mesh, rippled(mesh, 3), 4)


def test_a_damaged_mesh_is_distilled(tiny_encoder):
    mesh, _ = damaged(shape(1), 101)
    field = dfd.distill(mesh, tiny_encoder, views=8, resolution=32, steps=5, batch=64, progress=False, cache=False)
    features = field.features(mesh)
    assert np.isfinite(features).all()
    weights = dfd.bind(features, [0])
    assert weights.min() >= 0
    assert weights.max() <= 1
