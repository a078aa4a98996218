"""Columns: what the page makes of them, by the protocol's formula, are the weights that the kernel binds."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from dfd.app.columns import Columns, heat_message
from dfd.app.framing import unpack
from dfd.app.state import Looks, state_message
from dfd.editing.deformer import Deformer
from dfd.editing.edit import place_on


class Client:
    """Keeps columns as the page does, and makes weights and positions of them."""

    def __init__(self, deformer: Deformer) -> None:
        self.deformer, self.columns = deformer, Columns(deformer)
        self.entries: dict[int, dict[str, Any]] = {}
        self.received = 0

    def listen(self) -> dict[str, Any]:
        message = self.columns.message()
        self.received = 0
        if message is not None:
            header, arrays = unpack(message)
            self.received = len(header["columns"])
            for entry in header["columns"]:
                values = arrays[entry["values"]] * (entry["scale"] / 65535)
                geodesic = None if entry["geodesic"] is None else arrays[entry["geodesic"]] / 65535
                self.entries[entry["column"]] = {**entry, "values": values, "geodesic": geodesic}
        return state_message(self.deformer, self.columns, Looks(), after=0).model_dump()

    def weights(self) -> NDArray[np.float64]:
        state = self.listen()
        columns = []
        for handle in state["handles"]:
            entry = self.entries[handle["column"]]
            assert handle["kind"] == entry["kind"] == "distance"
            weight = np.maximum(1 - entry["values"] / handle["reach"], 0)
            if state["fixed_column"]:
                fixed = self.entries[state["fixed_column"]]
                held = np.maximum(1 - fixed["values"] / handle["reach"], 0)
                weight = np.minimum(np.maximum(weight - held, 0) * handle["gain"], 1)
            if entry["geodesic"] is not None:
                weight = weight * (1 - entry["geodesic"]) ** handle["locality"]
            columns.append(weight)
        return np.stack(columns, axis=1)


@pytest.fixture
def client(deformer: Deformer) -> Client:
    return Client(deformer)


def test_the_formula_gives_the_bound_weights(client: Client) -> None:
    deformer = client.deformer
    deformer.add(3)
    deformer.add([0.1, 0.4, 0.1])
    np.testing.assert_allclose(client.weights(), deformer.weights, atol=5e-5)
    deformer.fix(900)
    deformer.fix([0.0, 0.9, -0.2])
    np.testing.assert_allclose(client.weights(), deformer.weights, atol=1e-4)
    deformer.change(1, locality=3.0)
    deformer.set_symmetry("x")
    np.testing.assert_allclose(client.weights(), deformer.weights, atol=3e-4)


def test_a_column_travels_once(client: Client) -> None:
    deformer = client.deformer
    deformer.add(3)
    client.listen()
    assert client.received == 1
    deformer.move(1, translation=(0, 1, 0))
    deformer.change(1, name="a name")
    client.listen()
    assert client.received == 0
    deformer.add(10)
    client.listen()
    assert client.received == 1


def test_a_page_that_comes_anew_gets_all(client: Client) -> None:
    client.deformer.add(3)
    client.deformer.fix(50)
    client.listen()
    client.columns.forget()
    client.listen()
    assert client.received == 2


def test_what_came_back_by_undo_is_the_same_column(client: Client) -> None:
    deformer = client.deformer
    deformer.add(3)
    (first,) = client.listen()["handles"]
    deformer.change(1, at=20)
    (second,) = client.listen()["handles"]
    deformer.undo()
    (third,) = client.listen()["handles"]
    assert first["column"] == third["column"] != second["column"]


def test_the_heat_of_a_probe_is_the_column_of_a_handle_there(client: Client) -> None:
    deformer = client.deformer
    header, arrays = unpack(heat_message(deformer, place_on(deformer.mesh, "t", "at", 3), request=9))
    assert (header["id"], header["vertex"]) == (9, 3)
    deformer.add(3)
    weights = np.maximum(1 - arrays["values"] * (header["scale"] / 65535), 0)
    np.testing.assert_allclose(weights, deformer.weights[:, 0], atol=5e-5)
    assert arrays["values"][3] == 0
