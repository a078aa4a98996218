"""Test light, colors and transparent surfaces."""

import numpy as np
import pytest

from dfd import Mesh
from dfd.mesh.appearance import GRAY, Appearance, Material, blend
from dfd.mesh.normals import smooth_normals
from dfd.views.cameras import camera_towards
from dfd.views.raycast import Scene
from dfd.views.shading import AMBIENT, DIFFUSE, Shading, facing

SQUARE = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
TWO = np.array([[0, 1, 2], [0, 2, 3]])


def squares(*layers):
    """Return parallel squares, each with its z and its material."""
    vertices = np.concatenate([SQUARE + [0, 0, z] for z, _ in layers])
    faces = np.concatenate([TWO + 4 * index for index in range(len(layers))]).astype(np.int32)
    appearance = Appearance(
        corners=np.arange(len(vertices), dtype=np.int32),
        corner_faces=faces,
        face_material=np.repeat(np.arange(len(layers), dtype=np.int32), 2),
        materials=tuple(material for _, material in layers),
        uv=np.tile(np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32), (len(layers), 1)),
    )
    return Mesh(vertices, faces, appearance=appearance)


def look(mesh, direction=(0, 0, 1), resolution=21, **options):
    vertices = mesh.vertices.astype(np.float32)
    camera = camera_towards(direction, vertices, **options)
    shading = Shading(Scene(vertices, mesh.faces), mesh, vertices)
    return (*shading.picture(camera, resolution), camera)


def lit(value, camera, resolution=21, row=10, column=10):
    """Return the expected pixel, from 0 to 255, of a surface that faces +z and has the gray `value` in [0, 1]."""
    direction = camera.ray_directions(resolution)[row * resolution + column]
    return value * (AMBIENT + DIFFUSE * abs(direction[2])) * 255


@pytest.mark.parametrize("side", [1, -1])
def test_light_is_at_the_eye_and_back_faces_are_lit_alike(side):
    image, hits, camera = look(Mesh(SQUARE, TWO), (0.3, 0.2, side), field_of_view=50)
    for index, ray in enumerate(hits.ray[:: len(hits.ray) // 10]):
        row, column = divmod(int(ray), 21)
        assert image[row, column] == pytest.approx(np.full(3, lit(GRAY, camera, 21, row, column)), abs=0.51), index
    missed = np.ones(21 * 21, bool)
    missed[hits.ray] = False
    assert missed.any()
    assert (image.reshape(-1, 3)[missed] == 255).all()


def test_normals_are_smooth_over_a_sphere():
    import trimesh

    ball = trimesh.creation.icosphere(3)
    vertices = np.asarray(ball.vertices)
    camera = camera_towards((1, 2, 3), vertices)
    hits = Scene(vertices, ball.faces).cast(camera.position, directions := camera.ray_directions(40))
    faces = np.asarray(ball.faces, np.int32)
    found = facing(vertices.astype(np.float32), faces, smooth_normals(vertices, faces), hits, directions)
    points = blend(vertices.astype(np.float32), faces[hits.face], hits.barycentric)
    exact = np.abs(np.einsum("kc,kc->k", points / np.linalg.norm(points, axis=1)[:, None], directions[hits.ray]))
    assert np.abs(found - exact).max() < 0.02


@pytest.mark.parametrize("scale", [1e-200, 1e-30, 1.0, 1e200])
def test_normals_do_not_depend_on_size(scale):
    assert smooth_normals(SQUARE * scale, TWO.astype(np.int32)) == pytest.approx(np.tile([0, 0, 1.0], (4, 1)))
    assert (smooth_normals(np.zeros((3, 3)), np.array([[0, 1, 2]], np.int32)) == 0).all()


def test_a_sheet_with_faces_on_both_sides_is_lit_by_its_own_normal():
    mesh = Mesh(SQUARE, np.concatenate([TWO, TWO[:, ::-1]]))
    assert (mesh.normals == 0).all()
    image, _, camera = look(mesh, (0, 0.5, 1))
    plain, _, _ = look(Mesh(SQUARE, TWO), (0, 0.5, 1))
    assert np.abs(image.astype(int) - plain).max() <= 1
    assert image[10, 10, 0] == pytest.approx(lit(GRAY, camera), abs=0.51)


def test_holes_of_a_masked_texture_show_what_lies_behind():
    texture = np.full((2, 2, 4), 255, np.uint8)
    texture[:, 0, 3] = 0  # the left half is transparent
    front = Material((0.5, 0.5, 0.5, 1.0), texture=texture, wrap=("clamp", "clamp"), alpha_mode="MASK")
    behind = Material((0.9, 0.1, 0.1, 1.0))
    image, hits, _ = look(squares((0.5, front), (-0.5, behind)), field_of_view=20)
    at = {int(ray): int(face) for ray, face in zip(hits.ray, hits.face, strict=True)}
    left, right = 10 * 21 + 6, 10 * 21 + 14
    assert at[left] in (2, 3)
    assert image[10, 6, 0] > 2 * image[10, 6, 1]
    assert at[right] in (0, 1)
    assert len(set(image[10, 14].tolist())) == 1
    assert (np.diff(hits.ray) > 0).all()
    alone, hits, _ = look(squares((0.5, front)), field_of_view=20)
    assert left not in hits.ray
    assert (alone[10, 6] == 255).all()
    # From behind, the opaque square hides the masked one.
    _, hits, _ = look(squares((0.5, front), (-0.5, behind)), (0, 0, -1))
    assert set(hits.face.tolist()) <= {2, 3}


def test_glass_tints_what_lies_behind_and_is_not_the_surface():
    glass = Material((0.0, 0.0, 1.0, 0.25), alpha_mode="BLEND")
    wall = Material((0.8, 0.4, 0.0, 1.0))
    image, hits, camera = look(squares((0.5, glass), (-0.5, wall)))
    share = lit(1, camera) / 255
    expected = 0.25 * np.array([0, 0, 1]) + 0.75 * np.array([0.8, 0.4, 0])
    assert image[10, 10] == pytest.approx(expected * share * 255, abs=0.6)
    assert dict(zip(hits.ray.tolist(), hits.face.tolist(), strict=True))[10 * 21 + 10] in (2, 3)
    # Without the opaque square, the glass tints the white background, and no ray has a hit.
    image, hits, _ = look(squares((0.5, glass)))
    assert len(hits.ray) == 0
    assert image[10, 10] == pytest.approx([0.75 * 255, 0.75 * 255, (0.25 * share + 0.75) * 255], abs=0.6)


def test_colors_come_through_blended():
    colors = np.array([[1, 0, 0, 1], [0, 1, 0, 1], [0, 0, 1, 1], [1, 1, 1, 1]], np.float32)
    appearance = Appearance(
        corners=np.arange(4, dtype=np.int32),
        corner_faces=TWO.astype(np.int32),
        face_material=np.zeros(2, np.int32),
        materials=(Material((1.0, 1.0, 1.0, 1.0)),),
        colors=colors,
    )
    image, hits, camera = look(Mesh(SQUARE, TWO, appearance=appearance))
    for ray, face, weights in list(zip(hits.ray, hits.face, hits.barycentric, strict=True))[::37]:
        row, column = divmod(int(ray), 21)
        expected = weights @ colors[TWO[face], :3] * lit(1, camera, 21, row, column)
        assert image[row, column] == pytest.approx(expected, abs=0.6)
