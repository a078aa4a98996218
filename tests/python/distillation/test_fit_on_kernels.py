"""The fit by kernels: gradients like the twin's, steps like torch's, the same bits however many threads take them."""

from __future__ import annotations

from itertools import chain, pairwise
from typing import Any

import numpy as np
import pytest
import torch

from dfd import _core, reference
from dfd.common.progress import Stages
from dfd.distillation import fit_on_kernels as fit_on_kernels_module
from dfd.distillation.fit_on_kernels import _Pace, fit_on_kernels, network_inputs, one_cycle
from dfd.distillation.settings import DistillSettings
from dfd.distillation.targets import PointTargets
from dfd.field.architecture import Architecture
from dfd.field.network import Network

WIDTHS = [16, 128, 64, 64]


def arguments(batch: int = 100, steps: int = 6) -> dict[str, Any]:
    """What `_core.fit` takes, of a small network and 70 points."""
    random = np.random.default_rng(1)
    targets = random.normal(size=(70, WIDTHS[-1])).astype(np.float32)
    state = np.zeros((3, _core.fit_size(WIDTHS)), np.float32)
    state[0] = random.normal(scale=0.1, size=state.shape[1])
    rates, momenta = one_cycle(1e-2, 20)
    return {
        "state": state,
        "widths": WIDTHS,
        "inputs": random.normal(size=(70, WIDTHS[0])).astype(np.float32),
        "targets": targets / np.linalg.norm(targets, axis=1, keepdims=True),
        "chosen": random.integers(70, size=(steps, batch), dtype=np.int32),
        "rates": rates[:steps].copy(),
        "momenta": momenta[:steps].copy(),
        "steps_before": 0,
        "losses": np.zeros((1, steps), np.float32),
        "threads": 1,
    }


def layers(values: np.ndarray) -> list[list[np.ndarray]]:
    """The parameters as the twin takes them."""
    found, begin = [], 0
    for number, (entering, leaving) in enumerate(pairwise(WIDTHS)):
        groups = values[begin : begin + entering * leaving].reshape(-1, entering, 16).astype(np.float64)
        layer = [groups.swapaxes(0, 1).reshape(entering, leaving)]
        begin += entering * leaving
        for _ in range(3 if number + 2 < len(WIDTHS) else 1):
            layer.append(values[begin : begin + leaving].astype(np.float64))
            begin += leaving
        found.append(layer)
    assert begin == len(values)
    return found


@pytest.mark.parametrize("batch", [1, 48, 100])
def test_gradients_are_those_of_the_twin(batch: int) -> None:
    given = arguments(batch, steps=1)
    chosen = given["chosen"][0]
    rows = (given[name][chosen].astype(np.float64) for name in ("inputs", "targets"))
    loss, wanted = reference.fit_gradients(layers(given["state"][0]), *rows)
    _core.fit(**given)
    assert given["losses"][0, 0] == pytest.approx(loss, rel=1e-5)
    # After one step the first moment is a known part of the gradient.
    for found, exact in zip(layers(given["state"][1]), wanted, strict=True):
        for one, other in zip(found, exact, strict=True):
            np.testing.assert_allclose(one / (1 - given["momenta"][0]), other, atol=1e-5 * np.abs(other).max())


def test_the_twin_has_the_gradients_of_torch() -> None:
    random = np.random.default_rng(2)
    architecture = Architecture(5, 16, 2, 1)
    network = Network.seeded(1, architecture).double()
    points = random.uniform(-1, 1, (9, 3))
    targets = random.normal(size=(9, 5))
    loss = (network(torch.tensor(points)) - torch.tensor(targets)).square().sum(dim=1).mean()
    loss.backward()
    own = dict(network.named_parameters())
    names = [["network.0", "network.2"], ["network.3", "network.5"], ["network.6"]]
    entries = [[f"{name}.{part}" for name in layer for part in ("weight", "bias")] for layer in names]
    given = [[own[entry].detach().numpy().T for entry in layer] for layer in entries]
    inputs = network_inputs(points.astype(np.float64), 1)
    found, gradients = reference.fit_gradients(given, inputs, targets)
    assert found == pytest.approx(loss.item(), rel=1e-6)
    for layer, of_layer in zip(entries, gradients, strict=True):
        for entry, gradient in zip(layer, of_layer, strict=True):
            assert own[entry].grad is not None
            np.testing.assert_allclose(gradient, own[entry].grad.numpy().T, atol=1e-6)


def test_steps_are_those_of_torch() -> None:
    given = arguments(steps=20)
    values = [torch.tensor(entry, requires_grad=True) for layer in layers(given["state"][0]) for entry in layer]
    optimizer = torch.optim.Adam(values, lr=1e-2)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, 1e-2, total_steps=20)
    for chosen in given["chosen"]:
        entries = iter(values)
        now = [[next(entries).detach().numpy() for _ in layer] for layer in layers(given["state"][0])]
        rows = (given[name][chosen].astype(np.float64) for name in ("inputs", "targets"))
        for value, gradient in zip(values, chain.from_iterable(reference.fit_gradients(now, *rows)[1]), strict=True):
            value.grad = torch.tensor(gradient)
        optimizer.step()
        schedule.step()
    _core.fit(**given)
    for found, wanted in zip(chain.from_iterable(layers(given["state"][0])), values, strict=True):
        np.testing.assert_allclose(found, wanted.detach().numpy(), atol=1e-3)


@pytest.mark.parametrize("steps", [1, 2, 3, 4, 10, 1000])
def test_the_cycle_is_that_of_torch(steps: int) -> None:
    optimizer = torch.optim.Adam([torch.zeros(1, requires_grad=True)], lr=0.02)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, 0.02, total_steps=max(steps, 2))
    rates, momenta = one_cycle(0.02, steps)
    for rate, momentum in zip(rates, momenta, strict=True):
        assert optimizer.param_groups[0]["lr"] == pytest.approx(rate, rel=1e-9)
        assert optimizer.param_groups[0]["betas"][0] == pytest.approx(momentum, rel=1e-9)
        optimizer.step()
        schedule.step()


def test_one_thread_equals_many_and_steps_go_on() -> None:
    whole, several, parts = arguments(), arguments() | {"threads": 3}, arguments()
    _core.fit(**whole)
    _core.fit(**several)
    names = ("chosen", "rates", "momenta")
    for begin, end in ((0, 2), (2, 6)):
        some = {name: parts[name][begin:end] for name in names}
        _core.fit(**parts | some | {"steps_before": begin, "losses": np.zeros((1, end - begin), np.float32)})
    for other in (several, parts):
        np.testing.assert_array_equal(other["state"], whole["state"])
    np.testing.assert_array_equal(several["losses"], whole["losses"])


@pytest.mark.parametrize("disturbed", [False, True])
def test_threads_are_taken_where_they_are_faster_and_tried_again_soon(
    disturbed: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = [0.0]
    monkeypatch.setattr(fit_on_kernels_module.time, "perf_counter", lambda: clock[0])
    pace, taken = _Pace(2), []
    for turn in range(20):
        with pace.threads() as threads:
            clock[0] += 1 / threads if turn > 5 or not disturbed else 1
        taken.append(threads)
    assert taken[:3] == [1, 1, 2]
    assert taken[3:7] == [1 if disturbed else 2] * 4
    assert taken[9:17] == [2] * 8


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"widths": [16]}, "at least one layer"),
        ({"widths": [11, *WIDTHS[1:]]}, "a multiple of 8"),
        ({"widths": [16, 100, 64]}, "multiples of 64"),
        ({"state": np.zeros((3, 5), np.float32)}, r"\(3, fit_size\)"),
        ({"inputs": np.zeros((70, 8), np.float32)}, "a row for each point"),
        ({"targets": np.zeros((69, 64), np.float32)}, "a row for each point"),
        ({"rates": np.zeros(2)}, "for every step"),
        ({"losses": np.zeros((1, 2), np.float32)}, "for every step"),
        ({"chosen": np.full((6, 9), 70, np.int32)}, "numbers of points"),
        ({"chosen": np.full((6, 9), -1, np.int32)}, "numbers of points"),
    ],
)
def test_what_does_not_fit_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        _core.fit(**arguments() | changes)


def test_widths_that_are_filled_up_leave_no_trace() -> None:
    random = np.random.default_rng(3)
    points = random.uniform(-1, 1, (50, 3)).astype(np.float32)
    rows = random.normal(size=(50, 5)).astype(np.float32)
    targets = PointTargets(points, rows / np.linalg.norm(rows, axis=1, keepdims=True), None)
    before = points.copy(), targets.targets.copy()
    settings = DistillSettings(steps=25, batch=10, octaves=2)
    parameters, losses = fit_on_kernels(targets, settings, stages=Stages(show=False))
    assert {name: values.shape for name, values in parameters.items()} == Architecture(5, octaves=2).shapes()
    assert len(losses) == 25
    np.testing.assert_array_equal(points, before[0])
    np.testing.assert_array_equal(targets.targets, before[1])
    network = Network.of(parameters, Architecture(5, octaves=2))
    found = network(torch.from_numpy(points)).numpy()
    assert np.square(found - targets.targets).sum(axis=1).mean() < losses[0]
