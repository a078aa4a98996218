"""Test the gradients of weights, and the errors for arguments without gradients."""

import numpy as np
import pytest
import torch
from weights.made_features import unit_rows

import dfd
from dfd.weights import gradients
from dfd.weights.bind import Falloff

FALLOFFS = Falloff.__args__


def leaf(array):
    return torch.from_numpy(np.array(array, np.float64)).requires_grad_()


def slow(features, handles, *, fixed=None, strength=1.0, geodesic=None, locality=0.0, reach=1.0, falloff="linear"):
    """Return the weights of feature rows by Eq. 4 to 7, one handle after another, in float64."""
    columns = []
    for k in range(len(handles)):
        own = reach[k] if torch.is_tensor(reach) and reach.ndim else reach
        apart = torch.stack([torch.linalg.norm(row - handles[k]) for row in features])
        x = torch.relu(1 - apart / own)
        name = falloff if isinstance(falloff, str) else falloff[k]
        w = {"linear": x, "smooth": x**2 * (3 - 2 * x), "sharp": x**2, "constant": (x > 0) + 0 * x}.get(name)
        if w is None:
            inside = x if name == "root" else x * (2 - x)
            w = torch.where(x > 0, torch.where(x > 0, inside, 1.0).sqrt(), 0.0)
        if fixed is not None:
            near = torch.stack([torch.relu(1 - torch.linalg.norm(features - each, dim=1)) for each in fixed], dim=1)
            w = torch.relu(w - (near * strength).amax(dim=1))
        if geodesic is not None:
            own = locality[k] if torch.is_tensor(locality) and locality.ndim else locality
            w = w * (1 - geodesic[k]) ** own
        columns.append(w)
    return torch.stack(columns, dim=1)


def agree(given, options, direction):
    """Check that kernel and torch, and `slow`, give the same weights and gradients."""
    leaves = [value for value in (*given, *options.values()) if torch.is_tensor(value) and value.requires_grad]
    weights = dfd.bind(*given, **options)
    wanted = slow(*given, **options)
    torch.testing.assert_close(weights.double(), wanted, rtol=0, atol=2e-6)
    mine = torch.autograd.grad((weights * direction).sum(), leaves, allow_unused=True)
    theirs = torch.autograd.grad((wanted * direction).sum(), leaves, allow_unused=True)
    for one, other, value in zip(mine, theirs, leaves, strict=True):
        assert one.dtype == value.dtype
        torch.testing.assert_close(one, torch.zeros_like(value) if other is None else other, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("falloff", FALLOFFS)
@pytest.mark.parametrize("reach", [0.6, 1.0, 2.5])
def test_features_and_handle_rows(falloff, reach):
    features, handles = leaf(unit_rows(40, 6)), leaf(unit_rows(3, 6, seed=4))
    direction = torch.from_numpy(np.random.default_rng(1).standard_normal((40, 3)))
    agree((features, handles), {"reach": reach, "falloff": falloff}, direction)
    assert features.grad is None  # the test only reads gradients


def test_every_argument_has_gradients():
    random = np.random.default_rng(2)
    options = {
        "fixed": leaf(unit_rows(2, 6, seed=9)),
        "strength": leaf([0.4, 0.7]),
        "geodesic": leaf(random.uniform(0.1, 0.8, (3, 40))),
        "locality": leaf([0.5, 1.5, 2.0]),
        "reach": leaf([1.1, 1.4, 0.9]),
        "falloff": ["linear", "smooth", "sharp"],
    }
    given = leaf(unit_rows(40, 6)), leaf(unit_rows(3, 6, seed=4))
    agree(given, options, torch.from_numpy(random.standard_normal((40, 3))))


@pytest.mark.parametrize("name", ["reach", "strength", "locality"])
def test_numbers_with_gradients(name):
    features = torch.from_numpy(unit_rows(30, 5))
    options = {"fixed": [3], "geodesic": torch.rand(1, 30), "locality": 1.0, "strength": 0.5, "reach": 1.2}
    options[name] = torch.tensor(0.8, requires_grad=True)
    weights = dfd.bind(features, [7], **options)
    (slope,) = torch.autograd.grad(weights.sum(), options[name])
    ahead, behind = (dfd.bind(features, [7], **options | {name: 0.8 + step}).double().sum() for step in (5e-3, -5e-3))
    assert slope.item() == pytest.approx(float(ahead - behind) / 1e-2, rel=2e-2)
    assert slope.abs() > 1e-3


def test_at_the_handle_the_gradient_is_0_and_other_rows_pull_it():
    features = leaf(np.eye(4) * 0.3)
    weights = dfd.bind(features, [1])
    assert weights[1].item() == 1.0
    weights[1].sum().backward(retain_graph=True)
    assert not features.grad.any()
    weights[0].sum().backward()
    step = np.array([-1, 1, 0, 0]) / np.sqrt(2)  # the distance between the rows 0 and 1 grows in this direction
    np.testing.assert_allclose(features.grad[0].numpy(), step, atol=1e-6)
    np.testing.assert_allclose(features.grad[1].numpy(), -step, atol=1e-6)


def test_vertices_as_handles_and_fixed_points():
    features = leaf(unit_rows(40, 6))
    direction = torch.from_numpy(np.random.default_rng(3).standard_normal((40, 2)))
    weights = dfd.bind(features, torch.tensor([5, 9]), fixed=[20])
    (mine,) = torch.autograd.grad((weights * direction).sum(), features)

    wanted = slow(features, features[[5, 9]], fixed=features[[20]])
    (theirs,) = torch.autograd.grad((wanted * direction).sum(), features)
    torch.testing.assert_close(mine, theirs, rtol=1e-5, atol=1e-6)


def test_rows_are_differentiated_in_several_steps(monkeypatch):
    features = torch.from_numpy(unit_rows(50, 6)).requires_grad_()
    geodesic = torch.rand(2, 50, requires_grad=True)
    reach = torch.tensor(1.3, requires_grad=True)
    leaves = features, geodesic, reach

    def found():
        weights = dfd.bind(features, [1, 30], geodesic=geodesic, locality=1.5, reach=reach)
        return torch.autograd.grad(weights.square().sum(), leaves)

    whole = found()
    monkeypatch.setattr(gradients, "ROWS", 16)
    for one, other in zip(whole, found(), strict=True):
        torch.testing.assert_close(one, other, rtol=1e-5, atol=1e-6)


def test_second_derivatives():
    features, handles = leaf(unit_rows(20, 4)), leaf(unit_rows(2, 4, seed=4))

    def penalty(bind):
        weights = bind(features, handles, reach=1.5, falloff="smooth")
        slopes = torch.autograd.grad(weights.double().square().sum(), (features, handles), create_graph=True)
        return torch.autograd.grad(sum(slope.square().sum() for slope in slopes), (features, handles))

    for one, other in zip(penalty(dfd.bind), penalty(slow), strict=True):
        torch.testing.assert_close(one, other, rtol=1e-4, atol=1e-4)


def test_jacrev_and_vmap():
    features, handles = torch.from_numpy(unit_rows(20, 4)).double(), torch.from_numpy(unit_rows(2, 4, seed=4)).double()
    mine = torch.func.jacrev(lambda rows: dfd.bind(rows, handles))(features)
    torch.testing.assert_close(
        mine, torch.func.jacrev(lambda rows: slow(rows, handles))(features).to(mine), atol=1e-5, rtol=0
    )
    batch = torch.stack([handles, -handles])
    weights = torch.func.vmap(lambda rows: dfd.bind(features, rows))(batch)
    torch.testing.assert_close(weights, torch.stack([dfd.bind(features, rows) for rows in batch]), atol=0, rtol=0)


@pytest.mark.parametrize("dtype", [torch.bfloat16, torch.float16])
def test_types_of_16_bits(dtype):
    features = torch.from_numpy(unit_rows(20, 4)).to(dtype).requires_grad_()
    weights = dfd.bind(features, [3])
    assert weights.dtype == torch.float32
    weights.sum().backward()
    assert features.grad.dtype == dtype
    assert torch.equal(weights.detach(), dfd.bind(features.detach(), [3]))


def test_lists_of_tensors_are_stacked():
    rows = [torch.from_numpy(row).requires_grad_() for row in unit_rows(2, 4, seed=4)]
    features = unit_rows(20, 4)
    dfd.bind(features, rows).sum().backward()
    assert all(row.grad.any() for row in rows)
    reaches = [torch.tensor(1.5, requires_grad=True), 1.2]
    dfd.bind(features, [1, 2], reach=reaches).sum().backward()
    assert reaches[0].grad > 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"out": torch.empty(50, 1)}, "`out` must not be given with tensors that require gradients"),
        ({"handles": [[1, 2]]}, "`handles` must be vertices or feature rows to have gradients, not regions"),
        ({"handles": [[1, 2], [3]]}, "`handles` must be"),
        ({"reach": -1.0}, "`reach` must be above 0"),
        ({"reach": [torch.ones(2, requires_grad=True), 1.0]}, "`reach` must have items of one shape"),
        ({"handles": [torch.ones(3, requires_grad=True), torch.ones(4)]}, "`handles` must be"),
    ],
)
def test_refusals(arguments, message):
    features = torch.from_numpy(unit_rows(50, 12)).requires_grad_()
    with pytest.raises(ValueError, match="^bind: " + message):
        dfd.bind(**{"features": features, "handles": [1]} | arguments)


def test_compact_features_have_no_gradients():
    rows = torch.from_numpy(unit_rows(1, 12)).requires_grad_()
    with pytest.raises(ValueError, match="^bind: `features` must not be compact to have gradients"):
        dfd.bind(dfd.compact(unit_rows(50, 12)), rows)
