"""What pictures are made with, against its slow twins; and what it refuses."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from dfd import _core, reference
from dfd.mesh.appearance import blend
from dfd.mesh.normals import smooth_normals


def met(seed: int, count: int, vertex_count: int = 40) -> dict[str, NDArray[Any]]:
    """Points where rays meet triangles, some of them without area and some where normals cancel out."""
    generator = np.random.default_rng(seed)
    vertices = generator.normal(size=(vertex_count, 3)).astype(np.float32)
    normals = generator.normal(size=(vertex_count, 3)).astype(np.float32)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals[1] = -normals[0]
    corners = generator.integers(0, vertex_count, (count, 3)).astype(np.int32)
    barycentric = generator.dirichlet(np.ones(3), count).astype(np.float32)
    if count > 2:
        corners[0], barycentric[0] = (0, 1, 2), (0.5, 0.5, 0.0)  # cancelled: the face's own
        corners[1], barycentric[1] = (0, 1, 1), (0.5, 0.25, 0.25)  # cancelled, and without area
    directions = generator.normal(size=(2 * count + 1, 3)).astype(np.float32)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    rays = np.sort(generator.permutation(2 * count + 1)[:count])
    return {
        "vertices": vertices,
        "normals": normals,
        "corners": corners,
        "barycentric": barycentric,
        "rays": rays,
        "directions": directions,
    }


def facing(given: dict[str, NDArray[Any]]) -> NDArray[np.float32]:
    out = np.empty((len(given["corners"]), 1), np.float32)
    _core.facing(**given, out=out)
    return out[:, 0]


@settings(deadline=None, max_examples=30)
@given(seed=st.integers(0, 10_000), count=st.sampled_from([0, 1, 3, 200]))
def test_light_is_that_of_the_twin_and_nothing_given_changes(seed: int, count: int) -> None:
    hits = met(seed, count)
    before = {name: values.copy() for name, values in hits.items()}
    found = facing(hits)
    # Blends that are hardly longer or shorter than 0.2 are taken either way.
    length = np.linalg.norm(reference.blend(hits["normals"], hits["corners"], hits["barycentric"]), axis=1)
    clear = np.abs(length - 0.2) > 1e-5
    rays = {name: hits[name] for name in ("vertices", "normals", "corners", "barycentric")}
    exact = reference.facing(**rays, directions=hits["directions"][hits["rays"]])
    np.testing.assert_allclose(found[clear], exact[clear], atol=3e-6)
    if count > 2:
        assert found[1] == 0
    for name, values in hits.items():
        np.testing.assert_array_equal(values, before[name])


@settings(deadline=None, max_examples=30)
@given(seed=st.integers(0, 10_000), count=st.sampled_from([0, 1, 100]), columns=st.sampled_from([1, 2, 3, 4]))
def test_blends_are_those_of_the_twin(seed: int, count: int, columns: int) -> None:
    generator = np.random.default_rng(seed)
    values = generator.normal(size=(7, columns)).astype(np.float32)
    rows = generator.integers(0, 7, (count, 3)).astype(np.int32)
    weights = generator.dirichlet(np.ones(3), count).astype(np.float32)
    np.testing.assert_allclose(blend(values, rows, weights), reference.blend(values, rows, weights), atol=1e-6)
    whole = np.tile(np.eye(3, dtype=np.float32)[1], (count, 1))
    np.testing.assert_array_equal(blend(values, rows, whole), values[rows[:, 1]])  # at a corner, its own value


def test_colors_are_painted_as_the_twin_has_it() -> None:
    generator = np.random.default_rng(0)
    colors = np.concatenate([generator.random((50, 4)), np.zeros((1, 4)), np.ones((1, 4))]).astype(np.float32)
    pixels = np.sort(generator.permutation(80)[:52])
    image = np.full((80, 3), 255, np.uint8)
    _core.paint(colors, pixels, image)
    np.testing.assert_array_equal(image, reference.paint(colors, pixels, 80))


def test_colors_that_are_none_stay_within_a_byte() -> None:
    colors = np.array([[np.nan, np.inf, -np.inf, 1], [-3, 7, 1.002, 1]], np.float32)
    image = np.full((2, 3), 9, np.uint8)
    _core.paint(colors, np.arange(2), image)
    assert image.tolist() == [[0, 255, 0], [0, 255, 255]]


def test_one_triangle_faces_the_eye_as_its_plane_does() -> None:
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
    faces = np.array([[0, 1, 2]], np.int32)
    light = np.empty((1, 1), np.float32)
    for direction, expected in (((0, 0, -1), 1.0), ((0, 0, 1), 1.0), ((1, 0, 0), 0.0), ((0.6, 0, 0.8), 0.8)):
        _core.facing(
            vertices,
            smooth_normals(vertices.astype(np.float64), faces),
            faces,
            np.full((1, 3), 1 / 3, np.float32),
            np.zeros(1, np.int64),
            np.array([direction], np.float32),
            light,
        )
        assert light[0, 0] == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("vertices", np.zeros((40, 2), np.float32), "facing: `vertices` must have shape (V, 3)"),
        ("normals", np.zeros((39, 3), np.float32), "facing: `normals` must have shape (V, 3)"),
        ("corners", np.full((5, 3), 40, np.int32), "facing: `corners` must be (N, 3) vertex indices"),
        ("corners", np.full((5, 3), -1, np.int32), "facing: `corners` must be (N, 3) vertex indices"),
        ("barycentric", np.zeros((4, 3), np.float32), "facing: `barycentric` must have shape (N, 3)"),
        ("rays", np.zeros(4, np.int64), "facing: `rays` must have shape (N,)"),
        ("rays", np.full(5, 11), "facing: `rays` must be rows of `directions`"),
        ("rays", np.full(5, -1), "facing: `rays` must be rows of `directions`"),
        ("directions", np.zeros((11, 2), np.float32), "facing: `directions` must have a row of 3 for each ray"),
    ],
)
def test_hits_that_cannot_be_are_refused(name: str, value: NDArray[Any], message: str) -> None:
    with pytest.raises(ValueError) as error:  # noqa: PT011  # the whole message is compared
        facing({**met(0, 5), name: value})
    assert str(error.value) == message


@pytest.mark.parametrize(
    ("shapes", "message"),
    [
        (((5, 2), (4, 2), (4, 3), (4, 2)), "blend: `rows` must be (N, 3) rows of `values`"),
        (((5, 2), (4, 3), (3, 3), (4, 2)), "blend: `weights` must have shape (N, 3)"),
        (((5, 2), (4, 3), (4, 3), (4, 3)), "blend: `out` must have shape (N, K)"),
        (((0, 2), (4, 3), (4, 3), (4, 2)), "blend: `rows` must be (N, 3) rows of `values`"),
    ],
)
def test_blends_that_cannot_be_are_refused(shapes: tuple[tuple[int, int], ...], message: str) -> None:
    values, rows, weights, out = shapes
    with pytest.raises(ValueError) as error:  # noqa: PT011  # the whole message is compared
        _core.blend(
            np.zeros(values, np.float32),
            np.zeros(rows, np.int32),
            np.zeros(weights, np.float32),
            np.empty(out, np.float32),
        )
    assert str(error.value) == message


@pytest.mark.parametrize(
    ("colors", "pixels", "image", "message"),
    [
        ((3, 3), [0, 1, 2], (4, 3), "paint: `colors` must have shape (N, 4)"),
        ((2, 4), [0, 1, 2], (4, 3), "paint: `colors` must have shape (N, 4)"),
        ((3, 4), [0, 1, 2], (4, 4), "paint: `image` must have shape (pixels, 3)"),
        ((3, 4), [0, 1, 4], (4, 3), "paint: `pixels` must be rows of `image`"),
        ((3, 4), [0, -1, 2], (4, 3), "paint: `pixels` must be rows of `image`"),
    ],
)
def test_paint_that_goes_nowhere_is_refused(
    colors: tuple[int, int], pixels: list[int], image: tuple[int, int], message: str
) -> None:
    with pytest.raises(ValueError) as error:  # noqa: PT011  # the whole message is compared
        _core.paint(np.zeros(colors, np.float32), np.array(pixels), np.zeros(image, np.uint8))
    assert str(error.value) == message
