"""Columns: what the page makes of them, by the protocol's formula, are the weights that the kernel binds."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from dfd.app.protocol.binary_messages import unpack
from dfd.app.session.columns import Columns, heat_message, probed
from dfd.app.session.state import ViewState, state_message
from dfd.editing.deformer import Deformer
from dfd.editing.points import place_on


class Client:
    """Keeps columns as the page does, and makes weights and positions of them."""

    def __init__(self, deformer: Deformer) -> None:
        self.deformer, self.columns = deformer, Columns(deformer)
        self.entries: dict[int, dict[str, Any]] = {}
        self.received = self.shares = 0

    def listen(self) -> dict[str, Any]:
        message = self.columns.message()
        self.received = 0
        if message is not None:
            header, arrays = unpack(message)
            self.received = len(header["columns"])
            for entry in header["columns"]:
                values = arrays[entry["values"]] * (entry["scale"] / 65535)
                geodesic = None if entry["geodesic"] is None else arrays[entry["geodesic"]] / 65535
                self.entries[entry["column"]] = {**entry, "values": values, "geodesic": geodesic, "counterparts": ()}
        while (later := self.columns.counterparts_message()) is not None:
            header, arrays = unpack(later)
            for entry in header["columns"]:
                before = self.entries[entry["column"]]["counterparts"]
                for i, counterpart in enumerate(entry["counterparts"]):
                    name = counterpart["share"]
                    self.shares += name is not None
                    counterpart["share"] = before[i]["share"] if name is None else arrays[name] / 65535
                self.entries[entry["column"]]["counterparts"] = entry["counterparts"]
        assert not self.columns.has_pending
        return state_message(ViewState(), self.deformer, self.columns, after=0).model_dump()

    def weights(self) -> NDArray[np.float64]:
        """(V, H) by the protocol's formula."""
        state = self.listen()
        held = self.entries[state["fixed_column"]]["values"] if state["fixed_column"] else 0.0
        columns = []
        for handle in state["handles"]:
            entry = self.entries[handle["column"]]
            weight = entry["values"]
            if entry["kind"] == "distance":
                weight = CURVES[handle["falloff"]](np.maximum(1 - weight / handle["reach"], 0))
                weight = np.maximum(weight - held, 0)
                if entry["geodesic"] is not None:
                    weight = weight * (1 - entry["geodesic"]) ** handle["exponent"]
                weight = handle["strength"] * np.minimum(handle["gain"] * weight, 1)
                if handle["counterparts"] == "shared_pivot" and entry["counterparts"]:
                    (whole,) = entry["counterparts"]
                    weight = np.minimum(whole["gain"] * whole["share"] * weight, 1)
            columns.append(weight)
        return np.stack(columns, axis=1)


CURVES: dict[str, Callable[[NDArray[np.float64]], NDArray[np.float64]]] = {
    "linear": lambda x: x,
    "smooth": lambda x: x * x * (3 - 2 * x),
    "sharp": np.square,
    "root": np.sqrt,
    "sphere": lambda x: np.sqrt(x * (2 - x)),
    "constant": lambda x: (x > 0) * 1.0,
}


@pytest.fixture
def client(deformer: Deformer) -> Client:
    return Client(deformer)


def test_the_formula_gives_the_bound_weights(client: Client) -> None:
    deformer = client.deformer
    deformer.add(3)
    deformer.add([0.1, 0.4, 0.1])
    np.testing.assert_allclose(client.weights(), deformer.weights, atol=5e-5)
    deformer.fix(900, strength=0.5)
    deformer.fix([0.0, 0.9, -0.2], strength=0.3)
    assert client.listen()["handles"][0]["gain"] > 1
    np.testing.assert_allclose(client.weights(), deformer.weights, atol=3e-4)
    deformer.change(1, locality=3.0)
    deformer.change(2, radius="40%")
    deformer.set_symmetry("x")
    np.testing.assert_allclose(client.weights(), deformer.weights, atol=1e-3)


@pytest.mark.parametrize("falloff", ["linear", "smooth", "sharp", "sphere"])
@pytest.mark.parametrize("reach", [0.5, 1.7])
def test_reach_and_falloff_are_the_pages_own(client: Client, falloff: Any, reach: float) -> None:
    deformer = client.deformer
    deformer.preset = "paper"  # what follows in full follows by gains that depend on all of it
    deformer.add(3)
    client.listen()
    deformer.change(1, reach=reach, falloff=falloff, strength=0.7)
    # An end of the reach is a place where the square root of what is left has no slope to speak of.
    atol = 2e-2 if falloff == "sphere" else 3e-4
    np.testing.assert_allclose(client.weights(), deformer.weights, atol=atol)
    assert client.received == 0


@pytest.mark.parametrize("controls", [{}, {"excluded_counterparts": True}])
def test_a_slider_of_reach_sends_what_counterparts_have_of_it(client: Client, controls: Any) -> None:
    deformer = client.deformer
    deformer.add(3, reach=1.0, counterparts="shared_pivot")
    if controls:
        likes = [counterpart.vertex for counterpart, _ in deformer.counterparts(1)][1:2]
        deformer.change(1, excluded_counterparts=likes)
    before = client.weights()
    for reach in (0.8, 0.6, 1.2):
        deformer.change(1, reach=reach)
        after = client.weights()
        bound, columns = deformer.bound.columns(deformer.edit)
        assert [column.handle for column in columns] == [0]
        np.testing.assert_allclose(after, bound, atol=5e-4)
        assert client.received == 0
    assert np.abs(after - before).max() > 0.05


def test_regions_and_limits_travel_as_weights(client: Client) -> None:
    deformer = client.deformer
    deformer.add(np.arange(40))
    deformer.add(700, mask=np.arange(600, 900))
    deformer.fix(np.arange(100, 140), strength=0.8)
    np.testing.assert_allclose(client.weights(), deformer.weights, atol=2e-5)
    assert [client.entries[handle["column"]]["kind"] for handle in client.listen()["handles"]] == ["weight", "weight"]
    assert client.listen()["handles"][0]["region"] == 40
    deformer.change(2, reach=0.5)
    np.testing.assert_allclose(client.weights(), deformer.weights, atol=2e-5)


@pytest.mark.parametrize("mode", ["own_pivot", "only"])
@pytest.mark.parametrize("pivot", [None, (0.3, 0.2, 0.1)])
def test_counterparts_act_as_the_kernel_poses_them(client: Client, mode: Any, pivot: Any) -> None:
    deformer = client.deformer
    vertices = deformer.mesh.vertices
    foot = int(np.argmin(vertices[:, 1] - vertices[:, 0] - vertices[:, 2]))
    deformer.add(foot, translation=(0.1, 0.2, 0), rotation=(0, 0, 30), pivot=pivot, counterparts=mode)
    (weights,) = client.weights().T
    (handle,) = client.listen()["handles"]
    transform = deformer.handles[0].transform
    moved = vertices.copy()
    counterparts = client.entries[handle["column"]]["counterparts"]
    assert len(counterparts) >= 1
    for entry in counterparts:
        frame = np.array(entry["frame"])
        center = np.array(entry["position"]) + frame @ np.subtract(handle["pivot"], handle["position"])
        linear = frame @ transform.linear @ frame.T
        goal = (vertices - center) @ linear.T + center + frame @ transform.translation
        moved += np.minimum(entry["gain"] * entry["share"] * weights, 1)[:, None] * (goal - vertices)
    np.testing.assert_allclose(moved, deformer.vertices, atol=4e-3)  # a share has 256 steps


def test_the_heat_of_a_probe_is_the_column_of_a_handle_there(client: Client) -> None:
    deformer = client.deformer
    header, arrays = unpack(heat_message(probed(deformer, place_on(deformer.mesh, 3)), request=9, vertex=3))
    assert (header["id"], header["vertex"]) == (9, 3)
    deformer.add(3)
    # The part itself: its far end follows less.
    np.testing.assert_allclose(arrays["values"] / 65535, deformer.weights[:, 0], atol=0.2)
    assert arrays["values"][3] == 65535


def test_the_heat_of_a_probe_is_of_distances_where_the_preset_has_a_number(client: Client) -> None:
    deformer = client.deformer
    deformer.preset = "paper"
    deformer.fix(900)
    deformer.add(3)
    np.testing.assert_allclose(probed(deformer, place_on(deformer.mesh, 3)).clip(0), deformer.weights[:, 0], atol=5e-5)
