"""Messages about files and values that cannot be used: one line that says what they are, and what to do."""

import gzip
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from made_field import field_of
from mesh_files import CORNERS, CUBE, Gltf, obj_cube, write

import dfd
from dfd.common import check
from dfd.mesh.mesh import Mesh, load


def message(path):
    with pytest.raises(ValueError, match=r"^load: `path` ") as caught:
        load(path)
    text = str(caught.value)
    assert "\n" not in text
    assert "Error" not in text
    return text


def cube():
    gltf = Gltf()
    gltf.node(mesh=gltf.mesh("cube", CORNERS, CUBE))
    return gltf


@pytest.mark.parametrize("asset", [{"version": "1.0"}, {}])
def test_gltf_1(asset, tmp_path):
    header = {"asset": asset, "meshes": {"m": {"primitives": []}}, "nodes": {"n": {"meshes": ["m"]}}, "scene": "s"}
    found = message(write(tmp_path / "a.gltf", json.dumps(header)))
    assert "it has version '1.0' of the format, and only 2 can be read" in found
    assert "export glTF 2.0" in found


def test_a_glb_of_version_1(tmp_path):
    data = bytearray(cube().glb())
    data[4] = 1
    assert "it has version 1 of the format" in message(write(tmp_path / "a.glb", bytes(data)))


def test_a_scene_without_the_mesh(tmp_path):
    gltf = cube()
    gltf.header["scenes"] = [{"nodes": [1]}, {"nodes": [0]}]
    gltf.header["nodes"].append({"name": "empty"})
    found = message(write(tmp_path / "a.glb", gltf.glb()))
    assert "holds 1 mesh, but its scene shows none: no visible node of the scene has a mesh" in found


@pytest.mark.parametrize("ending", ["obj", "ply", "off", "glb"])
def test_points_only(ending, tmp_path):
    rows = [f"{x:g} {y:g} {z:g}" for x, y, z in CORNERS.tolist()]
    head = "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\nend_header"
    gltf = Gltf()
    gltf.node(mesh=gltf.mesh("points", CORNERS, range(8), mode=0))
    content: dict[str, Any] = {
        "obj": "\n".join(f"v {row}" for row in rows),
        "ply": "\n".join([head, *rows, ""]),
        "off": "\n".join(["OFF", "8 0 0", *rows, ""]),
        "glb": gltf.glb(),
    }
    found = message(write(tmp_path / f"a.{ending}", content[ending]))
    assert "holds no faces, only 8 points, as scans and splats do: `dfd.bind` and `dfd.pose` move points" in found


def test_a_gltf_file_without_its_buffer(tmp_path):
    gltf = cube()
    gltf.header["buffers"] = [{"byteLength": len(gltf.data), "uri": "scene.bin"}]
    found = message(write(tmp_path / "a.gltf", json.dumps(gltf.header)))
    assert "names 'scene.bin', which does not exist: put it beside the file" in found


@pytest.mark.parametrize("address", ["https://a.org/b.obj", Path("https://a.org/b.obj"), "s3://a/b.glb"])
def test_an_address(address):
    with pytest.raises(ValueError, match=r"load: `path` is an address, got .*: download the file, and give its path"):
        load(address)


def test_a_stream(tmp_path):
    with pytest.raises(
        ValueError, match=r"Mesh.save: `path` must be a path, got BytesIO: save to a file, and read its"
    ):
        Mesh(CORNERS, CUBE).save(io.BytesIO())
    with pytest.raises(ValueError, match=r"load: `source` must be a path, .* got BytesIO: write its bytes to a file"):
        load(io.BytesIO())
    session = dfd.Deformer(mesh := Mesh(CORNERS, CUBE), field_of(mesh, 1), preset="paper")
    session.add(0, translation=(0, 0, 1))
    for export in (dfd.export_rig, dfd.export_weights):
        with pytest.raises(ValueError, match="`path` must be a path, got BytesIO: save to a file"):
            export(session, io.BytesIO())


def test_a_list_of_vertices_for_one_handle():
    mesh = Mesh(CORNERS, CUBE)
    session = dfd.Deformer(mesh, field_of(mesh, 1), preset="paper")
    for given in ([0, 1], [0, 1, 2, 3], (4, 5), range(4)):
        with pytest.raises(ValueError, match=r"got . whole numbers: pass vertex indices as a NumPy array"):
            session.add(given)
    with pytest.raises(ValueError, match=r"must lie near the shape, .* pass vertex indices as a NumPy array"):
        session.add([5, 6, 7])
    session.add(np.array([0, 1, 2]))


SPARSE = torch.eye(3).to_sparse()


class Matrix:  # as SciPy's sparse matrices
    nnz = 3

    def toarray(self):
        return np.eye(3)


class Table:  # as a table of pandas with nullable columns
    def __init__(self, values):
        self._values = np.array(values, object)

    def __array__(self, dtype=None, copy=None):
        return self._values if dtype is None else self._values.astype(dtype)

    def to_numpy(self, dtype=None, na_value=None):
        return np.array([[na_value if each is None else each for each in row] for row in self._values], dtype)


Table.__module__ = "pandas.core.frame"


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (SPARSE, r"must be dense, got a sparse tensor: pass `.to_dense\(\)`"),
        (Matrix(), r"must be dense, got a sparse Matrix: pass `.toarray\(\)`"),
        (Table([[1, 2, 3]]), r"got a Table with a nullable type: pass `.to_numpy\(float\)`"),
        (Table([[1, None, 3]]), r"got a Table with missing values, .*: fill or remove them"),
        (Table([[1, "a", 3]]), r"got a Table with missing values, or columns that are not numbers"),
        (np.ma.masked_array(np.eye(3), np.eye(3) > 0), "must not be a masked array: fill or remove its 3 masked"),
        (np.ma.masked_array(np.eye(3)), "must not be a masked array: it has no masked values, so pass its `.data`"),
    ],
)
def test_arrays_of_other_libraries(value, said):
    with pytest.raises(ValueError, match=f"f: `x` .*{said}") as caught:
        check.array("f", "x", value, ("N", 3))
    assert "\n" not in str(caught.value)


def test_faces_of_other_libraries():
    with pytest.raises(ValueError, match="Mesh: `faces` must be a numeric array, got a Table with a nullable type"):
        Mesh(CORNERS, Table(CUBE.tolist()))


@pytest.mark.parametrize("ending", ["obj", "stl", "gltf"])
@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 10\n", "Git LFS pointer"),
        (gzip.compress(obj_cube().encode(), mtime=0), "compressed data"),
        (b"PK\x03\x04" + bytes(100), "an archive, such as a ZIP file"),
        (b"\n<!DOCTYPE html><html><body>404</body></html>", "an HTML page"),
        (obj_cube().encode("utf-16"), "UTF-16"),
        (obj_cube().encode("utf-16-be"), "UTF-16"),
    ],
)
def test_a_file_that_is_something_else_is_named(data, message, ending, tmp_path):
    with pytest.raises(
        ValueError, match=rf"load: `path` .*a\.{ending} is not a mesh file in .* format, but .*{message}"
    ):
        load(write(tmp_path / f"a.{ending}", data))


def test_a_mesh_under_the_ending_of_another_format_is_named(tmp_path):
    Mesh(CORNERS, CUBE).save(tmp_path / "a.ply")
    with pytest.raises(ValueError, match="but content of the format PLY"):
        load((tmp_path / "a.ply").rename(tmp_path / "a.glb"))


@pytest.mark.parametrize("name", ["../bin/data.bin", "lfs.bin"])
def test_data_that_is_not_read_is_named_with_the_reason(name, tmp_path):
    gltf = Gltf()
    gltf.node(mesh=gltf.mesh("cube", CORNERS, CUBE))
    gltf.header["buffers"] = [{"byteLength": len(gltf.data), "uri": name}]
    write(tmp_path / "lfs.bin", "version https://git-lfs.github.com/spec/v1\n")
    reason = "outside the folder" if name.startswith("..") else "Git LFS pointer"
    with pytest.raises(ValueError, match=f"names '{name}', which .*{reason}"):
        load(write(tmp_path / "a.gltf", json.dumps(gltf.header)))


@pytest.mark.parametrize("stride", [0, 3])
def test_a_byte_stride_below_four_is_refused_by_name(stride, tmp_path):
    gltf = Gltf()
    gltf.node(mesh=gltf.mesh("cube", CORNERS, CUBE))
    gltf.header["bufferViews"][1]["byteStride"] = stride
    with pytest.raises(ValueError, match=f"bufferView 1 has the byteStride {stride}; glTF permits 4 to 252 bytes"):
        load(write(tmp_path / "a.glb", gltf.glb()))


def test_a_scene_of_too_many_primitives_is_refused(tmp_path):
    gltf = cube()
    gltf.header["nodes"] = [{"mesh": 0}] * 100_001
    gltf.header["scenes"] = [{"nodes": list(range(100_001))}]
    assert "its scene places more than 100000 primitives" in message(write(tmp_path / "odd.glb", gltf.glb()))
    gltf = cube()
    gltf.header["meshes"][0]["primitives"] *= 20_001
    assert "its scene shows more than 20000 primitives" in message(write(tmp_path / "odd.glb", gltf.glb()))
