"""`dfd distill`."""

import json
from pathlib import Path
from unittest import mock

import numpy as np
import pytest
from command_runs import failed, worked
from made_field import same
from tiny_encoder import save_tiny_encoder

import dfd
from dfd.field.field import Field


def test_distill_hands_on_what_is_given(run, folder):
    field = Field.load(folder / "chair.field.safetensors")
    np.save("rows.npy", np.eye(3))
    options = ("--encoder", "clip", "--device", "cpu", "--features", "rows.npy", "--no-cache", "--preset", "paper")
    settings = ("--views", 6, "--framing", "paper", "--no-mirrored", "--smoothing", 0.1, "--learning-rate", 0.004)
    with mock.patch("dfd.distill", return_value=field) as distill:
        result = run("distill", "MESH", "-o", "out.safetensors", *options, *settings)
        assert worked(run("distill", "MESH", "-o", "other.safetensors"))
    assert worked(result)
    ((mesh, encoder), given), (_, plain) = distill.call_args_list
    assert (len(mesh.vertices), encoder) == (2004, "clip")
    np.testing.assert_array_equal(given.pop("features"), np.eye(3))
    del given["progress"], plain["progress"]
    assert given == {
        "device": "cpu",
        "cache": False,
        "preset": "paper",
        "views": 6,
        "framing": "paper",
        "mirrored": False,
        "smoothing": 0.1,
        "learning_rate": 0.004,
    }
    assert plain == {"features": None, "device": None, "cache": True}
    assert Field.load("out.safetensors").settings == field.settings
    assert "out.safetensors: a field of 16 dimensions" in result.stderr


def test_distill_copies_what_the_cache_has(run, tmp_path):
    save_tiny_encoder(tmp_path / "tiny")
    command = ("distill", "MESH", "--encoder", "./tiny", "--views", 2, "--resolution", 32, "--steps", 3, "-o")
    told = {name: run(*command, f"{name}.safetensors").stderr for name in ("first", "again")}
    assert {name: "from the cache" in text for name, text in told.items()} == {"first": False, "again": True}
    assert same(*(Field.load(f"{name}.safetensors") for name in told))
    assert "from the cache" not in run(*command, "anew.safetensors", "--no-cache").stderr


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("-o", "out.safetensors", "--supervision", "all"), "`--supervision` must be one of barycentric, vertex"),
        (("-o", "out.safetensors", "--steps", 0), "`--steps` must be a whole number of at least 1, got 0"),
        (("-o", "out.safetensors", "--views", "many"), "--views"),
        (("-o", "out.field"), "`--output` must end in .safetensors, got out.field"),
        (("-o", "no/out.safetensors"), "`--output`: the folder no does not exist"),
        ((), "Missing option '--output'"),
    ],
)
def test_distill_names_what_is_wrong(run, tmp_path, arguments, message):
    assert failed(run("distill", "MESH", *arguments), message)
    assert list(tmp_path.iterdir()) == []


def distilled_with(run, folder, *more):
    """What `--features` hands on from rows.npy, and the result of the command."""
    field = Field.load(folder / "chair.field.safetensors")
    with mock.patch("dfd.distill", return_value=field) as distill:
        return run("distill", "MESH", "-o", "out.safetensors", "--features", *more), distill


def write_described(chair, **changes):
    """MeshFM's files of the chair."""
    np.save("rows.npy", np.ones((len(chair.vertices), 4), np.float16))
    said = {"mode": "vertex", "num_vertices": len(chair.vertices), "feature_shape": [len(chair.vertices), 4]}
    Path("rows.json").write_text(json.dumps({**said, "dtype": "float16", **changes}))


def test_described_features_of_the_vertices_are_taken(run, folder, chair):
    write_described(chair)
    chair.save("rows_pca.ply")
    result, distill = distilled_with(run, folder, "rows.npy")
    assert worked(result)
    assert distill.call_args.kwargs["features"].shape == (2004, 4)
    Path("rows.json").write_text('{"of": "another program"}')
    assert worked(distilled_with(run, folder, "rows.npy")[0])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"mode": "surface"}, "rows.json says mode 'surface': extract them with `--mode vertex`"),
        ({"feature_shape": [3, 4]}, "rows.json describes, of shape [3, 4], got [2004, 4]"),
        (
            {"num_vertices": 12024},
            "has 2004 vertices, but rows.json says 12024; GLB, glTF and STL files have no one list",
        ),
    ],
)
def test_features_that_are_described_otherwise_are_refused(run, folder, chair, changes, message):
    write_described(chair, **changes)
    result, distill = distilled_with(run, folder, "rows.npy")
    assert failed(result, message)
    distill.assert_not_called()


def test_a_description_that_is_cut_short_is_refused(run, folder, chair):
    write_described(chair)
    Path("rows.json").write_text('{"mode": ')
    assert failed(distilled_with(run, folder, "rows.npy")[0], "rows.json is not JSON")


def test_the_order_of_the_vertices_is_that_of_the_file_beside(run, folder, chair):
    rows = "part_feat_chair_0_batch.npy"  # PartField's, which moves and scales the shape
    np.save(rows, np.ones((2004, 4), np.float32))
    moved = (chair.vertices - 3) * 0.7
    dfd.Mesh(moved, chair.faces).save("feat_pca_chair_0.ply")
    assert worked(distilled_with(run, folder, rows)[0])
    swapped = moved.copy()
    swapped[[5, 900]] = swapped[[900, 5]]
    dfd.Mesh(swapped, chair.faces).save("feat_pca_chair_0.ply")
    message = "in the order of the mesh's vertices, but vertex 5 lies elsewhere in feat_pca_chair_0.ply"
    assert failed(distilled_with(run, folder, rows)[0], message)
    dfd.Mesh(np.concatenate([moved, moved[:1] + 1]), chair.faces).save("feat_pca_chair_0.ply")
    assert failed(distilled_with(run, folder, rows)[0], "feat_pca_chair_0.ply beside them has")
