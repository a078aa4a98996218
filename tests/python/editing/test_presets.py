"""Test that all interfaces use the same presets, and that "paper" agrees with the slow reference of the equations."""

import importlib.util
import json
import re
import sys
import warnings
from dataclasses import fields
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import get_args

import numpy as np
import pytest
import reference
from made_field import field_of

import dfd
from dfd.cli.deform import deform
from dfd.common.preset import Preset
from dfd.distillation.settings import DistillSettings
from dfd.editing.controls import CONTROLS, Controls, controls_of
from dfd.editing.edit import Handle
from dfd.editing.edit_file import edit_schema, from_document
from dfd.editing.points import place_on
from dfd.editing.presets import PARTLESS_REACH, PRESETS
from dfd.editing.transfer import transfer
from dfd.editing.weights import handle_features
from dfd.symmetry.plane import SymmetryPlane

ROOT = Path(__file__).resolve().parents[3]
NAMES = get_args(Preset)
each_preset = pytest.mark.parametrize("preset", NAMES)


# --- the interfaces


@each_preset
def test_a_session_starts_with_its_preset(mesh, field, features, preset):
    session = dfd.Deformer(mesh, field, preset=preset, features=features)
    controls = session.handle(session.add(5)).controls
    assert session.preset == preset
    assert session.edit.rules == PRESETS[preset]
    assert {name: getattr(controls, name) for name in PRESETS[preset].handle} == PRESETS[preset].handle
    session.set_symmetry("x")
    assert session.symmetry.band == pytest.approx(PRESETS[preset].band * max(mesh.extents))


@each_preset
def test_an_edit_file_means_its_preset_by_what_it_leaves_out(mesh, preset):
    document = {"format": "dfd-edit", "version": 1, "preset": preset, "handles": [{"vertex": 5}], "symmetry": "x"}
    edit = from_document(document, mesh)
    assert edit.handles == (Handle(1, place_on(mesh, 5), controls=controls_of(preset)),)
    assert edit.preset == preset
    assert edit.symmetry.band == pytest.approx(PRESETS[preset].band * max(mesh.extents))
    spelled = from_document({**document, "symmetry": {"normal": [1, 0, 0], "offset": 0}}, mesh)
    assert spelled.symmetry.band == edit.symmetry.band
    del document["preset"]
    assert (from_document(document, mesh) == edit) == (preset == "default")


def test_values_made_of_nothing_are_those_of_the_default():
    assert Controls() == controls_of("default")
    handle = edit_schema()["$defs"]["Handle"]["properties"]
    assert {name: handle[name]["default"] for name in PRESETS["default"].handle} == PRESETS["default"].handle


def test_the_command_line_says_the_defaults_in_its_help():
    for name, default in PRESETS["default"].handle.items():
        paper = PRESETS["paper"].handle[name]
        said = f"{default}; paper: {paper:g}" if isinstance(paper, float) else f"{default}; paper: {paper}"
        assert deform.__annotations__[name].__metadata__[0].show_default == said


def test_blender_s_handles_start_with_them(monkeypatch):
    made = lambda **options: SimpleNamespace(**options)  # noqa: E731
    bpy = ModuleType("bpy")
    kinds = ("BoolProperty", "FloatProperty", "EnumProperty", "IntProperty", "StringProperty", "CollectionProperty")
    bpy.props = SimpleNamespace(**dict.fromkeys(kinds, made))
    bpy.types = SimpleNamespace(PropertyGroup=object, AddonPreferences=object)
    monkeypatch.setitem(sys.modules, "bpy", bpy)
    folder = ROOT / "python" / "blender"
    package = ModuleType("in_blender")
    package.__path__ = [str(folder)]
    monkeypatch.setitem(sys.modules, "in_blender", package)
    monkeypatch.setitem(sys.modules, "in_blender.vertex_groups", SimpleNamespace(refresh=None, paused=None))
    spec = importlib.util.spec_from_file_location("in_blender.properties", folder / "properties.py")
    properties = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(properties)
    said = properties.PROPERTIES
    assert {name for name, about in CONTROLS.items() if about.affects == "weights"} <= set(said)
    assert said["reach_part"].default == (PRESETS["default"].reach == "part")
    assert (said["reach"].default, said["falloff"].default) == (PARTLESS_REACH, PRESETS["default"].falloff)
    assert said["falloff"].default in {name for name, *_ in said["falloff"].items}


def test_the_documentation_has_the_same_table():
    text = (ROOT / "docs" / "reference" / "paper.md").read_text().partition("<!-- generated")[0]
    rows = re.findall(r"^\| `(\w+)` \| (\S+) \| (\S+) \|", text, re.MULTILINE)
    assert [tuple(map(str, row)) for row in rows] == [
        (name, str(getattr(PRESETS["default"], name)), str(getattr(PRESETS["paper"], name)))
        for name in PRESETS["default"].__dataclass_fields__
    ]


def test_every_interface_has_the_same_controls():
    names = [each.name for each in fields(Controls)]
    assert list(CONTROLS) == names
    properties = edit_schema()["$defs"]["Handle"]["properties"]
    assert {name: properties[name]["description"] for name in names} == {n: CONTROLS[n].text for n in names}
    assert set(names) <= set(deform.__annotations__)


# --- the preset "paper"


@pytest.mark.parametrize("symmetry", [None, "x"])
def test_the_paper_is_its_equations(mesh, field, features, symmetry):
    session = dfd.Deformer(mesh, field, preset="paper", features=features)
    places = [5, 900, int(mesh.vertices[:, 0].argmax())]
    session.add(places[0], translation=(0.1, 0.2, 0), rotation=(0, 30, 0), locality=1.5)
    session.add(places[1], scale=(1, 1.5, 1), translation=(0, 0, 0.1), locality=0.5)
    session.add(places[2], rotation=(20, 0, 10))
    session.fix(1500)
    session.set_default(rotation=(0, 5, 0))
    session.set_symmetry(symmetry)
    weights = reference.bind(
        features,
        places,
        fixed=[1500],
        geodesic=dfd.Geodesics(mesh, bridges=False, sampled=False).distances(places),
        locality=[1.5, 0.5, 0.0],
    )
    assert weights.sum(axis=1).max() > 1.1
    np.testing.assert_allclose(session.weights, weights, atol=1e-5)
    wanted = reference.pose(
        mesh.vertices,
        weights,
        session.transforms,
        default=session.default.matrix(tuple(mesh.bounds.mean(axis=0))),
        symmetry=session.symmetry,
        handles=mesh.vertices[places],
    )
    np.testing.assert_allclose(session.vertices, wanted, atol=1e-5)


def test_planes_of_auto_are_those_across_axes_within_epsilon(mesh, field, features, monkeypatch):
    asked = []

    def found(field, mesh, **how):
        asked.append(how)
        return [SymmetryPlane((1.0, 0.0, 0.0), 0.0, 0.05, band=0.3)]

    monkeypatch.setattr("dfd.editing.edit.symmetry_planes", found)
    session = dfd.Deformer(mesh, field, preset="paper", features=features)
    session.set_symmetry("auto")
    assert session.symmetry.band == 0
    session.set_symmetry("auto", band=0.1, candidates="any", threshold="relative")
    assert session.symmetry.band == 0.1
    assert asked == [{"candidates": "axes", "threshold": 0.1}, {"candidates": "any", "threshold": "relative"}]
    with pytest.raises(ValueError, match="and `threshold` can only be given if `plane` is 'auto', got 'x'"):
        session.set_symmetry("x", threshold=0.1)


def test_a_preset_decides_about_features_whatever_was_read_before(mesh, field, monkeypatch, tmp_path):
    """Without this rule, a session and its saved file would differ by the error of compact features."""
    monkeypatch.setattr(handle_features, "MOST_EXACT", 100)
    session = dfd.Deformer(mesh, field)
    session.add(5, translation=(0, 0.2, 0), reach=0.8)
    before = session.vertices
    assert isinstance(session.features, dfd.CompactFeatures)
    session.preset = "paper"
    paper = session.vertices
    assert isinstance(session.features, np.ndarray)
    session.save(tmp_path / "edit.json")
    np.testing.assert_array_equal(dfd.Deformer.load(tmp_path / "edit.json", mesh, field).vertices, paper)
    session.undo()
    assert isinstance(session.features, dfd.CompactFeatures)
    np.testing.assert_array_equal(session.vertices, before)
    session.redo()
    np.testing.assert_array_equal(session.vertices, paper)
    other = dfd.Deformer(mesh, field)
    other.apply(session.edit)
    np.testing.assert_array_equal(other.vertices, paper)


# --- a session and its file


def test_a_preset_is_one_step_that_leaves_the_rest(deformer, mesh):
    held = deformer.add(5, translation=(0, 0.2, 0), reach=0.4, locality=1.0, name="leg")
    deformer.fix(900)
    deformer.set_symmetry("x")
    before, shape = deformer.edit, deformer.vertices
    deformer.preset = "paper"
    controls = deformer.handle(held).controls
    assert (controls.reach, controls.falloff, controls.counterparts, controls.locality) == (
        1.0,
        "linear",
        "shared_pivot",
        1.0,
    )
    assert deformer.symmetry.band == 0.0
    assert (deformer.fixed, deformer.handle(held).name) == (before.fixed, "leg")
    assert np.abs(deformer.vertices - shape).max() > 1e-3
    assert deformer.handle(deformer.add(7)).controls.reach == 1.0
    deformer.undo()
    deformer.undo()
    assert deformer.edit == before
    deformer.redo()
    assert deformer.preset == "paper"


def test_the_preset_and_what_was_set_apart_stay_in_the_file_and_on_another_shape(mesh, field, features, tmp_path):
    session = dfd.Deformer(mesh, field, preset="paper", features=features)
    session.add(5, reach=0.5, locality=1.0)
    session.save(tmp_path / "edit.json")
    assert json.loads((tmp_path / "edit.json").read_text())["preset"] == "paper"
    again = dfd.Deformer.load(tmp_path / "edit.json", mesh, field, features=features)
    assert again.edit == session.edit
    assert again.handle(again.add(7)).controls == controls_of("paper")
    carried = transfer(session.edit, mesh, field, mesh, field).edit
    assert carried.preset == "paper"


@pytest.mark.parametrize("start", [lambda d: dfd.Deformer(d.mesh, d.field, preset="old"),
                                   lambda d: setattr(d, "preset", "old")])  # fmt: skip
def test_an_unknown_preset_is_refused(deformer, start):
    with pytest.raises(ValueError, match="`preset` must be one of default, paper, got 'old'"):
        start(deformer)


def test_the_papers_session_on_another_field_warns_and_names_what_differs(mesh, field):
    made = DistillSettings(preset="paper").as_dict()
    with warnings.catch_warnings(action="error"):
        dfd.Deformer(mesh, field.with_settings(made), preset="paper")
        dfd.Deformer(mesh, field.with_settings(made | {"octaves": 5}))
    other = field.with_settings(made | {"octaves": 5, "simplify_to": 20_000})
    with pytest.warns(UserWarning, match="`preset` is 'paper', but the field .* other settings: .*octaves"):
        session = dfd.Deformer(mesh, other, preset="paper")
    session.preset = "default"
    with pytest.warns(UserWarning, match="other settings: (octaves, simplify_to|simplify_to, octaves); distill"):
        session.preset = "paper"


# --- the variant of "paper" with mirrored pictures


def variant(mirrored, preset="paper", **other):
    """Return a session on a field of the preset "paper", with mirrored pictures or without."""
    mesh = dfd.samples.chair(4_000).mesh
    settings = {**DistillSettings(preset="paper", mirrored=mirrored).as_dict(), **other}
    return dfd.Deformer(mesh, field_of(mesh).with_settings(settings), preset=preset)


@pytest.mark.parametrize("mirrored", [False, True])
def test_both_variants_are_the_preset(mirrored):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        variant(mirrored)
    with pytest.warns(UserWarning, match="other settings: octaves"):
        variant(mirrored, octaves=5)


@pytest.mark.parametrize(
    ("mirrored", "preset", "advised"), [(False, "paper", True), (True, "paper", False), (False, "default", False)]
)
def test_an_error_advises_mirrored_pictures_where_they_help(mirrored, preset, advised):
    with pytest.raises(ValueError, match="no plane has two sides that look alike") as raised:
        variant(mirrored, preset).set_symmetry("auto", threshold=0.0)
    assert ("mirrored=True" in str(raised.value)) == advised
