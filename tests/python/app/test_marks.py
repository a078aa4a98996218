"""Test marks: points of the surface that must arrive at targets, by moving handles."""

import numpy as np
from app_page import Page

from dfd.editing.deformer import Deformer


def test_handles_follow_marks_and_undo_takes_marks_back(page: Page, deformer: Deformer) -> None:
    size = float(deformer.mesh.diagonal)
    handle = page.hold(5)
    weights = page.last("columns")["arrays"]["values"][0]
    vertices = np.argsort(weights, kind="stable")[-400::100].tolist()
    for count in range(1, 5):
        page.ask("set_marks", marks=[{"vertex": each, "target": None} for each in vertices[:count]], fit=False)
    state = page.last("state")
    assert [mark["vertex"] for mark in state["marks"]] == vertices
    assert all(mark["missing"] == 0 and mark["target"] == mark["position"] for mark in state["marks"])
    assert state["steps"][-1] == "Change the marks"
    assert not state["handles"][0]["moved"]

    for step in range(1, 4):
        shift = np.array([0, -0.02 * step * size, 0])
        marks = [{"vertex": each["vertex"], "target": (each["position"] + shift).tolist()} for each in state["marks"]]
        page.ask("set_marks", marks=marks, merge=step > 1)
    after = page.last("state")
    assert max(mark["missing"] for mark in after["marks"]) < 1e-4 * size
    np.testing.assert_allclose(after["handles"][0]["translation"], shift, atol=1e-3 * size)
    assert after["step"] == state["step"] + 1, "a drag is one step of undo"
    page.ask("go", by=-1)
    assert page.last("state")["marks"] == state["marks"]
    assert not page.last("state")["handles"][0]["moved"]
    page.ask("go", by=1)
    assert page.last("state")["marks"] == after["marks"]
    page.ask("move", handle=handle, transform={"translation": [0, 0, 0]}, settle=True)
    assert page.last("state")["marks"][0]["missing"] > 0.05 * size
    page.ask("start_fresh")
    assert page.last("state")["marks"] == []


def test_a_fit_says_what_marks_do_not_determine_and_moves_no_other_handle(page: Page, deformer: Deformer) -> None:
    mark = {"vertex": 5, "target": [0, 0, 0]}
    assert "`handles` must have at least one handle" in page.ask("set_marks", marks=[mark])["message"]
    assert page.last("state")["marks"] == [], "a failed request changes nothing"
    assert "no vertex" in page.ask("set_marks", marks=[{"vertex": 10**6, "target": None}])["message"]
    held = page.hold(5)
    deformer.add(5)
    still = int(np.flatnonzero(deformer.following[:, 0] == 0)[0])
    other = page.hold(still, translation=[0, 0.1, 0])
    page.ask("set_marks", marks=[mark | {"target": (deformer.mesh.vertices[5] + 0.01).tolist()}])
    state = page.last("state")
    assert state["fitted"].startswith("The marks do not determine all motions")
    assert f"handle {held}: translation and rotation" in state["fitted"], "a point may turn about its target"
    assert f"handle {other}" not in state["fitted"]
    moved = {handle["handle"]: handle["translation"] for handle in state["handles"]}
    assert moved[other] == [0, 0.1, 0]
    assert moved[held] != [0, 0, 0]
    page.ask("set_marks", marks=[mark, {"vertex": 6, "target": None}], fit=False)
    placed = page.last("state")
    assert (len(placed["marks"]), placed["fitted"]) == (2, state["fitted"]), "a further mark moves no handle"
    page.ask("go", by=-1)
    page.ask("go", by=-1)
    assert page.last("state")["fitted"] is None
