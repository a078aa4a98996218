"""Saving in the file's own format: new positions in its own bytes, precision and byte order, and nothing else."""

import re
import struct
import warnings

import numpy as np
import pytest
from mesh_files import CORNERS, CUBE

from dfd import Mesh, load

TYPES = {"double": "f8", "float": "f4", "int": "i4", "short": "i2", "uchar": "u1"}
MOVED = CORNERS + [[0.1, 1 / 3, -0.25]] * (np.arange(8) == 7)[:, None]


def ply_file(path, order, kind):
    """A cube with normals, a mark for each vertex, a comment, a custom element and odd spacing."""
    form = {"": "ascii", "<": "binary_little_endian", ">": "binary_big_endian"}[order]
    head = ["ply", f"format {form} 1.0", "comment made by hand", "element vertex 8"]
    head += [f"property {kind} {axis}" for axis in "xyz"] + ["property uchar mark", "property float nx"]
    head += ["property float ny", "property float nz", "element face 12", "property list uchar int vertex_indices"]
    head += ["element extra 1", "property int thing", "end_header", ""]
    normals = (CORNERS - 0.5) / np.linalg.norm(CORNERS - 0.5, axis=1, keepdims=True)
    if not order:
        body = [f"  {x:g} {y:g}  {z:g} 7 {a:.4f} {b:.4f} {c:.4f}" for (x, y, z), (a, b, c) in
                zip(CORNERS.tolist(), normals.tolist(), strict=True)]  # fmt: skip
        body += [f"3 {a} {b} {c}" for a, b, c in CUBE.tolist()] + ["42"]
        path.write_text("\n".join([*head, *body, ""]).replace("end_header\n\n", "end_header\n"))
        return path
    rows = np.zeros(8, [("xyz", order + TYPES[kind], 3), ("mark", "u1"), ("normal", order + "f4", 3)])
    rows["xyz"], rows["mark"], rows["normal"] = CORNERS, 7, normals
    faces = np.zeros(12, [("count", "u1"), ("corners", order + "i4", 3)])
    faces["count"], faces["corners"] = 3, CUBE
    path.write_bytes("\n".join(head).encode() + rows.tobytes() + faces.tobytes() + struct.pack(f"{order}i", 42))
    return path


@pytest.mark.parametrize("order", ["", "<", ">"])
@pytest.mark.parametrize("kind", ["double", "float"])
def test_ply_keeps_its_order_type_and_all_else(order, kind, tmp_path):
    source = ply_file(tmp_path / "cube.ply", order, kind)
    mesh = load(source)
    mesh.save(tmp_path / "same.ply")
    assert (tmp_path / "same.ply").read_bytes() == source.read_bytes()
    mesh.save(tmp_path / "moved.ply", MOVED)
    again = load(tmp_path / "moved.ply")
    exact = kind == "double" or not order
    assert np.array_equal(again.vertices, MOVED if exact else MOVED.astype(np.float32))
    old, new = source.read_bytes(), (tmp_path / "moved.ply").read_bytes()
    assert old[: old.index(b"end_header")] == new[: new.index(b"end_header")]
    if order:
        assert len(old) == len(new)
        assert new[-4:] == old[-4:]
    else:  # lines of the face and of what did not move stay
        pairs = zip(old.splitlines(), new.splitlines(), strict=True)
        assert sum(before != after for before, after in pairs) <= 8
    before, after = (each.scene.primitives[0].geometry.normals for each in (mesh, again))
    assert not np.allclose(before, after, atol=1e-2)
    assert np.allclose(np.linalg.norm(after, axis=1), 1, atol=1e-3)


@pytest.mark.parametrize("order", ["", "<", ">"])
@pytest.mark.parametrize("kind", ["int", "short", "uchar", "float"])
def test_ply_gets_wider_types_where_its_own_hold_too_little(order, kind, tmp_path):
    mesh = load(ply_file(tmp_path / "cube.ply", order, kind))
    mesh.save(tmp_path / "whole.ply", CORNERS + 3.0)
    assert f"property {kind} x".encode() in (tmp_path / "whole.ply").read_bytes()
    assert np.array_equal(load(tmp_path / "whole.ply").vertices, CORNERS + 3.0)
    far = MOVED + 5.4e6 + 0.1
    mesh.save(tmp_path / "far.ply", far)
    assert np.array_equal(load(tmp_path / "far.ply").vertices, far)
    assert (tmp_path / "far.ply").read_bytes().endswith(struct.pack(f"{order}i", 42) if order else b"42\n")


def test_binary_stl_keeps_its_header_and_marks(tmp_path):
    Mesh(CORNERS, CUBE).save(tmp_path / "cube.stl")
    data = bytearray((tmp_path / "cube.stl").read_bytes())
    data[:5], data[132:134] = b"hello", b"\x07\x01"
    (tmp_path / "cube.stl").write_bytes(data)
    mesh = load(tmp_path / "cube.stl")
    moved = mesh.vertices * (1, 1, 2)
    mesh.save(tmp_path / "moved.stl", moved)
    new = (tmp_path / "moved.stl").read_bytes()
    assert (new[:80], new[132:134], len(new)) == (bytes(data[:80]), b"\x07\x01", len(data))
    assert np.array_equal(load(tmp_path / "moved.stl").vertices, moved)


def test_normals_of_turned_sides_stay_on_their_side(tmp_path):
    turned = np.vstack([CUBE[:6], CUBE[6:, ::-1]])  # the last sides have normals that point inwards
    corners, normals = CORNERS[turned], np.cross(*np.diff(CORNERS[CUBE], axis=1).transpose(1, 0, 2))
    text = "".join(
        f"facet normal {n[0]:g} {n[1]:g} {n[2]:g}\nouter loop\n"
        + "".join(f"vertex {x:g} {y:g} {z:g}\n" for x, y, z in face)
        + "endloop\nendfacet\n"
        for n, face in zip(normals, corners, strict=True)
    )
    (tmp_path / "cube.stl").write_text(f"solid cube\n{text}endsolid cube\n")
    mesh = load(tmp_path / "cube.stl")
    mesh.save(tmp_path / "moved.stl", mesh.vertices[:, [1, 2, 0]])
    lines = (tmp_path / "moved.stl").read_text().splitlines()
    found = np.array([line.split()[2:] for line in lines if "normal" in line])
    np.testing.assert_allclose(found.astype(float), normals[:, [1, 2, 0]] / np.linalg.norm(normals, axis=1)[:, None])


def test_text_stl_and_off_keep_their_text(tmp_path):
    facets = [
        "facet normal 0 0 1\n outer loop\n"
        + "".join(f"  vertex {x:g} {y:g} {z:g}\n" for x, y, z in CORNERS[face].tolist())
        + " endloop\nendfacet\n"
        for face in CUBE
    ]
    (tmp_path / "cube.stl").write_text("solid box # one\n" + "".join(facets) + "endsolid box\n")
    lines = [f"{x:g} {y:g} {z:g} 0 0 1 # corner" for x, y, z in CORNERS.tolist()]
    lines += [f"3 {a} {b} {c} 255 0 0" for a, b, c in CUBE.tolist()]
    (tmp_path / "cube.off").write_text("\n".join(["NOFF", "# by hand", "8 12 0", *lines, ""]))
    for name in ("cube.stl", "cube.off"):
        mesh = load(tmp_path / name)
        mesh.save(tmp_path / f"same{name[-4:]}")
        assert (tmp_path / f"same{name[-4:]}").read_text() == (tmp_path / name).read_text()
        moved = mesh.vertices + 1e-20 * (mesh.vertices == 0)
        moved[0] -= 1 / 3
        mesh.save(tmp_path / f"moved{name[-4:]}", moved)
        assert np.array_equal(load(tmp_path / f"moved{name[-4:]}").vertices, moved)
        words = [re.sub(r"[-+.\de]+", "", (tmp_path / each).read_text()) for each in (name, f"moved{name[-4:]}")]
        assert words[0] == words[1]


@pytest.mark.parametrize("far", [5.4e6, 1e9])
@pytest.mark.parametrize("source", [".obj", ".ply", ".glb"])
def test_a_shape_far_from_the_origin_survives(source, far, tmp_path):
    Mesh(CORNERS, CUBE).save(tmp_path / f"near{source}")
    mesh = load(tmp_path / f"near{source}")
    moved = mesh.vertices * (1, 0.9, 1.1) + far
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for ending in (".ply", ".glb", ".gltf", ".obj", ".off"):
            mesh.save(tmp_path / f"far{ending}", moved)
            again = load(tmp_path / f"far{ending}")
            assert len(again.vertices) == len(moved)
            order = [np.lexsort(np.round(each - far, 4).T) for each in (again.vertices, moved)]
            assert np.abs(again.vertices[order[0]] - moved[order[1]]).max() <= 2e-7
    with pytest.warns(UserWarning, match=r"32-bit floats, which move vertices by up to .* % of the shape"):
        mesh.save(tmp_path / "far.stl", moved)
