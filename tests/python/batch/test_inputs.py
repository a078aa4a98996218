"""Which shapes a command line or a manifest names."""

from __future__ import annotations

from pathlib import Path

import fsspec
import pyarrow
import pytest
from pyarrow import parquet

from dfd.batch.inputs import Shape, find_shapes


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("shapes/a.obj", "shapes/a.ply", "shapes/deep/b.glb", "shapes/notes.txt"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    return tmp_path


def test_globs_name_shapes_by_where_they_lie_below_the_folder_they_share():
    assert find_shapes(["shapes/**/*.*"]) == [
        Shape("a.obj", "shapes/a.obj"),
        Shape("a.ply", "shapes/a.ply"),
        Shape("deep-b.glb", "shapes/deep/b.glb"),
    ]
    assert [shape.name for shape in find_shapes(["shapes/*.ply", "shapes/deep/*"])] == ["a.ply", "deep-b.glb"]


def test_a_file_that_is_added_renames_no_other():
    before = {shape.path: shape.name for shape in find_shapes(["shapes/**/*.obj"])}
    Path("shapes/deep/a.obj").touch()
    after = {shape.path: shape.name for shape in find_shapes(["shapes/**/*.obj"])}
    assert before.items() < after.items()


def test_an_absolute_glob_and_a_single_file_work(folder):
    assert [shape.name for shape in find_shapes([f"{folder}/shapes/*.ply"])] == ["a.ply"]
    assert find_shapes(["shapes/a.obj"]) == [Shape("a.obj", "shapes/a.obj")]


def test_a_csv_manifest_is_relative_to_itself(folder):
    Path("shapes/list.csv").write_text(
        "name,path,field,other\nfirst,a.obj,,1\n,deep/b.glb,b.field.safetensors,2\nfar,memory://x/far.ply,,3\n"
    )
    assert find_shapes(["shapes/list.csv"]) == [
        Shape("b.glb", "shapes/deep/b.glb", "shapes/b.field.safetensors"),
        Shape("far", "memory://x/far.ply"),
        Shape("first", "shapes/a.obj"),
    ]


def test_a_parquet_manifest_says_the_same():
    parquet.write_table(pyarrow.table({"path": ["a.obj", "deep/b.glb"], "name": ["one", None]}), "shapes/list.parquet")
    assert find_shapes(["shapes/list.parquet"]) == [Shape("b.glb", "shapes/deep/b.glb"), Shape("one", "shapes/a.obj")]


def test_urls_are_read_by_fsspec():
    files = fsspec.filesystem("memory")
    files.pipe({"/shelf/c.ply": b"", "/shelf/d.obj": b"", "/shelf/list.csv": b"path\nc.ply\n"})
    try:
        assert find_shapes(["memory:///shelf/*.*"]) == [
            Shape("c.ply", "memory:///shelf/c.ply"),
            Shape("d.obj", "memory:///shelf/d.obj"),
        ]
        assert find_shapes(["memory:///shelf/list.csv"]) == [Shape("c.ply", "memory:///shelf/c.ply")]
        with pytest.raises(FileNotFoundError, match="nothing matches memory:///none"):
            find_shapes(["memory:///none/*.ply"])
    finally:
        files.rm("/shelf", recursive=True)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("file\na.obj\n", r"list.csv must have a column path, got file"),
        ("", r"list.csv must have a column path, got none"),
        ("path\n", r"list.csv has no rows"),
        ("path,name\n,x\n", r"row 1 of list.csv has no path"),
        ("path,name\na.obj,x\nb.obj,X\n", r"`name` must be distinct, but a.obj and b.obj are both X"),
        ("path\nx/a.obj\ny/a.obj\n", r"`name` must be distinct, .* a manifest with a column name tells them apart"),
        ("path,name\na.obj,../up\n", r"`name` must be letters.*got '../up' for a.obj"),
        ("path,name\na.obj,.hidden\n", r"`name` must be letters.*got '.hidden'"),
    ],
)
def test_a_manifest_that_says_too_little_is_refused(text, message):
    Path("list.csv").write_text(text)
    with pytest.raises(ValueError, match=message):
        find_shapes(["list.csv"])


def test_what_is_no_manifest_is_refused():
    Path("list.csv").write_bytes(b"path\n\xff\xfe\n")
    with pytest.raises(ValueError, match=r"list.csv is no CSV file in UTF-8"):
        find_shapes(["list.csv"])
    Path("list.parquet").write_bytes(b"no table")
    with pytest.raises(ValueError, match=r"list.parquet is no Parquet file"):
        find_shapes(["list.parquet"])
    with pytest.raises(ValueError, match=r"must be meshes and globs or one manifest, got list.csv and others"):
        find_shapes(["shapes/a.obj", "list.csv"])


def test_what_is_not_there_is_said():
    with pytest.raises(FileNotFoundError, match=r"nothing matches none/\*.obj"):
        find_shapes(["none/*.obj"])
    with pytest.raises(FileNotFoundError, match=r"none.obj does not exist"):
        find_shapes(["none.obj"])
    with pytest.raises(FileNotFoundError):
        find_shapes(["none.csv"])
    with pytest.raises(ValueError, match="`MESH` must name a mesh, a glob or a manifest, got none"):
        find_shapes([])
