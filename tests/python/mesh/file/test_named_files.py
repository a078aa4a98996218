"""Files that a mesh file names are found by their path, in any case, or else by their name beside it."""

import pytest
from mesh_files import write

from dfd.mesh.file.assets import AssetFolder


def folder_of(tmp_path, names):
    for name in names:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        write(tmp_path / name, name)
    return tmp_path / "m" / "a.obj"


@pytest.mark.parametrize(
    ("there", "name", "found"),
    [
        (["m/a.png", "m/t/a.png"], "t/a.png", "m/t/a.png"),
        (["m/a.png"], "t/a.png", "m/a.png"),
        (["m/T/A.png"], "t/a.PNG", "m/T/A.png"),
        (["m/a.png", "m/A.png"], "A.png", "m/A.png"),
        (["m/a b.png"], "a%20b.png", "m/a b.png"),
        (["m/a.png"], "C:\\x\\A.png", "m/a.png"),
        (["m/a.png"], "/home/x/a.png", "m/a.png"),
        (["m/a.png"], "../t/a.png", "m/a.png"),
    ],
)
def test_beside_a_mesh(there, name, found, tmp_path):
    assert AssetFolder(folder_of(tmp_path, there)).read(name).decode() == found


@pytest.mark.parametrize(
    ("there", "name"),
    [
        (["m/t/a.png"], "a.png"),
        (["t/a.png", "m/x"], "../t/a.png"),
        (["m/.a/a.png"], ".a/a.png"),
        (["m/.png"], ".png"),
        (["m/x"], "a.png"),
        (["m/x"], "."),
        (["m/x"], ""),
    ],
)
def test_no_other_file_is_read(there, name, tmp_path):
    with pytest.raises((ValueError, OSError)):
        AssetFolder(folder_of(tmp_path, there)).read(name)


@pytest.mark.parametrize(
    ("there", "name", "found"),
    [
        (["t/a.png", "m/x"], "../t/a.png", "t/a.png"),
        (["t/a.png", "m/x"], "a.png", "t/a.png"),
        (["a/a.png", "t/b/a.png", "m/x"], "B/a.png", "t/b/a.png"),
    ],
)
def test_in_the_folder_of_an_upload(there, name, found, tmp_path):
    assert AssetFolder(folder_of(tmp_path, there), tmp_path).read(name).decode() == found
    (tmp_path / "a.png").symlink_to(__file__)
    with pytest.raises(ValueError, match="outside the folder"):
        AssetFolder(tmp_path / "m" / "a.obj", tmp_path / "m").read("../a.png")
