"""Test the files for download: shapes, rigs, animations, the edit and the field."""

from pathlib import Path

import numpy as np
import pytest
from mesh_files import header_and_data

import dfd
from dfd.app.session.exports import Kind, export
from dfd.common.files import file_stem
from dfd.editing.deformer import Deformer
from dfd.posing.transforms import Transform


@pytest.mark.parametrize("kind", ["glb", "obj", "ply", "stl"])
def test_an_export_is_the_kernels_shape(kind: Kind, deformer: Deformer, tmp_path: Path) -> None:
    deformer.add(5, translation=(0, -0.3, 0.1), rotation=(0, 20, 0), scale=(1, 2, 1), pivot=(0, 0.5, 0))
    deformer.fix(900)
    path, _ = export(deformer, kind, "my \"chair\"; rm -rf '$HOME'.glb", tmp_path)
    assert path == tmp_path / f"my_chair_rm_-rf_HOME_edited.{kind}"
    made = dfd.load(path)
    atol = 1e-5 if kind == "stl" else 2e-6
    np.testing.assert_allclose(made.vertices[made.faces], deformer.vertices[deformer.mesh.faces], atol=atol)


def test_names_are_those_of_files_and_lead_nowhere() -> None:
    assert file_stem("../../chair.glb") == "chair"
    assert file_stem("é.obj") == "é"
    assert file_stem("/") == "mesh"


def test_rigs_targets_weights_edit_and_field(deformer: Deformer, tmp_path: Path) -> None:
    deformer.add(5, translation=(0, -0.3, 0.1), bend=30)
    rig, said = export(deformer, "rig", "chair.glb", tmp_path)
    assert "a skin has no bends and twists" in said
    assert "skins" in header_and_data(rig)[0]
    morph, _ = export(deformer, "morph", "chair.glb", tmp_path)
    assert b'"targets"' in morph.read_bytes()
    with np.load(export(deformer, "weights", "chair.glb", tmp_path)[0]) as arrays:
        assert arrays["weights"].shape[0] == len(deformer.mesh.vertices)
    edit, _ = export(deformer, "edit", "chair.glb", tmp_path)
    assert Deformer.load(edit, deformer.mesh, deformer.field).edit == deformer.edit
    field, _ = export(deformer, "field", "chair.glb", tmp_path)
    np.testing.assert_array_equal(dfd.Field.load(field)([[0, 0, 0]]), deformer.field([[0, 0, 0]]))


def test_key_poses_become_an_animation(deformer: Deformer, tmp_path: Path) -> None:
    handle = deformer.add(5)
    deformer.add(40, translation=(0.1, 0, 0))
    poses = [dfd.KeyPose(0, {}, "a"), dfd.KeyPose(2, {handle: Transform((0, 0.5, 0))}, "b")]
    deformer.set_poses(poses)
    path, _ = export(deformer, "animation", "chair.glb", tmp_path)
    header = header_and_data(path)[0]
    inputs = {sampler["input"] for sampler in header["animations"][0]["samplers"]}
    assert [header["accessors"][each]["max"] for each in inputs] == [[2.0]]
    for wrong, message in ((poses[:1], "^Store at least two poses"), ([poses[0]] * 2, "one after the other in time")):
        deformer.set_poses(wrong)
        with pytest.raises(ValueError, match=message):
            export(deformer, "animation", "chair.glb", tmp_path)
