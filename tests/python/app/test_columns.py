"""Test that posing by columns with the protocol's formula, as the page does, gives the result of the kernel."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import dfd
from dfd.app.session.requests import probed
from dfd.app.session.session import NO_FIELD
from dfd.app.session.state import Editing, quantized, short_drag
from dfd.editing.deformer import Deformer


class Client:
    """A client that stores columns and poses by them, as the page does."""

    def __init__(self, deformer: Deformer) -> None:
        self.deformer, self.editing = deformer, Editing(deformer)
        self.weights: dict[int, NDArray[np.float64]] = {}

    def listen(self) -> list[dict[str, Any]]:
        """Receive all columns, and return the handles."""
        columns, new = self.editing.columns()
        self.weights |= {number: values / 65535 for number, values in new.items()}
        handles = self.editing.state(columns, field=NO_FIELD, after=0).model_dump()["handles"]
        used = {column["column"] for handle in handles for column in handle["columns"]}
        self.weights = {number: self.weights[number] for number in used}
        return list(handles)

    def following(self) -> NDArray[np.float64]:
        """Return the weights (V, H) of the handles."""
        found = [sum(self.weights[each["column"]] for each in handle["columns"]) for handle in self.listen()]
        return np.stack(found, axis=1)

    def posed(self) -> NDArray[np.float64]:
        """Return the posed vertices (V, 3) by the protocol's formula."""
        vertices = self.deformer.mesh.vertices
        moved = vertices.copy()
        for handle, own in zip(self.listen(), self.deformer.handles, strict=True):
            for column in handle["columns"]:
                frame = np.eye(3) if column["frame"] is None else np.array(column["frame"])
                center = np.array(column["position"]) + frame @ np.subtract(handle["pivot"], handle["position"])
                turned = (vertices - center) @ (frame @ own.transform.linear @ frame.T).T + center
                goal = turned + frame @ own.transform.translation
                moved += self.weights[column["column"]][:, None] * (goal - vertices)
        return moved


def foot_of(deformer: Deformer) -> int:
    """Return the vertex at the end of one leg of the chair."""
    vertices = deformer.mesh.vertices
    return int(np.argmin(vertices[:, 1] - vertices[:, 0] - vertices[:, 2]))


@pytest.fixture
def client(deformer: Deformer) -> Client:
    return Client(deformer)


def test_columns_are_the_bound_weights(client: Client) -> None:
    deformer = client.deformer
    # For handles at rest, the columns are those of a short drag.
    drag = short_drag(deformer.mesh)[:, 3]
    deformer.add(3, reach=0.9, falloff="linear", translation=drag)
    deformer.add([0.1, 0.4, 0.1], counterparts="shared_pivot", translation=drag)
    deformer.fix(900, strength=0.5)
    deformer.change(1, locality=3.0)
    deformer.change(2, radius="40%", mask=np.arange(600))
    deformer.set_symmetry("x")
    np.testing.assert_allclose(client.following(), deformer.following, atol=5e-5)
    deformer.preset = "paper"
    np.testing.assert_allclose(client.following(), deformer.following, atol=5e-5)


@pytest.mark.parametrize("how", [{"counterparts": "own_pivot"}, {"counterparts": "shared_pivot"}, {"follow": "none"}])
@pytest.mark.parametrize("pivot", [None, (0.3, 0.2, 0.1)])
def test_columns_act_as_the_kernel_poses_them(client: Client, how: dict[str, Any], pivot: Any) -> None:
    deformer = client.deformer
    deformer.add(foot_of(deformer), translation=(0.1, 0.2, 0), scale=(1.2, 0.9, 1), pivot=pivot, **how)
    np.testing.assert_allclose(client.posed(), deformer.vertices, atol=5e-5)
    assert (len(client.weights) > 1) == ("counterparts" in how)


@pytest.mark.parametrize("how", [{"counterparts": "own_pivot"}, {"counterparts": "shared_pivot"}, {"follow": "none"}])
def test_columns_rotate_as_the_kernel_blends_linearly(client: Client, how: dict[str, Any]) -> None:
    deformer = client.deformer
    deformer.add(foot_of(deformer), translation=(0.1, 0.2, 0), rotation=(10, 0, 30), **how)
    shown, edit = client.posed(), deformer.edit
    weights, columns = deformer.bound.columns(edit)
    transforms = np.array([column.matrix(edit) for column in columns])
    kernel = dfd.pose(deformer.mesh.vertices, weights, transforms, overlap=edit.rules.overlap, blend="linear")
    np.testing.assert_allclose(shown, kernel, atol=5e-5)
    assert np.abs(shown - deformer.mesh.vertices).max() > 0.1


def test_the_exact_heat_of_a_probe_is_the_column_of_a_handle_there(client: Client) -> None:
    editing, vertex = client.editing, foot_of(client.deformer)
    assert editing.exact_probe() is None
    editing.pointed = vertex, 0
    found = editing.exact_probe()
    assert found is not None
    assert found[:2] == (vertex, 0)
    assert editing.exact_probe() is None, "nothing is computed twice"
    client.deformer.add(vertex)
    np.testing.assert_allclose(found[2], client.following()[:, 0], atol=5e-5)
    editing.pointed = vertex, 0
    assert editing.exact_probe() is None, "the place has a handle"


def test_bands_are_stale_until_the_page_has_those_of_the_present_motion(client: Client) -> None:
    deformer, editing = client.deformer, client.editing
    deformer.add(foot_of(deformer), translation=(0.02, 0, 0))
    client.listen()
    assert not editing.has_stale_bands()
    deformer.move(1, translation=(0.3, 0.1, 0))
    assert editing.has_stale_bands()
    client.listen()
    assert not editing.has_stale_bands()


def test_the_heat_of_a_probe_is_the_column_of_a_handle_there(client: Client) -> None:
    deformer = client.deformer
    heat = quantized(probed(deformer, 3))
    deformer.add(3, translation=short_drag(deformer.mesh)[:, 3])
    # The probe shows the part itself. A handle's weights are lower at the far end of the part.
    np.testing.assert_allclose(heat / 65535, deformer.weights[:, 0], atol=0.2)
    assert heat[3] == 65535


def test_the_heat_of_a_probe_is_of_distances_where_the_preset_has_a_number(client: Client) -> None:
    deformer = client.deformer
    deformer.preset = "paper"
    deformer.fix(900)
    deformer.add(3)
    np.testing.assert_allclose(probed(deformer, 3).clip(0), deformer.weights[:, 0], atol=5e-5)
