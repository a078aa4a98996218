"""Test `distill` with the default encoder, from a mesh file to moved vertices."""

import inspect
import re

import numpy as np
import pytest

import dfd
from dfd.samples import Sample

# Small settings with which the features still separate parts.
SMALL = {"views": 12, "resolution": 280, "steps": 150, "batch": 1024, "progress": False, "cache": False}


@pytest.fixture(scope="module", autouse=True)
def _isolated(tmp_path_factory):
    """Disable the hub, and use an empty cache instead of the user's."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HF_HUB_OFFLINE", "1")
        patch.setenv("DFD_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="module", params=[pytest.param("chair", marks=pytest.mark.slow), "quadruped"])
def shape(request, tmp_path_factory):
    """Return a sample, the mesh loaded from its file, and the field distilled from this mesh."""
    sample: Sample = getattr(dfd.samples, request.param)(6000)
    path = tmp_path_factory.mktemp("mesh") / f"{request.param}.glb"
    sample.mesh.save(path)
    mesh = dfd.load(path)
    assert len(mesh.vertices) == len(sample.mesh.vertices)
    return sample, mesh, dfd.distill(mesh, **SMALL)


def lowest(sample, part, instance):
    among = sample.vertices_of(part, instance)
    return int(among[np.argmin(sample.mesh.vertices[among, 1])])


def test_a_handle_on_a_foot_moves_the_other_feet(shape):
    sample, mesh, field = shape
    leg = "hoof" if "hoof" in sample.parts else "leg"
    foot = lowest(sample, leg, 0)
    weights = dfd.bind(field.features(mesh), [foot])[:, 0]
    others = np.concatenate([sample.vertices_of(leg, other) for other in (1, 2, 3)])
    legs = [part for part in ("leg", "hoof") if part in sample.parts]
    rest = np.setdiff1d(np.arange(len(weights)), np.concatenate([sample.vertices_of(part) for part in legs]))
    assert weights[others].mean() > 1.5 * weights[rest].mean()
    assert weights[foot] == 1
    # A pull on one foot moves it and its mirror image down, farther than the rest of the body; at these few steps, the
    # features of front and hind feet may differ.
    session = dfd.Deformer(mesh, field)
    session.add(foot, translation=(0, -0.3, 0))
    moved = mesh.vertices[:, 1] - session.vertices[:, 1]
    feet = [lowest(sample, leg, instance) for instance in range(4)]
    assert moved[feet[:2]].min() > 1.5 * moved[rest].mean()


def test_only_the_true_mirror_plane_is_found(shape):
    _, mesh, field = shape
    (plane,) = dfd.symmetry_planes(mesh, field)
    assert np.abs(plane.normal).tolist() == [1, 0, 0]
    assert plane.offset == pytest.approx(0, abs=1e-6)


def test_copies_and_the_order_of_faces_change_no_feature():
    mesh, random = dfd.samples.quadruped(4000).mesh, np.random.default_rng(0)
    some = mesh.faces[: len(mesh.faces) // 3]
    faces = np.concatenate([random.permutation(mesh.faces), some[:, [1, 2, 0]], some[::2, [2, 1, 0]]])
    quick = {**SMALL, "views": 4, "resolution": 112, "steps": 5}
    wanted, found = (dfd.distill(dfd.Mesh(mesh.vertices, of), **quick) for of in (mesh.faces, faces))
    np.testing.assert_array_equal(found.features(mesh), wanted.features(mesh))


@pytest.mark.parametrize(
    "setting", [{"views": 0}, {"resolution": 5000}, {"framing": "close"}, {"simplify_to": 3}, {"supervision": "pixel"}]
)
def test_a_bad_setting_is_refused_before_anything_is_loaded(monkeypatch, setting):
    def loaded(*_, **__):
        raise AssertionError("the encoder was loaded")

    monkeypatch.setattr("dfd.encoders.encode.load_encoder", loaded)
    with pytest.raises(ValueError, match=f"distill: `{next(iter(setting))}` must be"):
        dfd.distill(dfd.samples.chair(4000).mesh, **{**SMALL, **setting})


def test_unknown_settings_are_refused_and_all_arguments_are_documented():
    own = inspect.signature(dfd.distill).parameters
    explained = re.findall(r"^    ([a-z_]+(?:, [a-z_]+)*)$", dfd.distill.__doc__ or "", re.MULTILINE)
    assert {*own} == {name for line in explained for name in line.split(", ")}
    with pytest.raises(TypeError, match=r"distill\(\) got an unexpected keyword argument 'view'"):
        dfd.distill(dfd.samples.chair(4000).mesh, view=3)
