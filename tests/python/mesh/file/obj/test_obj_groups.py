"""Face groups of OBJ files, whether the file's parts were made of them or not."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mesh_files import CORNERS, CUBE, write

from dfd.mesh.file.obj.read import face_groups
from dfd.mesh.mesh import Mesh, load


def test_a_name_that_is_not_there_gets_those_that_are(tmp_path):
    groups = "o house\ng wall door\nf 1 2 3\n" + "".join(f"g n{i}\nf 1 2 3\n" for i in range(30))
    mesh = load(write(tmp_path / "many.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n" + groups))
    assert mesh.group_names[:4] == ("wall door", "wall", "door", "n0")
    assert mesh.group_names[-1] == "house"
    assert mesh.group_vertices("wall").tolist() == [0, 1, 2]
    for name in ("nothing", "", "WALL"):
        with pytest.raises(ValueError, match=r"`name` must be a face group of the file \(wall door, .*, n16, …\), got"):
            mesh.group_vertices(name)
    for other in (Mesh(CORNERS, CUBE), load(write(tmp_path / "no.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"))):
        assert other.group_names == ()
        with pytest.raises(ValueError, match=r"`name` must be a face group of the mesh \(it has none\), got 'wall'"):
            other.group_vertices("wall")


@given(st.lists(st.tuples(st.sampled_from(["o", "g", "usemtl"]), st.sampled_from(["a", "b", "a b", ""])), max_size=8))
def test_groups_are_what_a_reader_line_by_line_finds(statements):
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
