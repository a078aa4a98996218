"""Call public functions with unusual arrays, and compare kernels with their float64 references."""

import json
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import reference
from hypothesis import strategies as st
from made_field import field_of
from mesh_files import CORNERS, CUBE

import dfd

MESH = dfd.Mesh(CORNERS, CUBE)
FIELD = field_of(MESH)
SHAPES = [
    *((8, 3), (8, 4), (12, 3), (8,), (1,), (2,), (8, 1), (1, 8)),
    *((2, 3, 4), (1, 3, 4), (0, 3), (0,), (3, 8)),
    (),
]
DTYPES = ["<f8", "<f4", "<f2", "<i8", "<i4", "|u1", "<u8", "|b1", "<c8", "<U3", "|O", ">f4", ">i8", "<M8[s]"]
FILLS: dict[str, Callable[[np.random.Generator, tuple[int, ...]], np.ndarray]] = {
    "small": lambda random, shape: random.random(shape),
    "index": lambda random, shape: random.integers(0, 8, shape),
    "wide": lambda random, shape: random.integers(-9, 20, shape),
    "zero": lambda random, shape: np.zeros(shape),
    "nan": lambda random, shape: np.where(random.random(shape) < 0.2, np.nan, 0.5),
    "infinite": lambda random, shape: np.where(random.random(shape) < 0.2, np.inf, 0.5),
    "huge": lambda random, shape: random.random(shape) * 1e300,
    "tiny": lambda random, shape: random.random(shape) * 1e-300,
}
LAYOUTS: dict[str, Callable[[np.ndarray], Any]] = {
    "plain": lambda array: array,
    "reversed": lambda array: array[::-1] if array.ndim else array,
    "transposed": lambda array: np.ascontiguousarray(array.T).T,
    "strided": lambda array: np.repeat(array, 2, axis=-1)[..., ::2] if array.ndim else array,
    "list": lambda array: array.tolist(),
    "nothing": lambda array: None,
}
# The result of each call must be finite.
CALLS: dict[str, Callable[..., Any]] = {
    "mesh": lambda a, b, c: dfd.Mesh(a, b).vertices,
    "bind": lambda a, b, c: dfd.bind(a, b),
    "bind, fixed": lambda a, b, c: dfd.bind(a, b, fixed=c),
    "bind, geodesic": lambda a, b, c: dfd.bind(a, [0], geodesic=b, locality=1.0),
    "pose": lambda a, b, c: dfd.pose(a, b, c),
    "compact": lambda a, b, c: dfd.bind(dfd.compact(a), [0]),
    "distances": lambda a, b, c: np.nan_to_num(dfd.Geodesics(MESH).distances(a), posinf=0),
    "shape": lambda a, b, c: whole_shape(dfd.Mesh(a, b), c),
    "handle": lambda a, b, c: turned(rotation=a, scale=b, pivot=c),
    "bent handle": lambda a, b, c: turned(bend=a, twist=b, joint=c),
    "controls": lambda a, b, c: turned(reach=a, mask=b, excluded_counterparts=c, rotation=(0, 90, 0)),
    "numbers": lambda a, b, c: turned(falloff=a, locality=b, strength=c, rotation=(0, 90, 0)),
    "planes": lambda a, b, c: [plane.normal for plane in dfd.symmetry_planes(MESH, dfd.VertexField(MESH, a))],
    "parts": lambda a, b, c: dfd.parts(MESH, dfd.VertexField(MESH, a)).part(b).vertices,
    "field": lambda a, b, c: dfd.VertexField(MESH, a)(b),
    "session": lambda a, b, c: moved(dfd.VertexField(MESH, a), b, c),
}


def moved(field: dfd.VertexField, at: Any, by: Any) -> np.ndarray:
    """Return the cube posed with a moved handle and a fixed point at `at`."""
    session = dfd.Deformer(MESH, field)
    session.add(at, translation=by)
    session.fix(at)
    return session.vertices


def turned(**given: Any) -> np.ndarray:
    """Return the cube posed with a handle at its first vertex, whose controls are `given`."""
    session = dfd.Deformer(MESH, FIELD)
    session.add(0, **{name: value for name, value in given.items() if value is not None})
    return session.vertices


def whole_shape(mesh: dfd.Mesh, at: Any) -> list[float]:
    """Return values computed from a whole shape, and at points on it."""
    field = field_of(mesh)
    distances = dfd.Geodesics(mesh).distances(at)
    planes = [number for plane in dfd.symmetry_planes(mesh, field) for number in plane.normal]
    parts = [part.share for part in dfd.parts(mesh, field).cut()]
    return [float(np.nan_to_num(distances, posinf=0).sum()), *planes, *parts]


def array_input() -> st.SearchStrategy[bytes]:
    """Draw a call and its arrays for `call_with_arrays`."""
    array = st.tuples(*map(st.sampled_from, (SHAPES, DTYPES, list(FILLS), list(LAYOUTS))))
    drawn = st.tuples(st.sampled_from(list(CALLS)), st.integers(0, 2**31), array, array, array)
    return drawn.map(lambda case: json.dumps(case).encode())


def call_with_arrays(path: Path) -> None:
    """Check that the call raises or returns finite numbers, and does not change its arrays."""
    name, seed, *described = json.loads(path.read_bytes())
    random = np.random.default_rng(seed)
    arrays = []
    for shape, dtype, fill, layout in described:
        with np.errstate(all="ignore"):
            array = np.asarray(FILLS[fill](random, tuple(shape)))
            array = array.astype("<i8").astype(dtype) if dtype.startswith("<M") else array.astype(dtype)
        arrays.append(LAYOUTS[layout](array))
    before = repr([np.array(array).tolist() for array in arrays])
    with np.errstate(all="ignore"):
        result = CALLS[name](*arrays)
    assert np.isfinite(np.asarray(result, np.float64)).all(), name
    assert repr([np.array(array).tolist() for array in arrays]) == before, "an argument was changed"


def kernel_input() -> st.SearchStrategy[bytes]:
    """Draw the sizes, the seed and the scale of the arrays for `run_kernels`."""
    numbers = {
        "vertices": st.integers(1, 70),
        "dimension": st.integers(1, 40),
        "handles": st.integers(0, 9),
        "fixed": st.integers(0, 4),
        "threads": st.sampled_from([1, 1, 3]),
        "seed": st.integers(0, 2**31),
        "exponent": st.integers(-30, 30),
        "locality": st.sampled_from([0.0, 0.5, 3.0, 1e30]),
    }
    return st.fixed_dictionaries(numbers).map(lambda drawn: json.dumps(drawn).encode())


def run_kernels(path: Path) -> None:
    """Check that bind and pose agree with their references, keep their bounds, and do not change their inputs."""
    case = json.loads(path.read_bytes())
    random = np.random.default_rng(case["seed"])
    count, handle_count = case["vertices"], min(case["handles"], case["vertices"])
    features = random.standard_normal((count, case["dimension"])).astype(np.float32)
    features /= np.maximum(np.linalg.norm(features, axis=1, keepdims=True), 1e-6)
    handles = random.permutation(count)[:handle_count]
    fixed = random.permutation(count)[: min(case["fixed"], count)]
    geodesic = random.uniform(0, 1, (handle_count, count)).astype(np.float32)
    options = {"fixed": fixed, "geodesic": geodesic, "locality": case["locality"]}
    before = [array.copy() for array in (features, handles, fixed, geodesic)]
    dfd.set_num_threads(case["threads"])
    weights = dfd.bind(features, handles, **options)
    assert weights.shape == (count, handle_count)
    assert ((weights >= 0) & (weights <= 1)).all()
    np.testing.assert_allclose(weights, reference.bind(features, handles, **options), atol=2e-3)
    vertices = random.standard_normal((count, 3)) * 10.0 ** case["exponent"]
    transforms = np.tile(np.eye(3, 4), (handle_count, 1, 1)) + random.standard_normal((handle_count, 3, 4)) * 0.3
    transforms[:, :, 3] *= 10.0 ** case["exponent"]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        posed = dfd.pose(vertices, weights, transforms)
    size = float(np.abs(vertices).max()) + float(np.abs(transforms[:, :, 3]).max(initial=0))
    np.testing.assert_allclose(
        posed, reference.pose(vertices, weights, transforms), atol=1e-5 * size * (1 + handle_count)
    )
    for array, copy in zip((features, handles, fixed, geodesic), before, strict=True):
        np.testing.assert_array_equal(array, copy)
