"""Options of textures in MTL files."""

import numpy as np
import pytest
from mesh_files import checkered, header_and_data, look_of, write

from dfd.mesh.mesh import load

QUAD = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
RED, GREEN, BLUE, WHITE = (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)  # above left and right, below left and right


def textured(folder, line):
    checkered(folder / "paint.png", 64)
    write(folder / "a.mtl", f"newmtl m\n{line}\n")
    return write(folder / "a.obj", f"mtllib a.mtl\n{QUAD}usemtl m\nf 1/1 2/2 3/3 4/4\n")


def color_at(mesh, u, v):
    """Return the color at a point of the square."""
    face, corner = (0, (1 - u, u - v, v)) if u >= v else (1, (1 - v, u, v - u))
    return look_of(mesh).albedo(np.array([face]), np.array([corner]))[0, :3]


@pytest.mark.parametrize(
    ("options", "place", "expected"),
    [
        ("", (0.3, 0.3), BLUE),
        ("-s 2 1 1", (0.3, 0.3), WHITE),
        ("-s 2", (0.3, 0.3), WHITE),
        ("-o 0.5 0 0", (0.3, 0.3), WHITE),
        ("-o 0 0.5", (0.3, 0.3), RED),
        ("-s 1 2 1 -o 0.5 0.1 0", (0.3, 0.3), GREEN),
        ("-blendu on -bm 1 -s 2 1 1 -texres 64", (0.3, 0.3), WHITE),
        ("-clamp on -s 8 8 8", (0.9, 0.1), GREEN),
        ("-mm 0 0.5", (0.3, 0.3), (0, 0, 0.5)),
        ("-mm 0.25 0.5", (0.3, 0.3), (0.25, 0.25, 0.75)),
    ],
)
@pytest.mark.parametrize("ending", ["obj", "glb"])
def test_scale_offset_and_the_rest(options, place, expected, ending, tmp_path):
    mesh = load(textured(tmp_path, f"map_Kd {options} paint.png"))
    (tmp_path / "out").mkdir()
    assert np.allclose(color_at(mesh, *place), expected, atol=0.01)
    mesh.save(tmp_path / "out" / f"a.{ending}")
    assert np.allclose(color_at(load(tmp_path / "out" / f"a.{ending}"), *place), expected, atol=0.01)


def test_a_gltf_file_has_the_scale_as_an_extension(tmp_path):
    load(textured(tmp_path, "map_Kd -s 2 3 1 -o 0.25 0.5 0 paint.png")).save(tmp_path / "a.glb")
    header, _ = header_and_data(tmp_path / "a.glb")
    assert header["extensionsUsed"] == ["KHR_texture_transform"]
    (material,) = header["materials"]
    change = material["pbrMetallicRoughness"]["baseColorTexture"]["extensions"]["KHR_texture_transform"]
    assert change == {"scale": [2, 3], "offset": [0.25, -2.5]}


@pytest.mark.parametrize("option", ["-t 0.5 0.5 0", "-imfchan r", "-cc on", "-magic 3"])
def test_options_that_are_not_applied_are_named(option, tmp_path):
    with pytest.warns(UserWarning, match=f"the option {option.split()[0]} of the texture 'paint.png' is ignored"):
        load(textured(tmp_path, f"map_Kd {option} paint.png"))


@pytest.mark.parametrize("name", ["a -s 2 b.png", "50% a&b!.png", "3.png", "a#1.png"])
def test_names_that_look_like_options(name, tmp_path):
    path = textured(tmp_path, f"map_Kd -s 2 1 1 {name}")
    (tmp_path / "paint.png").rename(tmp_path / name)
    assert np.allclose(color_at(load(path), 0.3, 0.3), WHITE, atol=0.01)
