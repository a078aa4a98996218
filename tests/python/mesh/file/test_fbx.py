"""FBX files: meshes, instances, axes, units, materials and skins; and files that are damaged."""

from __future__ import annotations

import contextlib
import importlib.util
import json
import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

import dfd
from dfd import Mesh

pytest.importorskip("ufbx")

CUBE = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]  # wound outwards


def array(name: str, values: Any) -> str:
    numbers = np.asarray(values).ravel().tolist()
    return f"{name}: *{len(numbers)} {{\na: {','.join(map(repr, numbers))}\n}}\n"


def properties(**values: tuple[float, ...]) -> str:
    lines = [
        f'P: "{name.replace("_", " ")}", "", "", "A",{",".join(map(repr, each))}\n' for name, each in values.items()
    ]
    return f"Properties70: {{\n{''.join(lines)}}}\n"


def geometry(number: int, vertices: Any, polygons: Any, layers: str = "") -> str:
    corners = [vertex if i < len(each) - 1 else -1 - vertex for each in polygons for i, vertex in enumerate(each)]
    return (
        f'Geometry: {number}, "Geometry::shape", "Mesh" {{\n{array("Vertices", vertices)}'
        f"{array('PolygonVertexIndex', corners)}GeometryVersion: 124\n{layers}}}\n"
    )


def layer(kind: str, mapping: str, name: str, values: Any, indices: Any = None) -> str:
    plural = {"Normal": "Normals", "UV": "UV", "Material": "Materials"}[kind]
    told = "Direct" if indices is None else "IndexToDirect"
    listed = "" if indices is None else array(f"{plural}Index", indices)
    return (
        f'LayerElement{kind}: 0 {{\nVersion: 101\nName: "{name}"\nMappingInformationType: "{mapping}"\n'
        f'ReferenceInformationType: "{told}"\n{array(plural, values)}{listed}}}\n'
        f'Layer: 0 {{\nVersion: 100\nLayerElement: {{\nType: "LayerElement{kind}"\nTypedIndex: 0\n}}\n}}\n'
    )


def node(number: int, name: str, kind: str = "Mesh", **values: tuple[float, ...]) -> str:
    return f'Model: {number}, "Model::{name}", "{kind}" {{\nVersion: 232\n{properties(**values)}}}\n'


def fbx(objects: str, connections: list[tuple[Any, ...]], *, up: int = 1, unit: float = 100.0) -> str:
    """The text of a file; `up` is 1 for y and 2 for z, `unit` what one unit is in centimeters."""
    front = {1: (2, 1), 2: (1, -1)}[up]
    settings = {"UpAxis": up, "UpAxisSign": 1, "FrontAxis": front[0], "FrontAxisSign": front[1]}
    settings |= {"CoordAxis": 0, "CoordAxisSign": 1}
    axes = "".join(f'P: "{name}", "int", "Integer", "",{value}\n' for name, value in settings.items())
    lines = [f"C: {','.join(map(json.dumps, line))}\n" for line in connections]
    return (
        "; FBX 7.4.0 project file\nFBXHeaderExtension: {\nFBXHeaderVersion: 1003\nFBXVersion: 7400\n}\n"
        f"GlobalSettings: {{\nVersion: 1000\nProperties70: {{\n{axes}"
        f'P: "UnitScaleFactor", "double", "Number", "",{unit}\n}}\n}}\n'
        f"Objects: {{\n{objects}}}\nConnections: {{\n{''.join(lines)}}}\n"
    )


def load(folder: Path, text: str | bytes, **how: Any) -> Mesh:
    path = folder / "shape.fbx"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return dfd.load(path, **how)


def plain_cube(**how: Any) -> str:
    return fbx(geometry(1, CUBE, QUADS) + node(2, "Box"), [("OO", 1, 2), ("OO", 2, 0)], **how)


def placed(mesh: Mesh) -> set[tuple[float, ...]]:
    return {tuple(row) for row in np.round(mesh.vertices, 6).tolist()}


def test_a_cube_is_a_cube(tmp_path: Path) -> None:
    mesh = load(tmp_path, plain_cube())
    assert placed(mesh) == {tuple(row) for row in CUBE.tolist()}
    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    volume = np.einsum("fi,fi->", corners[:, 0], normals) / 6
    assert len(mesh.faces) == 12
    assert volume == pytest.approx(1)
    assert [part.name for part in mesh.parts] == ["Box"]


def test_units_become_meters_and_up_becomes_y(tmp_path: Path) -> None:
    text = plain_cube(up=2, unit=1.0)
    mesh = load(tmp_path, text)
    # What points up along z points along y, and what points to the back along y points along −z.
    assert placed(mesh) == {tuple(np.round(row, 6)) for row in 0.01 * CUBE[:, [0, 2, 1]] * (1, 1, -1) + 0.0}


def test_an_instance_stands_where_its_node_is(tmp_path: Path) -> None:
    turned_up = {"Lcl_Rotation": (0.0, 0.0, 90.0), "Lcl_Scaling": (2.0, 1.0, 1.0)}
    second = node(3, "Other", Lcl_Translation=(5.0, 0.0, 0.0), **turned_up)
    text = fbx(
        geometry(1, CUBE, QUADS) + node(2, "Box") + second, [("OO", 1, 2), ("OO", 2, 0), ("OO", 1, 3), ("OO", 3, 0)]
    )
    mesh = load(tmp_path, text)
    turned = np.column_stack([5 - CUBE[:, 1], 2 * CUBE[:, 0], CUBE[:, 2]])
    assert placed(mesh) == {tuple(row) for row in np.round(np.vstack([CUBE, turned]), 6).tolist()}
    assert [part.name for part in mesh.parts] == ["Box", "Other"]


def test_materials_textures_and_normals(tmp_path: Path) -> None:
    Image.fromarray(np.array([[[255, 0, 0], [0, 255, 0]]], np.uint8)).save(tmp_path / "skin.png")
    uv = [(0.25, 0.5), (0.75, 0.5)]
    layers = (
        layer("UV", "ByPolygonVertex", "map", uv, [0] * 12 + [1] * 12)
        + layer("Normal", "ByPolygonVertex", "", np.repeat([(1, 0, 0)], 24, axis=0))
        + layer("Material", "ByPolygon", "", [0, 0, 0, 0, 1, 1])
    )
    objects = (
        geometry(1, CUBE, QUADS, layers)
        + node(2, "Box")
        + f'Material: 3, "Material::painted", "" {{\nVersion: 102\nShadingModel: "phong"\n{properties()}}}\n'
        + 'Material: 4, "Material::blue", "" {\nVersion: 102\nShadingModel: "phong"\n'
        + f"{properties(DiffuseColor=(0.0, 0.0, 1.0), DiffuseFactor=(1.0,))}}}\n"
        + 'Texture: 5, "Texture::skin", "" {\nType: "TextureVideoClip"\nFileName: "C:\\\\work\\\\skin.png"\n'
        + 'RelativeFilename: "..\\\\elsewhere\\\\skin.png"\n}\n'
    )
    links = [("OO", 1, 2), ("OO", 2, 0), ("OO", 3, 2), ("OO", 4, 2), ("OP", 5, 3, "DiffuseColor")]
    mesh = load(tmp_path, fbx(objects, links))
    assert mesh.appearance is not None
    albedo = mesh.appearance.albedo(np.arange(12), np.full((12, 3), 1 / 3))
    np.testing.assert_allclose(albedo[:6], np.tile([1, 0, 0, 1], (6, 1)), atol=1e-6)
    np.testing.assert_allclose(albedo[6:8], np.tile([0, 1, 0, 1], (2, 1)), atol=1e-6)
    np.testing.assert_allclose(albedo[8:], np.tile([0, 0, 1, 1], (4, 1)), atol=1e-6)
    written = tmp_path / "out.glb"
    mesh.save(written)
    np.testing.assert_allclose(dfd.load(written).vertices, mesh.vertices, atol=1e-6)


def bar() -> str:
    """A bar of four segments along x, bound straight; the second bone stands turned up by 30° at x = 2."""
    vertices = [(x, y, z) for x in range(5) for y, z in ((0, 0), (1, 0), (1, 1), (0, 1))]
    around = [(i, (i + 1) % 4, 4 + (i + 1) % 4, 4 + i) for i in range(4)]
    sides = [tuple(4 * segment + corner for corner in side) for segment in range(4) for side in around]
    identity = np.eye(4)
    at_two = np.eye(4)
    at_two[3, 0] = 2.0

    def cluster(number: int, vertices: list[int], link: Any) -> str:
        return (
            f'Deformer: {number}, "SubDeformer::c", "Cluster" {{\nVersion: 100\n{array("Indexes", vertices)}'
            f"{array('Weights', [1.0] * len(vertices))}{array('Transform', np.linalg.inv(link))}"
            f"{array('TransformLink', link)}}}\n"
        )

    objects = (
        geometry(1, np.array(vertices, float), sides)
        + node(2, "Bar")
        + node(3, "Hip", "LimbNode")
        + node(4, "Shin", "LimbNode", Lcl_Translation=(2.0, 0.0, 0.0), Lcl_Rotation=(0.0, 0.0, 30.0))
        + 'Deformer: 5, "Deformer::skin", "Skin" {\nVersion: 101\n}\n'
        + cluster(6, list(range(8)), identity)
        + cluster(7, list(range(8, 20)), at_two)
    )
    links = [("OO", 1, 2), ("OO", 2, 0), ("OO", 3, 0), ("OO", 4, 3), ("OO", 5, 1), ("OO", 6, 5), ("OO", 7, 5)]
    return fbx(objects, [*links, ("OO", 3, 6), ("OO", 4, 7)])


def test_a_skin_is_posed_as_its_bones_stand(tmp_path: Path) -> None:
    posed, bound = load(tmp_path, bar()), load(tmp_path, bar(), pose="bind")
    assert len(bound.vertices) == len(posed.vertices) == 20
    far = bound.vertices[:, 0] >= 2
    turned = Rotation.from_euler("z", 30, degrees=True).apply(bound.vertices[far] - (2, 0, 0)) + (2, 0, 0)
    np.testing.assert_allclose(posed.vertices[far], turned, atol=1e-6)
    np.testing.assert_allclose(posed.vertices[~far], bound.vertices[~far], atol=1e-6)


@pytest.mark.parametrize(
    ("damage", "found"),
    [
        (lambda text: text[:0], "is empty"),
        (lambda text: b"no such file" * 9, "not a well-formed FBX file"),
        (lambda text: text[: len(text) // 3], "FBX file|holds no faces"),
        (lambda text: text.replace(b"-3,", b"-300,", 1), "not a well-formed FBX file"),
        (lambda text: text.replace(b"1.0", b"nan", 3), "finite|well-formed"),
        (lambda text: b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "not a well-formed FBX file"),
    ],
)
def test_what_is_damaged_is_refused_in_one_line(tmp_path: Path, damage: Any, found: str) -> None:
    with pytest.raises(ValueError, match=found) as caught:
        load(tmp_path, damage(plain_cube().encode()))
    assert "\n" not in str(caught.value)
    assert "shape.fbx" in str(caught.value)


@pytest.mark.slow
def test_noise_never_ends_this_process(tmp_path: Path) -> None:
    whole, chance = bar().encode(), random.Random(0)
    for _ in range(40):
        data = bytearray(whole)
        for _ in range(chance.randrange(1, 9)):
            at = chance.randrange(len(data))
            data[at : at + chance.randrange(4)] = chance.choice([b"-1", b"4294967295", b"1e308", b",", b"}", b'"', b""])
        with contextlib.suppress(ValueError):
            assert np.isfinite(load(tmp_path, bytes(data)).vertices).all()


def test_without_the_library_the_message_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    known = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *rest: None if name == "ufbx" else known(name, *rest))
    with pytest.raises(ValueError, match=r"is an FBX file, which needs `pip install dfd\[fbx\]` to be read"):
        load(tmp_path, plain_cube())


def test_fbx_is_not_written(tmp_path: Path) -> None:
    mesh = load(tmp_path, plain_cube())
    with pytest.raises(ValueError, match=r"must end in .* FBX is read, not written; other programs open"):
        mesh.save(tmp_path / "out.fbx")
