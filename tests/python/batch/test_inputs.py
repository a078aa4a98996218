"""Test which shapes a command line or a manifest names."""

from pathlib import Path

import pytest

from dfd.batch.inputs import Shape, find_shapes


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("shapes/a.obj", "shapes/a.ply", "shapes/deep/b.glb", "shapes/notes.txt"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    return tmp_path


def test_globs_name_shapes_by_where_they_lie_below_the_folder_they_share(folder):
    assert find_shapes(["shapes/**/*.*"]) == [
        Shape("a.obj", f"{folder}/shapes/a.obj"),
        Shape("a.ply", f"{folder}/shapes/a.ply"),
        Shape("deep-b.glb", f"{folder}/shapes/deep/b.glb"),
    ]
    assert [shape.name for shape in find_shapes(["shapes/*.ply", "shapes/deep/*"])] == ["a.ply", "deep-b.glb"]
    assert [shape.name for shape in find_shapes([f"{folder}/shapes/*.ply"])] == ["a.ply"]
    assert [shape.name for shape in find_shapes(["shapes/a.obj"])] == ["a.obj"]


def test_a_file_that_is_added_renames_no_other():
    before = {shape.path: shape.name for shape in find_shapes(["shapes/**/*.obj"])}
    Path("shapes/deep/a.obj").touch()
    after = {shape.path: shape.name for shape in find_shapes(["shapes/**/*.obj"])}
    assert before.items() < after.items()


def test_a_csv_manifest_is_relative_to_itself(folder):
    Path("shapes/list.csv").write_text("name,path,field,other\nfirst,a.obj,,1\n,deep/b.glb,b.field.safetensors,2\n")
    assert find_shapes(["shapes/list.csv"]) == [
        Shape("b.glb", f"{folder}/shapes/deep/b.glb", f"{folder}/shapes/b.field.safetensors"),
        Shape("first", f"{folder}/shapes/a.obj"),
    ]


@pytest.mark.parametrize(
    "names", [("x", "X"), ("../up", "up"), (".hidden", "hidden"), ("n" * 300, "n" * 299), ("…", "é")]
)
def test_names_that_no_folder_can_have_are_changed(names):
    Path("list.csv").write_text("name,path\n" + "".join(f"{name},{i}.obj\n" for i, name in enumerate(names)), "utf-8")
    found = [shape.name for shape in find_shapes(["list.csv"])]
    assert len({name.casefold() for name in found}) == 2
    assert all(len(name) <= 113 and "/" not in name and name[0] not in ".-" for name in found)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"file\na.obj\n", r"list.csv must have a column `path`, got file"),
        (b"", r"list.csv must have a column `path`, got none"),
        (b"path\n", r"list.csv has no rows"),
        (b"path,name\n,x\n", r"row 1 of list.csv has no path"),
        (b"path\n\xff\xfe\n", r"list.csv is no CSV file in UTF-8"),
    ],
)
def test_a_manifest_that_says_too_little_is_refused(text, message):
    Path("list.csv").write_bytes(text)
    with pytest.raises(ValueError, match=message):
        find_shapes(["list.csv"])


@pytest.mark.parametrize(
    ("inputs", "message"),
    [
        (["none/*.obj"], r"nothing matches none/\*.obj"),
        (["none.obj"], "none.obj does not exist"),
        (["none.csv"], "none.csv"),
        (["shapes/a.obj", "list.csv"], "must be meshes and globs or one manifest, got list.csv and others"),
        ([], "`MESH` must name a mesh, a glob or a manifest, got none"),
    ],
)
def test_what_is_not_there_is_said(inputs, message):
    with pytest.raises((OSError, ValueError), match=message):
        find_shapes(inputs)
