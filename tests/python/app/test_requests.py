"""Test the requests of a page on the real server."""

import base64
import json
import threading
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from app_page import Page

import dfd
from dfd.app.session import preparation
from dfd.app.session.parts import WHOLE, ShapeParts, _distinct
from dfd.editing.deformer import Deformer
from dfd.editing.presets import PRESETS
from dfd.field.geometry_field import geometry_field
from dfd.segmentation.parts import Parts
from dfd.symmetry.search import symmetry_planes

UNBENT = {"bend": [0, 0, 0], "twist": 0, "joint": None}
REST = {"rotation": [0, 0, 0], "scale": [1, 1, 1], "pivot": None, "axes": None}


def test_a_shape_is_shown_and_edited(page: Page, deformer: Deformer) -> None:
    mesh = page.last("mesh")
    assert (mesh["name"], mesh["vertices"]) == ("chair.glb", len(deformer.mesh.vertices))
    handle = page.hold(5, translation=[0, -0.3, 0])
    page.ask("change", handle=handle, controls={"name": "foot"})
    state = page.last("state")
    assert state["handles"][0]["name"] == "foot"
    assert page.last("columns")["columns"] == [each["column"] for each in state["handles"][0]["columns"]]
    assert " moved by 0.3" in page.until(lambda message: message["type"] == "report")["text"]
    deformer.add(5, translation=(0, -0.3, 0))
    answer = page.ask("compute")
    np.testing.assert_allclose(
        answer["arrays"]["positions"] + np.array(mesh["center"]), deformer.vertices, atol=1e-6 * mesh["diagonal"]
    )

    heard = len(page.heard)
    for step in range(5):
        page.ask("move", handle=handle, transform={"translation": [0, -0.4 - 0.02 * step, 0]}, merge=step > 0)
    sizes = [len(json.dumps(message)) for message in page.heard[heard + 3 :]]
    assert max(sizes) < 2000, "frames of a drag are small"
    page.ask("move", handle=handle, transform={"translation": [0, -0.5, 0]}, merge=True, settle=True)
    assert page.last("state")["handles"][0]["translation"] == [0, -0.5, 0]
    page.ask("go", by=-1)
    assert page.last("state")["handles"][0]["translation"] == [0, -0.3, 0]
    page.ask("go", by=1)
    page.ask("fix", at=900)
    page.ask("set_symmetry", plane="x")
    assert page.last("state")["symmetry"]["normal"] == [1, 0, 0]
    page.ask("release", index=0)
    page.ask("reset")
    page.until(lambda message: message["type"] == "report" and "Nothing moved" in message["text"])
    page.ask("remove", handle=handle)
    assert page.last("state")["handles"] == []
    assert page.last("state")["step"]


def test_a_part_is_held_resized_combined_and_what_a_handle_is_limited_to(page: Page, deformer: Deformer) -> None:
    count = len(deformer.mesh.vertices)
    vertex = next(each for each in range(0, count, 20) if deformer.part(each, level=1) != deformer.part(each))
    part, larger = (deformer.part(vertex, level=level).indices for level in (0, 1))

    def held() -> int:
        return page.last("state")["handles"][0]["region"]

    def level() -> int:
        return page.last("state")["handles"][0]["level"]

    handle = page.hold(vertex)
    heat = page.ask("take_part", handle=handle, how="larger", preview=True)
    assert heat["type"] == "heat"
    assert level() == 0, "a preview changes nothing"
    page.ask("take_part", handle=handle, how="larger")
    assert level() == 1
    deformer.add(vertex, level=1)
    np.testing.assert_allclose(heat["arrays"]["values"] / 65535, deformer.weights[:, 0], atol=1e-4)
    for _ in range(20):
        answer = page.ask("take_part", handle=handle, how="larger")
    assert "no larger part" in answer["message"]
    assert deformer.part(vertex, level=level()) == deformer.part(vertex, level=20)
    top = level()
    page.ask("change", handle=handle, controls={"level": 1000, "reach": 0.5})
    page.ask("take_part", handle=handle, how="smaller")
    assert level() == top - 1, "levels beyond the largest part stand for it"
    assert page.last("state")["handles"][0]["reach_by"] == "part"
    page.ask("take_part", vertex=vertex, handle=handle, how="add")
    assert (level(), held()) == (0, len(deformer.part(vertex, level=top - 1).indices))
    page.ask("go", by=-1)
    while level() > 0:
        page.ask("take_part", handle=handle, how="smaller")

    other = int(np.setdiff1d(np.arange(count), part)[0])
    added = np.union1d(part, deformer.part(other).indices)
    page.ask("take_part", vertex=other, handle=handle, how="add")
    assert held() == len(added)
    page.ask("take_part", vertex=vertex, handle=handle, how="remove")
    assert held() == len(np.setdiff1d(added, part))
    page.ask("go", by=-1)
    page.ask("go", by=-1)
    assert "remove the handle" in page.ask("take_part", vertex=vertex, handle=handle, how="remove")["message"]

    page.ask("change", handle=handle, controls={"mask": "part"})
    limited = page.last("state")["handles"][0]
    assert (limited["mask"], limited["mask_part"]) == (len(part), True)
    page.ask("take_part", handle=handle, how="larger")
    grown = page.last("state")["handles"][0]
    assert (grown["mask"], grown["mask_part"]) == (len(larger), True), "the limit goes along"
    page.ask("change", handle=handle, controls={"mask": "everywhere", "reach": "part"})
    assert (page.last("state")["handles"][0]["mask_part"], page.last("state")["handles"][0]["reach_by"]) == (
        False,
        "part",
    )
    mask = base64.b64encode(np.packbits(np.arange(count) < 7, bitorder="little").tobytes()).decode()
    page.ask("change", handle=handle, controls={"mask": {"mask": mask}})
    painted = page.last("state")["handles"][0]
    assert (painted["mask"], painted["mask_part"]) == (7, False)

    point = page.hold(other)
    page.ask("change", handle=point, controls={"mask": "part"})
    assert page.last("state")["handles"][1]["mask_part"]
    page.ask("remove", handle=point)


def test_levels_end_with_the_smallest_and_the_largest_step(deformer: Deformer) -> None:
    parts = ShapeParts(deformer)
    levels = [step.level for step in parts.ladder(100)]
    lowest, highest = levels[0], levels[-1]
    assert lowest < highest
    assert parts.next_level(100, levels[-2], 1) == highest
    assert parts.next_level(100, highest + 9, -1) == levels[-2], "levels beyond the end stand for it"
    with pytest.raises(ValueError, match="no larger part"):
        parts.next_level(100, highest, 1)
    with pytest.raises(ValueError, match="no smaller part"):
        parts.next_level(100, lowest - 3, -1)


def test_steps_have_the_names_of_scene_parts(tmp_path: Path) -> None:
    """The file has three scene parts: two spheres, a bar and a cone."""
    moved = trimesh.transformations.translation_matrix
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.8)
    spheres = [ball.copy().apply_transform(moved((x, 0, 0))) for x in (-2, 2)]
    bar = trimesh.creation.box((1, 3, 0.6), moved((0, 0, 0))).subdivide().subdivide().subdivide()
    cone = trimesh.creation.cone(1.2, 5, sections=64, transform=moved((0, 4, 0))).subdivide().subdivide()
    scene = trimesh.Scene()
    for name, mesh in (("spheres", spheres), ("bar", [bar]), ("cone", [cone])):
        scene.add_geometry(trimesh.util.concatenate(mesh), node_name=name)
    scene.export(tmp_path / "scene.glb")
    mesh = dfd.load(tmp_path / "scene.glb")
    deformer = Deformer(mesh, geometry_field(mesh))
    parts, named = ShapeParts(deformer), set[str]()
    for vertex in range(0, len(mesh.vertices), 150):
        steps = parts.ladder(vertex)
        assert all(one.level < other.level for one, other in pairwise(steps)), "levels with one surface are one step"
        for step in steps:
            name = step.text.split(",")[0]
            if name in mesh.part_names:
                held = [
                    deformer.bound.parts.part(vertex, step.level, follow=follow).vertices for follow in ("all", "none")
                ]
                assert mesh.part_vertices(name).tolist() in [each.tolist() for each in held]
                named.add(name)
    assert named == {"spheres", "bar", "cone"}


def test_a_mirror_plane_that_is_found_is_on_until_it_is_switched_off(new_page: Page) -> None:
    state = new_page.last("state")
    assert state["symmetry"]["normal"] == state["planes"][0]["normal"]
    new_page.ask("add", at=5)
    new_page.ask("clear")
    assert new_page.last("state")["symmetry"]
    new_page.ask("set_symmetry", plane=None)
    assert new_page.last("state")["symmetry"] is None


def test_a_drag_with_the_wheel_is_one_step(page: Page) -> None:
    handle = page.hold(5)
    for step in range(1, 4):
        page.ask("move", handle=handle, transform={"translation": [0, 0.1 * step, 0]}, merge=step > 1)
    last = {"translation": [0, 0.4, 0]}
    page.ask("move", handle=handle, transform=last, controls={"reach": 0.6}, merge=True, settle=True)
    state = page.last("state")["handles"][0]
    assert (state["translation"], state["reach"]) == ([0, 0.4, 0], 0.6)
    page.ask("go", by=-1)
    state = page.last("state")["handles"][0]
    assert state["translation"] == [0, 0, 0]
    assert state["reach"] != 0.6
    page.ask("go", by=1)
    assert page.last("state")["handles"][0]["reach"] == 0.6
    page.ask("go", by=-1)
    page.ask("go", by=-1)
    assert page.last("state")["handles"] == []


def test_a_drag_sends_weights_again_only_if_the_blend_band_widens(page: Page) -> None:
    handle, heard = page.hold(5), []
    size = page.last("mesh")["diagonal"]
    for share in (0.0001, 0.0002, 0.3, 0.31):
        before = len(page.heard)
        page.ask("move", handle=handle, transform={"translation": [share * size, 0, 0]}, merge=bool(heard))
        heard.append("state" in [message["type"] for message in page.heard[before:]])
    assert heard == [True, False, True, False]


def test_a_drag_that_cannot_end_as_asked_stays_as_it_was(page: Page) -> None:
    handle = page.hold(5)
    page.ask("move", handle=handle, transform={"translation": [0, 0.1, 0]})
    wrong = page.ask(
        "move",
        handle=handle,
        transform={"translation": [0, 0.2, 0]},
        controls={"falloff": "none"},
        merge=True,
        settle=True,
    )
    assert wrong["type"] == "failure"
    page.ask("go", by=-1)
    page.ask("go", by=1)
    assert page.last("state")["handles"][0]["translation"] == [0, 0.1, 0]


def test_a_pose_is_one_step(page: Page) -> None:
    one = page.hold(5)
    other = page.hold(300)
    page.ask("pose", transforms=[{"handle": h, "translation": [h, 0, 0], **REST} for h in (one, other)])
    assert [each["translation"][0] for each in page.last("state")["handles"]] == [one, other]
    wrong = [{"handle": h, "translation": [0, 0, 0], **REST} for h in (one, 99)]
    assert page.ask("pose", transforms=wrong)["type"] == "failure"
    page.ask("go", by=-1)
    assert [each["translation"][0] for each in page.last("state")["handles"]] == [0, 0]


def test_radius_and_limits_are_set_and_taken_away(page: Page, deformer: Deformer) -> None:
    handle = page.hold(5)
    count = len(deformer.mesh.vertices)
    inside = np.zeros(count, bool)
    inside[: count // 2] = True
    mask = base64.b64encode(np.packbits(inside, bitorder="little").tobytes()).decode()
    page.ask("change", handle=handle, controls={"radius": 0.3, "mask": {"mask": mask}})
    state = page.last("state")["handles"][0]
    assert (state["radius"], state["mask"]) == (0.3, count // 2)
    assert state["mask_feather"] == 0
    page.ask("change", handle=handle, controls={"mask_feather": 0.25})
    assert page.last("state")["handles"][0]["mask_feather"] == 0.25
    used = {each["column"] for each in page.last("state")["handles"][0]["columns"]}
    assert used >= set(page.last("columns")["columns"])
    assert page.ask("change", handle=handle, controls={"mask_feather": -1})["type"] == "failure"
    page.ask("change", handle=handle, controls={"locality": 0.0, "mask": "everywhere"})
    state = page.last("state")["handles"][0]
    assert (state["radius"], state["mask"]) == (None, 0)


def test_the_newest_probe_is_answered(page: Page) -> None:
    numbers = [page.say("probe", vertex=vertex) for vertex in range(30)]
    answer = page.until(lambda message: message["type"] == "heat" and message["id"] == numbers[-1])
    assert answer["arrays"]["values"][29] == 65535
    answered = [message["id"] for message in page.heard if message["type"] == "heat"]
    assert answered == sorted(answered)


def test_features_suggestions_and_poses(page: Page) -> None:
    colors = page.ask("features")["arrays"]["colors"]
    assert len(np.unique(colors[:, :3], axis=0)) > 100
    page.ask("suggest")
    suggestions = page.until(lambda each: each["type"] == "suggestions")["suggestions"]
    assert 1 <= len({each["vertex"] for each in suggestions}) == len(suggestions) <= 12
    pose = {
        "name": "one",
        "seconds": 1.5,
        "ease": True,
        "transforms": [{"handle": page.hold(5), "translation": [0, 1, 0], **REST, "pivot_at": None, **UNBENT}],
    }
    page.ask("set_poses", poses=[pose])
    assert page.last("state")["poses"] == [pose]
    page.ask("go", by=-1)
    assert page.last("state")["poses"] == []
    page.ask("go", by=1)
    page.ask("remove", handle=pose["transforms"][0]["handle"])
    assert page.last("state")["poses"] == [{**pose, "transforms": []}]


def test_an_export_is_given_once(page: Page, deformer: Deformer, tmp_path: Path) -> None:
    page.hold(5, translation=[0, -0.3, 0])
    answer = page.ask("export", format="glb")
    assert answer["name"] == "chair_edited.glb"
    with page.http() as http:
        response = http.get(answer["url"])
        assert 'filename="chair_edited.glb"' in response.headers["content-disposition"]
        assert http.get(answer["url"]).status_code == 404
    (tmp_path / "made.glb").write_bytes(response.content)
    deformer.add(5, translation=(0, -0.3, 0))
    np.testing.assert_allclose(dfd.load(tmp_path / "made.glb").vertices, deformer.vertices, atol=2e-6)


def test_a_pose_that_is_shown_is_computed_and_exported_and_the_edit_stays(
    page: Page, deformer: Deformer, tmp_path: Path
) -> None:
    handle = page.hold(5, translation=[0, -0.3, 0])
    page.ask("go", by=-1)
    page.ask("go", by=1)
    before = page.last("state")
    still = {"translation": [0, 0, 0], "rotation": [0, 0, 0], "scale": [1, 1, 1]}
    seen = [{**still, "handle": handle, "rotation": [0, 40, 0], "pivot": [0, 1, 0], "bend": [20, 0, 0]}]
    positions = page.ask("compute", transforms=seen)["arrays"]["positions"]
    with page.http() as http:
        (tmp_path / "made.glb").write_bytes(http.get(page.ask("export", format="glb", transforms=seen)["url"]).content)
    deformer.add(5, rotation=(0, 40, 0), pivot=(0, 1, 0), bend=(20, 0, 0))
    center = deformer.mesh.bounds.mean(axis=0)
    np.testing.assert_allclose(positions + center, deformer.vertices, atol=2e-6)
    np.testing.assert_allclose(dfd.load(tmp_path / "made.glb").vertices, deformer.vertices, atol=2e-6)
    refused = page.ask("compute", transforms=[{**still, "handle": 99}])
    assert refused["type"] == "failure"
    page.ask("go", by=-1)
    page.ask("go", by=1)
    after = page.last("state")
    kept = ("handles", "fixed", "steps", "symmetry")
    for state in (before, after):
        del state["handles"][0]["columns"]  # columns get new numbers
    assert [after[name] for name in kept] == [before[name] for name in kept]


def test_a_handle_turns_about_what_the_session_finds_and_bends_along_its_part(page: Page, deformer: Deformer) -> None:
    handle = page.hold(5)
    axis = page.ask("axis", handle=handle)
    own = deformer.add(5)
    deformer.move(own, rotation=(0, 20, 0))
    page.ask("move", handle=handle, transform={"rotation": [0, 20, 0], "pivot": "auto"}, settle=True)
    state = page.last("state")["handles"][0]
    assert state["pivot"] == list(deformer.handle(own).pivot) == axis["auto"]
    assert state["pivot_at"] == deformer.handle(own).transform.pivot_at
    assert {"point", "base", "middle", "hinge"} <= set(axis["pivots"])
    page.ask("move", handle=handle, transform={"pivot": "hinge", "bend": [0, 0, 30], "joint": "auto"}, settle=True)
    deformer.move(own, pivot="hinge", bend=(0, 0, 30), joint="auto")
    state = page.last("state")["handles"][0]
    assert (state["pivot"], state["bend"]) == (list(deformer.handle(own).pivot), [0, 0, 30])
    assert state["joint"] == deformer.handle(own).transform.joint
    center = deformer.mesh.bounds.mean(axis=0)
    positions = page.ask("compute")["arrays"]["positions"]
    np.testing.assert_allclose(positions + center, deformer.vertices, atol=2e-6)


def test_downloads_are_named_by_the_server_alone(page: Page) -> None:
    page.ask("export", format="edit")
    with page.http() as http:
        for path in (
            f"/download/{page.session}/../session.json",
            f"/download/{page.session}/..%2fsession.json",
            f"/download/..%2f{page.session}/exports",
            f"/download/{page.session}/{'0' * 32}",
            f"/download/{'0' * 32}/{'0' * 32}",
        ):
            assert http.get(path).status_code == 404


def test_planes_of_another_preset_are_found_when_it_is_chosen(new_page: Page, deformer: Deformer) -> None:
    rules = PRESETS["paper"]
    wanted = symmetry_planes(deformer.mesh, deformer.field, candidates=rules.candidates, threshold=rules.threshold)
    new_page.ask("set_preset", preset="paper")
    found = new_page.until(lambda each: each["type"] == "state" and len(each["planes"]) == len(wanted))
    assert found["preset"] == "paper"
    assert [tuple(each["normal"]) for each in found["planes"]] == [plane.normal for plane in wanted]
    assert wanted, "the chair has two sides that look alike"


def test_suggestions_are_found_once_and_in_the_background(new_page: Page, monkeypatch: pytest.MonkeyPatch) -> None:
    begun, cut, count = threading.Event(), Parts.cut, []

    def slow(parts: Parts) -> Any:
        count.append(1)
        assert begun.wait(60)
        return cut(parts)

    monkeypatch.setattr(Parts, "cut", slow)
    for shared in preparation._SHARED.values():
        shared.cut = None
    assert new_page.ask("suggest")["type"] == "done"
    assert new_page.last("progress")["text"] == "Finding places for handles"
    assert new_page.ask("add", at=5)["type"] == "done", "the session goes on meanwhile"
    begun.set()
    first = new_page.until(lambda each: each["type"] == "suggestions")["suggestions"]
    new_page.ask("suggest")
    again = new_page.last("suggestions")["suggestions"]
    assert first == again
    assert count == [1]


def test_a_preview_shows_what_other_controls_would_move(page: Page, deformer: Deformer) -> None:
    handle = page.hold(5)
    before = page.last("state")["handles"]
    shown = page.ask("preview", handle=handle, controls={"level": 1, "reach": "part"})["arrays"]["values"]
    assert page.last("state")["handles"] == before, "a preview changes nothing"
    page.ask("change", handle=handle, controls={"level": 1, "reach": "part"})
    own = deformer.add(5, level=1)
    wanted = deformer.following[:, deformer.handles.index(deformer.handle(own))]
    np.testing.assert_allclose(shown / 65535, wanted, atol=1e-4)


def test_what_a_fixed_point_keeps_in_place_is_shown(page: Page, deformer: Deformer) -> None:
    shown = page.ask("stays", vertex=5)["arrays"]["values"] / 65535
    assert shown[5] == 1
    assert page.ask("stays")["arrays"]["values"].max() == 0
    page.ask("fix", at=5)
    np.testing.assert_array_equal(page.ask("stays")["arrays"]["values"] / 65535, shown)
    deformer.fix(5)
    np.testing.assert_allclose(shown, deformer.bound.by_features.subtracted(deformer.fixed), atol=1e-4)


def test_proposals_show_the_shape_as_their_controls_would_pose_it(page: Page) -> None:
    handle = page.hold(5, translation=[0, -0.3, 0])
    before = page.last("state")["handles"][0]
    answer = page.ask("propose", handle=handle)
    assert 1 <= len(answer["proposals"]) <= 4
    assert page.last("state")["handles"][0] == before, "a proposal changes nothing"
    assert len({each["label"] for each in answer["proposals"]}) == len(answer["proposals"])
    now = page.ask("compute")["arrays"]["positions"]
    for number, proposal in enumerate(answer["proposals"]):
        assert page.ask("change", handle=handle, controls=proposal["controls"])["type"] == "done"
        taken = page.ask("compute")["arrays"]["positions"]
        np.testing.assert_allclose(answer["arrays"][f"positions{number}"], taken, atol=1e-6)
        assert np.abs(taken - now).max() > 1e-3, "a proposal that changes nothing is no proposal"
        page.ask("go", by=-1)


def test_shares_get_more_digits_only_where_words_are_the_same() -> None:
    steps = [("", 2, 0.0163), ("", 2, 0.0231), ("", 2, 0.12), ("head", 1, 0.12), (WHOLE, 1, 1.0)]
    assert _distinct(steps) == [
        "2 alike, 1.6 % of the surface",
        "2 alike, 2.3 % of the surface",
        "2 alike, 12 % of the surface",
        "head, 12 % of the surface",
        "the whole shape",
    ]
