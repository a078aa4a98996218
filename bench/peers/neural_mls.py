"""Deform by moving least squares with learned weights; Shechter et al., "NeuralMLS", 2022.

A small network is trained to classify positions: each control point is a class. The class probabilities at a vertex
are the weights of the control points for rigid moving least squares (Schaefer et al., 2006).

The network, the optimizer and its rate are those of the authors' code. They train for 48 steps, after which weights are
so even that handles miss their targets by 3 to 5 % of the diagonal. Here, training ends when handles reach their
targets. Longer training would only separate control points of one group from each other, and fold the surface there.
"""

from itertools import pairwise

import torch

from bench.peers.peer import Bind, Body, Deform
from dfd.common.linear_algebra import Float64, Int64

WIDTH, HIDDEN = 128, 2  # width and number of the hidden layers
STEPS, RATE = 5_000, 6e-4  # largest number of training steps, and learning rate
ENOUGH = 0.02  # training ends if, at control points, the mean of −log(probability of the own group) is at most this
RIDGE = 1e-4  # multiple of the identity that is added to a covariance matrix; an undetermined rotation is then 0
BATCH = 1 << 15  # number of vertices that are computed at once


def neural_mls(body: Body) -> Bind:
    """Prepare NeuralMLS. Held vertices are control points. Binding trains a network."""
    low, high = body.vertices.min(axis=0), body.vertices.max(axis=0)
    center, scale = (low + high) / 2, 2 / (high - low).max()

    def scaled(positions: Float64) -> torch.Tensor:
        return torch.from_numpy((positions - center) * scale)

    points = scaled(body.vertices)

    def bind(held: Int64, group: Int64) -> Deform:
        control = points[held]
        network = trained(control.float(), torch.from_numpy(group))
        with torch.inference_mode():
            weights = [network(some.float()).softmax(dim=1).double() for some in points.split(BATCH)]

        def deform(targets: Float64) -> Float64:
            """Move each vertex rigidly, by the weighted least-squares fit of control points to targets."""
            wanted = scaled(targets)
            pairs = (control[:, :, None] * wanted[:, None]).reshape(-1, 9)
            moved = []
            for some, own in zip(points.split(BATCH), weights, strict=True):
                normalized = own / own.sum(dim=1, keepdim=True)  # float32 sums are not exactly 1
                before, after = normalized @ control, normalized @ wanted
                spread = (normalized @ pairs).reshape(-1, 3, 3) - before[:, :, None] * after[:, None]
                left, _, right = torch.linalg.svd(spread + RIDGE * torch.eye(3, dtype=torch.float64))
                mirror = torch.linalg.det(left @ right)
                left = torch.cat([left[:, :, :2], left[:, :, 2:] * mirror[:, None, None]], dim=2)
                moved.append(torch.einsum("vd,vde->ve", some - before, left @ right) + after)
            return torch.cat(moved).numpy() / scale + center

        return deform

    return bind


def trained(control: torch.Tensor, group: torch.Tensor) -> torch.nn.Module:
    """Train and return a network that maps the position of each of the `control` points (N, 3) to its index.

    Training ends when the network tells the groups (N,) of the control points apart, see `ENOUGH`.
    """
    with torch.random.fork_rng():
        torch.manual_seed(0)
        widths = [3, *[WIDTH] * HIDDEN, len(control)]
        layers = [torch.nn.Linear(before, after) for before, after in pairwise(widths)]
    network = torch.nn.Sequential(*[each for layer in layers for each in (layer, torch.nn.ReLU())][:-1])
    optimizer = torch.optim.Adam(network.parameters(), lr=RATE)
    others = group[:, None] != group
    for _ in range(STEPS):
        optimizer.zero_grad()
        logarithms = network(control).log_softmax(dim=1)
        own_group = logarithms.detach().masked_fill(others, -torch.inf).logsumexp(dim=1)
        if float(-own_group.mean()) <= ENOUGH:
            break
        (-logarithms.diagonal().mean()).backward()
        optimizer.step()
    return network
