"""Test that copies with fewer faces have the same shape and colors."""

import numpy as np
import pytest

import dfd
from dfd import Mesh
from dfd.geometry.simplify import simplify
from dfd.mesh.appearance import Appearance, Material


@pytest.fixture(scope="module")
def quadruped():
    return dfd.samples.quadruped(faces=6000).mesh


def sphere(count=60):
    """Return a unit sphere."""
    theta = np.linspace(0, np.pi, count)
    phi = np.linspace(0, 2 * np.pi, count, endpoint=False)
    ring = np.stack(np.meshgrid(theta, phi, indexing="ij"), -1).reshape(-1, 2)
    vertices = np.stack(
        [np.sin(ring[:, 0]) * np.cos(ring[:, 1]), np.cos(ring[:, 0]), np.sin(ring[:, 0]) * np.sin(ring[:, 1])], 1
    )
    row, column = (part.ravel() for part in np.meshgrid(np.arange(count - 1), np.arange(count), indexing="ij"))
    a, b = row * count + column, row * count + (column + 1) % count
    faces = np.concatenate([np.stack([a, b, a + count], 1), np.stack([b, b + count, a + count], 1)]).astype(np.int32)
    return Mesh(vertices, faces)


def test_the_count_is_kept_and_the_shape_stays(quadruped):
    coarse = simplify(quadruped, 1500)
    assert 0.9 * 1500 <= len(coarse.faces) <= 1500
    assert coarse.bounds == pytest.approx(quadruped.bounds, abs=0.01 * quadruped.diagonal)
    assert coarse.appearance is None
    assert simplify(coarse, len(coarse.faces)) is coarse


@pytest.mark.parametrize(("offset", "scale"), [(1e6, 1.0), (0.0, 1e-12), (0.0, 1e12), (-1e9, 1e3)])
def test_place_and_size_do_not_matter(quadruped, offset, scale):
    plain = simplify(quadruped, 1500)
    moved = simplify(Mesh(quadruped.vertices * scale + offset, quadruped.faces), 1500)
    assert len(moved.faces) == len(plain.faces)
    assert (moved.bounds - offset) / scale == pytest.approx(plain.bounds, abs=1e-4)


def test_textured_colors_are_looked_up():
    plain = sphere()
    texture = np.zeros((2, 2, 4), np.uint8)
    texture[..., 3] = 255
    texture[:, 0, 0] = texture[:, 1, 2] = 255  # red to the left, blue to the right
    appearance = Appearance(
        corners=np.arange(len(plain.vertices), dtype=np.int32),
        corner_faces=plain.faces,
        face_material=np.zeros(len(plain.faces), np.int32),
        materials=(Material((1.0, 1.0, 1.0, 1.0), texture=texture, wrap=("clamp", "clamp")),),
        uv=np.where(plain.vertices[:, [0, 0]] > 0, 0.1, 0.9).astype(np.float32),
    )
    coarse = simplify(Mesh(plain.vertices, plain.faces, appearance=appearance), 800)
    used = np.unique(coarse.faces)
    used = used[np.abs(coarse.vertices[used, 0]) > 0.2]
    red = coarse.appearance.colors[used, 0] > 0.9
    assert np.array_equal(red, coarse.vertices[used, 0] > 0)


def test_faces_without_area_do_not_stand_in_the_way(quadruped):
    # Each first edge is also a face without area. The simplifier must not reject collapses beside these faces.
    slivers = quadruped.faces[:, [0, 1, 1]]
    coarse = simplify(Mesh(quadruped.vertices, np.concatenate([slivers, quadruped.faces])), 1500)
    assert len(coarse.faces) <= 1500
    assert coarse.bounds == pytest.approx(quadruped.bounds, abs=0.01 * quadruped.diagonal)


@pytest.mark.parametrize("seed", range(6))
def test_soups_are_survived(seed):
    rng = np.random.default_rng(seed)
    count = int(rng.integers(3, 60))
    vertices = np.round(rng.normal(size=(count, 3)), seed % 3)
    mesh = Mesh(vertices, rng.integers(0, count, (4 * count, 3)))
    coarse = simplify(mesh, 4)
    assert np.isfinite(coarse.vertices).all()
    assert 1 <= len(coarse.faces) <= len(mesh.faces)


def test_a_mesh_without_area_comes_back_as_it_is():
    line = Mesh(np.outer(np.arange(6.0), [1, 2, 3]), [[0, 1, 2], [1, 2, 3], [2, 3, 4], [3, 4, 5], [0, 0, 1]])
    assert simplify(line, 4) is line


def test_equal_calls_give_equal_bytes_and_inputs_stay(quadruped):
    vertices, faces = quadruped.vertices.tobytes(), quadruped.faces.tobytes()
    first, second = simplify(quadruped, 1000), simplify(quadruped, 1000)
    assert first.content_hash == second.content_hash
    assert (quadruped.vertices.tobytes(), quadruped.faces.tobytes()) == (vertices, faces)


@pytest.mark.parametrize("count", [3, 0, -5, 1e3, True, None])
def test_bad_counts_are_refused(quadruped, count):
    with pytest.raises(ValueError, match="simplify: `face_count` must be a whole number"):
        simplify(quadruped, count)
