"""Face groups of OBJ files, whether the file's parts were made of them or not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mesh_files import CORNERS, CUBE, write

from dfd.mesh.file.obj.read import face_groups
from dfd.mesh.mesh import Mesh, load

HOUSE = """mtllib nowhere.mtl
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
v 0 0 1
v 1 0 1
v 1 1 1
v 0 1 1
f 1 2 3
o house
g wall door
usemtl brick
f 1 2 6 5
g wall
f 2 3 7 6
o roof
f 5 6 7
usemtl tile
g window
f 5 7 8
o empty
g nothing
g
f 1 2
f 4 1 5 8
"""


@pytest.fixture
def house(tmp_path: Path) -> Mesh:
    with pytest.warns(UserWarning, match="fewer than three"), pytest.warns(UserWarning, match="nowhere.mtl"):
        return load(write(tmp_path / "house.obj", HOUSE))


def test_every_kind_of_name_is_a_group(house: Mesh) -> None:
    assert house.part_names == ("house", "roof", "empty")  # parts are of the one kind that divides the file
    wanted = {
        "wall door": [0, 1, 4, 5],
        "wall": [0, 1, 2, 4, 5, 6],  # a word of one line, and alone on another; it goes on behind `o roof`
        "door": [0, 1, 4, 5],
        "window": [4, 6, 7],
        "house": [0, 1, 2, 4, 5, 6],
        "roof": [4, 5, 6, 7],
        "empty": [0, 3, 4, 7],
        "brick": [0, 1, 2, 4, 5, 6],
        "tile": [0, 3, 4, 6, 7],
    }
    assert house.group_names == tuple(wanted)
    for name, vertices in wanted.items():
        assert house.group_vertices(name).tolist() == vertices


def test_of_two_kinds_with_one_name_the_group_is_meant(tmp_path: Path) -> None:
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nusemtl red\nf 1 2 3\ng red\nusemtl blue\nf 2 3 4\n"
    mesh = load(write(tmp_path / "two.obj", text))
    assert mesh.group_vertices("red").tolist() == [1, 2, 3]
    assert mesh.group_names == ("red", "blue")


def test_vertices_are_those_that_faces_name(tmp_path: Path) -> None:
    """Of several at one position the first is, and relative numbers count back."""
    mesh = load(write(tmp_path / "twice.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 0\nv 1 1 0\ng some\nf -2 2 -1\n"))
    assert mesh.group_vertices("some").tolist() == [0, 1, 4] == sorted(set(mesh.faces.ravel().tolist()))


def test_a_name_that_is_not_there_gets_those_that_are(house: Mesh, tmp_path: Path) -> None:
    for name in ("nothing", "", "WALL"):
        with pytest.raises(
            ValueError, match=r"`name` must be a face group of the file \(wall door, wall, .*tile\), got"
        ):
            house.group_vertices(name)
    many = "".join(f"g n{i}\nf 1 2 3\n" for i in range(30))
    mesh = load(write(tmp_path / "many.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n" + many))
    with pytest.raises(ValueError, match=r"\(n0, .*, n19, …\), got 'x'"):
        mesh.group_vertices("x")
    for other in (Mesh(CORNERS, CUBE), load(write(tmp_path / "no.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"))):
        assert other.group_names == ()
        with pytest.raises(ValueError, match=r"`name` must be a face group, and the mesh has none, got 'wall'"):
            other.group_vertices("wall")


@given(st.lists(st.tuples(st.sampled_from(["o", "g", "usemtl"]), st.sampled_from(["a", "b", "a b", ""])), max_size=8))
def test_groups_are_what_a_reader_line_by_line_finds(statements: list[tuple[str, str]]) -> None:
    lines, state = ["v 0 0 0\n" * 20], dict.fromkeys(("g", "o", "usemtl"), "")
    wanted: dict[str, set[int]] = {}
    by_kind: dict[str, dict[str, set[int]]] = {keyword: {} for keyword in state}
    for number, (keyword, name) in enumerate(statements):
        state[keyword] = name
        lines.append(f"{keyword} {name}\nf {number + 1} {number + 2} {number + 3}\n")
        for kind, held in state.items():
            for one in {held, *(held.split() if kind == "g" else ())} - {""}:
                by_kind[kind].setdefault(one, set()).update(range(number, number + 3))
    for kind in ("usemtl", "o", "g"):
        wanted |= by_kind[kind]
    found = {name: set(held.tolist()) for name, held in face_groups("".join(lines).encode()).items()}
    assert found == wanted
    assert all((np.diff(held) > 0).all() for held in face_groups("".join(lines).encode()).values())
