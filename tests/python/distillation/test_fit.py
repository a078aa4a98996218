"""Test the fit: its accuracy, its random numbers on each device, and its optimizer."""

import numpy as np
import pytest
import torch
from made_field import made_field, same

import dfd
from dfd.common.progress import Stages
from dfd.distillation.fit import Adam, fit, schedule, widen
from dfd.distillation.settings import DistillSettings
from dfd.distillation.targets import PointTargets
from dfd.field.architecture import Architecture
from dfd.field.network import Network


def fitted(settings, device="cpu"):
    points = np.random.default_rng(0).uniform(-1, 1, (400, 3)).astype(np.float32)
    rows = np.concatenate([points, np.ones((400, 1), np.float32)], axis=1)
    rows /= np.linalg.norm(rows, axis=1, keepdims=True)
    targets, stages = PointTargets(points, rows, np.eye(4, dtype=np.float32)), Stages(show=False)
    return fit(targets, settings, center=np.ones(3), scale=0.5, device=device, stages=stages), targets, stages


def test_the_field_gives_the_targets_at_the_points_in_its_own_units():
    field, targets, stages = fitted(DistillSettings(steps=150, batch=128, learning_rate=1e-2, octaves=1))
    errors = np.linalg.norm(field(targets.points / 0.5 + 1) - targets.targets, axis=1)
    assert errors.mean() < 0.05
    assert len(field.settings["losses"]) == 150
    assert field.settings["losses"][-1] < 0.05 * field.settings["losses"][0]
    assert list(stages.seconds) == ["fit"]


def test_the_same_field_on_the_cpu_and_on_cuda():
    if not torch.cuda.is_available():
        pytest.skip("no CUDA device")
    before = torch.cuda.get_rng_state()
    for settings in (DistillSettings(), DistillSettings(preset="paper", batch=100, epochs=60)):
        (one, targets, _), (other, _, _) = fitted(settings), fitted(settings, "cuda")
        points = targets.points / 0.5 + 1
        np.testing.assert_allclose(one(points), other(points), atol=1e-3)
    assert torch.equal(torch.cuda.get_rng_state(), before)


def test_batches_of_pictures_have_their_points_and_pass_over_all_pictures():
    class Pictures(PointTargets):
        def pictures(self):
            return list(torch.arange(40).split(8))

        def at(self, chosen):
            drawn.append(chosen)
            return super().at(chosen)

    drawn: list[torch.Tensor] = []
    points = np.eye(3, dtype=np.float32)[np.arange(40) % 3]
    how = {"center": np.zeros(3), "scale": 1.0, "device": "cpu", "stages": Stages(show=False)}
    for length, steps in (({"epochs": 4}, 12), ({"steps": 7}, 7)):
        drawn.clear()
        settings = DistillSettings(smoothing=0, batch_views=2, **length)
        field = fit(Pictures(points, points), settings, **how)
        assert len(field.settings["losses"]) == len(drawn) == steps
        assert [len(each) for each in drawn[:3]] == [16, 16, 8]
        assert torch.equal(torch.cat(drawn[:3]).sort().values, torch.arange(40))
        assert all(torch.equal(each % 8, torch.arange(8).repeat(len(each) // 8)) for each in drawn)


def test_the_seed_decides_the_field_and_torchs_generator_stays_unchanged():
    state = torch.random.get_rng_state()
    first, again, other = (fitted(DistillSettings(steps=3, batch=8, seed=seed))[0] for seed in (1, 1, 2))
    assert torch.equal(torch.random.get_rng_state(), state)
    assert same(first, again)
    assert first.settings != other.settings


def test_a_learning_rate_that_diverges_is_refused():
    with pytest.raises(ValueError, match=r"`learning_rate` 1e\+30 is too high: the fit diverged"):
        fitted(DistillSettings(steps=20, batch=8, learning_rate=1e30))


def test_a_widened_field_gives_features_times_directions():
    random = np.random.default_rng(2)
    directions = np.linalg.qr(random.normal(size=(40, 8)))[0].T.astype(np.float32)
    place = {"center": (1.0, 2.0, 3.0), "scale": 0.5}
    field = made_field(8, width=16, layers=2, octaves=2, **place, settings={"seed": 3})
    points = random.normal(size=(30, 3))
    wide = widen(field, directions)
    assert (wide.architecture, wide.settings) == (Architecture(40, 16, 2, 2), {"seed": 3})
    np.testing.assert_allclose(wide(points), field(points) @ directions, atol=1e-6)


@pytest.mark.parametrize("steps", [2, 3, 10, 350])
def test_the_cycle_and_the_steps_are_those_of_torchs_classes(steps):
    settings = DistillSettings(steps=steps, learning_rate=0.02)
    ours, theirs = (Network(Architecture(4, width=8, layers=1)).draw(torch.Generator().manual_seed(1)) for _ in "ab")
    optimizer, classes = Adam(ours), torch.optim.Adam(theirs.parameters(), lr=0.02)
    cycle = torch.optim.lr_scheduler.OneCycleLR(classes, 0.02, total_steps=steps)
    points = torch.rand(16, 3, generator=torch.Generator().manual_seed(2))
    for rate, momentum in schedule(settings, steps):
        group = classes.param_groups[0]
        assert (rate, momentum) == (pytest.approx(group["lr"]), pytest.approx(group["betas"][0]))
        optimizer.step(list(torch.autograd.grad(ours(points).sum(), list(ours.parameters()))), rate, momentum)
        classes.zero_grad()
        theirs(points).sum().backward()
        classes.step()
        if cycle.last_epoch + 1 < steps:
            cycle.step()
    for name, values in ours.arrays().items():
        np.testing.assert_allclose(values, theirs.arrays()[name], atol=1e-5)


def test_any_number_of_threads_gives_the_same_bits():
    settings = DistillSettings(steps=8, batch=600)
    dfd.set_num_threads(1)
    alone, _, _ = fitted(settings)
    dfd.set_num_threads(3)
    assert same(fitted(settings)[0], alone)
