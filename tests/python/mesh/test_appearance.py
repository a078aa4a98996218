"""Tests of surface colors from textures, vertex colors and materials, and of unreadable textures."""

import io

import numpy as np
import pytest
import trimesh
from mesh_files import CORNERS, CUBE, Gltf, checkered, look_of, obj_cube, painted_cube, textured_quad, write
from PIL import Image

from dfd.mesh.appearance import GRAY, Appearance, Material
from dfd.mesh.colors import srgb
from dfd.mesh.mesh import load

RED, GREEN, BLUE, WHITE = (1, 0, 0, 1), (0, 1, 0, 1), (0, 0, 1, 1), (1, 1, 1, 1)


def albedo(mesh, faces, barycentric):
    found = look_of(mesh).albedo(faces, barycentric)
    assert found.dtype == np.float32
    assert found.shape == (len(faces), 4)
    return found


def at(mesh, points):
    """Return the colors (N, 4) of `points` (x, y) of the textured unit square."""
    faces = np.array([0 if x >= y else 1 for x, y in points])
    weights = [(1 - x, x - y, y) if x >= y else (1 - y, x, y - x) for x, y in points]
    return albedo(mesh, faces, np.array(weights))


def square(texture=None, uv=None, **options):
    corners = np.arange(4, dtype=np.int32)
    return Appearance(
        corners=corners,
        corner_faces=np.array([(0, 1, 2), (0, 2, 3)], np.int32),
        face_material=np.zeros(2, np.int32),
        materials=(Material(color=WHITE, texture=texture, **options),),
        uv=np.array([(0, 0), (1, 0), (1, 1), (0, 1)] if uv is None else uv, np.float32),
    )


@pytest.mark.parametrize("kind", ["glb", "webp", "obj"])
def test_a_texture_lies_the_right_way_up(kind, tmp_path):
    gltf = textured_quad(tmp_path)
    path = tmp_path / "quad.glb"
    if kind == "webp":
        stream = io.BytesIO()
        Image.open(checkered(tmp_path / "paint.png", 16)).save(stream, "WEBP", lossless=True)
        gltf.header["images"] = [{"bufferView": gltf.view(stream.getvalue()), "mimeType": "image/webp"}]
        gltf.header["textures"] = [{"extensions": {"EXT_texture_webp": {"source": 0}}}]
    if kind == "obj":
        path = tmp_path / "quad.obj"
        write(tmp_path / "quad.mtl", "newmtl paint\nKd 0.1 0.1 0.1\nmap_Kd paint.png\n")
        lines = ["mtllib quad.mtl", "v 0 0 0", "v 1 0 0", "v 1 1 0", "v 0 1 0", "vt 0 0", "vt 1 0", "vt 1 1", "vt 0 1"]
        write(path, "\n".join([*lines, "usemtl paint", "f 1/1 2/2 3/3", "f 1/1 3/3 4/4"]))
    else:
        write(path, gltf.glb())
    found = at(load(path), [(0.125, 0.875), (0.875, 0.875), (0.125, 0.125), (0.875, 0.125)])
    assert np.allclose(found, [RED, GREEN, BLUE, WHITE])


def test_texels_are_interpolated_between_their_centers():
    texture = np.zeros((1, 2, 4), np.uint8)
    texture[0, 1] = 255
    look = square(texture, wrap=("clamp", "clamp"))
    for u, value in [(0.0, 0.0), (0.25, 0.0), (0.375, 0.25), (0.5, 0.5), (0.75, 1.0), (1.0, 1.0)]:
        assert look.albedo(np.array([0]), np.array([(1 - u, u, 0.0)]))[0, 0] == pytest.approx(value, abs=1e-6)


@pytest.mark.parametrize(
    ("wrap", "expected"),
    [("repeat", [1, 0, 1, 0, 1, 0]), ("mirror", [0, 0, 1, 1, 0, 0]), ("clamp", [0, 0, 1, 1, 1, 1])],
)
def test_wrap_modes_outside_the_texture(wrap, expected):
    texture = np.zeros((1, 2, 4), np.uint8)
    texture[0, 1] = 255
    look = square(texture, uv=[(-0.5, 0), (2.5, 0), (2.5, 1), (-0.5, 1)], wrap=(wrap, wrap))
    u = np.array([-0.25, 0.25, 0.75, 1.25, 1.75, 2.25])
    share = (u + 0.5) / 3
    found = look.albedo(np.zeros(6, int), np.stack([1 - share, share, 0 * share], axis=1))
    assert np.allclose(found[:, 0], expected, atol=1e-5)


def test_factor_texture_and_vertex_colors_multiply(tmp_path):
    half = 0.5
    gltf = textured_quad(tmp_path, COLOR_0=(np.tile((0.25, 1.0, 1.0, 1.0), (4, 1)), 5126, "VEC4"))
    gltf.header["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = [1, half, 1, 1]
    mesh = load(write(tmp_path / "quad.glb", gltf.glb()))
    found = at(mesh, [(0.875, 0.125)])[0]
    expected = [srgb(np.array([0.25]))[0], srgb(np.array([half]))[0], 1, 1]
    assert np.allclose(found, expected, atol=0.005)


@pytest.mark.parametrize(
    ("mode", "expected"), [(None, [1, 1]), ("OPAQUE", [1, 1]), ("MASK", [0, 1]), ("BLEND", [0.25, 1])]
)
def test_transparency(mode, expected, tmp_path):
    colors = np.array([(1, 1, 1, 0.25), (1, 1, 1, 1), (1, 1, 1, 1), (1, 1, 1, 0.25)])
    gltf = textured_quad(tmp_path, COLOR_0=(colors, 5126, "VEC4"))
    if mode:
        gltf.header["materials"][0]["alphaMode"] = mode
    mesh = load(write(tmp_path / "quad.glb", gltf.glb()))
    assert np.allclose(at(mesh, [(0.0, 0.0), (1.0, 1.0)])[:, 3], expected, atol=0.01)


def test_vertex_and_face_colors_of_ply(tmp_path):
    cube = trimesh.Trimesh(CORNERS, CUBE, process=False)
    cube.visual.vertex_colors = np.tile([(255, 0, 0, 255), (0, 0, 255, 255)], (4, 1))
    cube.export(tmp_path / "vertices.ply")
    corner = albedo(load(tmp_path / "vertices.ply"), np.array([0, 0]), np.array([(1, 0, 0), (0.5, 0.5, 0)]))
    assert np.allclose(corner, [RED, (0.5, 0, 0.5, 1)], atol=0.005)
    cube = trimesh.Trimesh(CORNERS, CUBE, process=False)
    cube.visual.face_colors = np.tile([(255, 0, 0, 255), (0, 255, 0, 255)], (6, 1))
    cube.export(tmp_path / "faces.ply")
    mesh = load(tmp_path / "faces.ply")
    assert len(mesh.vertices) == 8
    found = albedo(mesh, np.arange(4), np.tile((0.2, 0.3, 0.5), (4, 1)))
    assert np.allclose(found, [RED, GREEN, RED, GREEN])


def test_a_mesh_without_materials_has_no_colors_and_a_part_without_is_gray(tmp_path):
    assert load(write(tmp_path / "cube.obj", obj_cube())).appearance is None
    gltf = textured_quad(tmp_path)
    gltf.node(name="cube", mesh=gltf.mesh("cube", CORNERS + 2, CUBE))
    mesh = load(write(tmp_path / "both.glb", gltf.glb()))
    found = albedo(mesh, np.arange(2, 14), np.full((12, 3), 1 / 3))
    assert np.allclose(found, [(GRAY, GRAY, GRAY, 1)] * 12)


@pytest.mark.parametrize("damage", ["absent", "text", "cut"])
def test_an_unreadable_texture_gives_gray_and_one_warning(damage, tmp_path):
    path = painted_cube(tmp_path)
    if damage == "absent":
        (tmp_path / "paint.png").unlink()
    elif damage == "text":
        write(tmp_path / "paint.png", "no picture")
    else:
        write(tmp_path / "paint.png", (tmp_path / "paint.png").read_bytes()[:90])
    with pytest.warns(UserWarning, match=r"names .*paint.png.*, which could not be read") as caught:
        mesh = load(path)
    assert len(caught) == 1
    assert caught[0].filename == __file__
    if mesh.appearance is not None:
        found = albedo(mesh, np.arange(12), np.full((12, 3), 1 / 3))
        assert np.allclose(found, (GRAY, GRAY, GRAY, 1))


def test_the_content_hash_depends_on_all_colors(tmp_path):
    gltf = textured_quad(tmp_path)
    hashes = {load(write(tmp_path / "a.glb", gltf.glb())).content_hash}
    gltf.header["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = [1, 0.5, 1, 1]
    hashes.add(load(write(tmp_path / "b.glb", gltf.glb())).content_hash)
    gltf.header["samplers"], gltf.header["textures"][0]["sampler"] = [{"wrapS": 33071}], 0
    hashes.add(load(write(tmp_path / "c.glb", gltf.glb())).content_hash)
    hashes.add(load(write(tmp_path / "again.glb", gltf.glb())).content_hash)
    assert len(hashes) == 3


def picture(mode):
    values = np.full((4, 4), 20000, np.uint16)
    image = {
        "I;16": Image.fromarray(values),
        "I": Image.fromarray(values.astype(np.int32)),
        "F": Image.fromarray((values / 65535).astype(np.float32)),
    }[mode]
    stream = io.BytesIO()
    image.save(stream, "PNG" if mode == "I;16" else "TIFF")
    return stream.getvalue()


@pytest.mark.parametrize("mode", ["I;16", "I", "F"])
def test_gray_pictures_of_many_bits_keep_their_gray(mode, tmp_path):
    write(tmp_path / "gray.png", picture(mode))
    write(tmp_path / "a.mtl", "newmtl m\nmap_Kd gray.png\n")
    text = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl m\nf 1/1 2/1 3/1\n"
    assert np.allclose(load(write(tmp_path / "a.obj", text)).vertex_colors()[0, :3], 0.305, atol=0.003)


def test_a_black_surface_that_emits_light_shows_it(tmp_path):
    gltf = Gltf()
    gltf.node(mesh=gltf.mesh("cube", CORNERS, CUBE, material=0))
    gltf.header["materials"] = [
        {"pbrMetallicRoughness": {"baseColorFactor": [0, 0, 0, 1]}, "emissiveFactor": [1, 0, 0]}
    ]
    assert look_of(write(tmp_path / "a.glb", gltf.glb())).materials[0].color == (1, 0, 0, 1)
    write(tmp_path / "a.mtl", "newmtl m\nKd 0 0 0\nKe 0 1 0\n")
    mesh = load(write(tmp_path / "a.obj", "mtllib a.mtl\nusemtl m\n" + obj_cube()))
    assert look_of(mesh).materials[0].color == (0, 1, 0, 1)
