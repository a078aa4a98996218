"""glTF files that are compressed, quantized or sparse: read as what they stand for, saved so that others read them."""

import importlib.util
import re

import numpy as np
import pytest
from compressed_files import DRACO, MESHOPT, draco_cube, meshopt_cube, packed_glb
from mesh_files import CORNERS, CUBE, Gltf, header_and_data, look_of, same_shape, textured_quad, write

from dfd.common.distribution import pip_install
from dfd.mesh.mesh import Mesh, load

needs_draco = pytest.mark.skipif(importlib.util.find_spec("DracoPy") is None, reason="needs DracoPy")
needs_meshopt = pytest.mark.skipif(importlib.util.find_spec("meshopt") is None, reason="needs meshopt")


def without(monkeypatch, package):
    original = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name, *more: None if name == package else original(name, *more)
    )


@pytest.mark.parametrize("normalized", [False, True])
def test_quantized_positions_are_read_and_moved(normalized, tmp_path):
    gltf = Gltf()
    scale = 32767 if normalized else 1
    view = gltf.view(np.pad(CORNERS * scale, ((0, 0), (0, 1))).astype("<i2").tobytes())
    gltf.header["bufferViews"][view]["byteStride"] = 8
    gltf.header["accessors"].append(
        {"bufferView": view, "componentType": 5122, "count": 8, "type": "VEC3", "normalized": normalized}
    )
    gltf.header |= {name: ["KHR_mesh_quantization"] for name in ("extensionsUsed", "extensionsRequired")}
    gltf.node(mesh=gltf.mesh("cube", CORNERS, CUBE), scale=[2, 2, 2], translation=[5, 0, 0])
    gltf.header["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = 0
    mesh = load(write(tmp_path / "quantized.glb", gltf.glb()))
    assert same_shape(mesh, Mesh(CORNERS * 2 + [5, 0, 0], CUBE))
    moved = mesh.vertices * [1, 2, 3] + 0.123
    mesh.save(tmp_path / "moved.glb", moved)
    assert same_shape(load(tmp_path / "moved.glb"), Mesh(moved, mesh.faces))


def test_sparse_positions_are_read_and_moved(tmp_path):
    gltf = Gltf()
    gltf.node(mesh=gltf.mesh("cube", CORNERS, CUBE))
    gltf.header["accessors"][0]["sparse"] = {
        "count": 2,
        "indices": {"bufferView": gltf.view(np.array([1, 7], "<u2").tobytes()), "componentType": 5123},
        "values": {"bufferView": gltf.view(np.array([(9, 9, 9), (8, 8, 8)], "<f4").tobytes())},
    }
    mesh = load(write(tmp_path / "sparse.glb", gltf.glb()))
    expected = CORNERS.copy()
    expected[[1, 7]] = [(9, 9, 9), (8, 8, 8)]
    assert same_shape(mesh, Mesh(expected, CUBE))
    mesh.save(tmp_path / "moved.glb", mesh.vertices + 1)
    assert same_shape(load(tmp_path / "moved.glb"), Mesh(expected + 1, CUBE))
    gltf.header["accessors"][0]["sparse"]["indices"]["bufferView"] = gltf.view(np.array([1, 8], "<u2").tobytes())
    with pytest.raises(ValueError, match="accessor 0 has the sparse index 8, but only 8 items"):
        load(write(tmp_path / "sparse.glb", gltf.glb()))


@pytest.mark.parametrize(("mode", "corners"), [(5, [0, 1, 2, 3]), (6, [0, 1, 3, 2])])
def test_strips_and_fans_are_triangles(mode, corners, tmp_path):
    gltf = Gltf()
    square = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)]
    gltf.node(mesh=gltf.mesh("square", square, corners, mode=mode))
    mesh = load(write(tmp_path / "square.glb", gltf.glb()))
    assert mesh.faces.shape == (2, 3)
    first, second, third = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    assert np.cross(second - first, third - first).tolist() == [[0, 0, 1], [0, 0, 1]]


def test_texture_coordinates_are_those_that_the_material_names(tmp_path):
    gltf = textured_quad(tmp_path)
    attributes = gltf.header["meshes"][0]["primitives"][0]["attributes"]
    attributes["TEXCOORD_1"] = attributes.pop("TEXCOORD_0")
    attributes["TEXCOORD_0"] = gltf.accessor(np.zeros((4, 2)), 5126, "VEC2")
    texture = gltf.header["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]
    texture["texCoord"] = 1
    faces, corner = np.array([0]), np.array([(0.75, 0.0, 0.25)])

    def color():
        look = look_of(write(tmp_path / "quad.glb", gltf.glb()))
        return look.albedo(faces, corner)[0].tolist()

    assert color() == pytest.approx([0, 0, 1, 1])  # the lower left
    texture["extensions"] = {"KHR_texture_transform": {"offset": [0.5, 0]}}
    assert color() == pytest.approx([1, 1, 1, 1])  # the lower right
    texture["extensions"] = {"KHR_texture_transform": {"scale": [1, -1]}}
    assert color() == pytest.approx([1, 0, 0, 1])  # the upper left
    # a quarter turn takes (u, v) to (v, −u), with v downwards: from (0.25, 0.75) to (0.75, −0.25)
    texture["extensions"] = {"KHR_texture_transform": {"rotation": np.pi / 2}}
    assert color() == pytest.approx([1, 1, 1, 1])


@needs_draco
def test_draco_is_read_and_saved_plain_where_it_moves(tmp_path):
    mesh = load(write(tmp_path / "draco.glb", draco_cube().glb()))
    assert mesh.vertices.shape == (8, 3)
    assert len(mesh.faces) == 12
    assert np.allclose(mesh.bounds, [(0, 0, 0), (1, 1, 1)], atol=1e-3)
    mesh.save(tmp_path / "same.glb")
    assert DRACO in header_and_data(tmp_path / "same.glb")[0]["extensionsRequired"]
    moved = mesh.vertices * [1, 2, 3]
    mesh.save(tmp_path / "moved.glb", moved)
    assert "extensionsRequired" not in header_and_data(tmp_path / "moved.glb")[0]
    assert same_shape(load(tmp_path / "moved.glb"), Mesh(moved, mesh.faces))


@pytest.mark.parametrize(("package", "extension"), [("DracoPy", DRACO), ("meshopt", MESHOPT)])
def test_compression_without_its_library_is_refused_by_name(package, extension, tmp_path, monkeypatch):
    without(monkeypatch, package)
    gltf = Gltf()
    gltf.header["extensionsRequired"] = [extension]
    gltf.node(mesh=gltf.mesh("cube", CORNERS, CUBE))
    with pytest.raises(
        ValueError, match=re.escape(f"compressed with {extension}, which needs `{pip_install('gltf')}`")
    ):
        load(write(tmp_path / "packed.glb", gltf.glb()))


@needs_meshopt
def test_meshopt_is_read_and_what_does_not_move_stays_compressed(tmp_path):
    gltf = meshopt_cube()
    mesh = load(write(tmp_path / "packed.glb", packed_glb(gltf)))
    turned = [np.roll(face, -int(np.argmin(face))) for face in mesh.faces]  # the codec may begin at another corner
    assert np.array_equal(turned, [np.roll(face, -int(np.argmin(face))) for face in CUBE])
    assert np.array_equal(mesh.vertices, CORNERS)
    mesh.save(tmp_path / "moved.glb", mesh.vertices * 3)
    header, _ = header_and_data(tmp_path / "moved.glb")
    assert MESHOPT in header["bufferViews"][1]["extensions"]
    assert header["buffers"][1]["extensions"] == {MESHOPT: {"fallback": True}}
    assert same_shape(load(tmp_path / "moved.glb"), Mesh(CORNERS * 3, mesh.faces))
