"""Moving least squares with learned weights; Shechter et al., "NeuralMLS", 2022.

A small network learns which control point lies at a position. Its smooth answers elsewhere are the weights of rigid
moving least squares (Schaefer et al., 2006).
"""

from __future__ import annotations

import time
from itertools import pairwise

import torch

from bench.paper.peers.peer import Body
from dfd.common.linear_algebra import Float64, Int64

WIDTH, HIDDEN = 256, 3
STEPS, RATE = 1_000, 1e-3
ENOUGH = 0.02  # mean cross-entropy at which training ends
MOST_SECONDS = 40.0
STILL = 1e-4  # of the size squared: pulls badly determined rotations towards none
AT_ONCE = 1 << 15


class NeuralMLS:
    """Control points are the held vertices; `bind` trains the network in less than a minute."""

    volume = False

    def prepare(self, body: Body) -> None:
        """Scale the shape to [-1, 1]."""
        low, high = body.vertices.min(axis=0), body.vertices.max(axis=0)
        self.center, self.scale = (low + high) / 2, 2 / (high - low).max()
        self.points = torch.from_numpy(self._scaled(body.vertices))

    def bind(self, held: Int64, group: Int64) -> None:
        """Train the network on the control points, and evaluate it at all vertices."""
        self.control = self.points[held]
        with torch.random.fork_rng():
            torch.manual_seed(0)
            widths = [3, *[WIDTH] * HIDDEN, len(held)]
            layers = [torch.nn.Linear(before, after) for before, after in pairwise(widths)]
        between = [each for layer in layers for each in (layer, torch.nn.ReLU())][:-1]
        network = torch.nn.Sequential(*between)
        optimizer = torch.optim.Adam(network.parameters(), lr=RATE)
        positions, own = self.control.float(), torch.arange(len(held))
        begin = time.perf_counter()
        for _ in range(STEPS):
            optimizer.zero_grad()
            loss = torch.nn.functional.cross_entropy(network(positions), own)
            loss.backward()
            optimizer.step()
            if float(loss.detach()) < ENOUGH or time.perf_counter() - begin > MOST_SECONDS:
                break
        with torch.inference_mode():
            answers = [network(some.float()).softmax(dim=1) for some in self.points.split(AT_ONCE)]
        self.weights = torch.cat(answers)

    def deform(self, targets: Float64) -> Float64:
        """Move every vertex by the rigid motion that fits the control points best, by its weights."""
        wanted = torch.from_numpy(self._scaled(targets))
        pairs = (self.control[:, :, None] * wanted[:, None]).reshape(-1, 9)
        moved = []
        for points, some in zip(self.points.split(AT_ONCE), self.weights.split(AT_ONCE), strict=True):
            weights = some.double()
            weights = weights / weights.sum(dim=1, keepdim=True)  # to more digits than the network's
            before, after = weights @ self.control, weights @ wanted
            spread = (weights @ pairs).reshape(-1, 3, 3) - before[:, :, None] * after[:, None]
            left, _, right = torch.linalg.svd(spread + STILL * torch.eye(3, dtype=torch.float64))
            mirror = torch.linalg.det(left @ right)
            left = torch.cat([left[:, :, :2], left[:, :, 2:] * mirror[:, None, None]], dim=2)
            moved.append(torch.einsum("vd,vde->ve", points - before, left @ right) + after)
        return torch.cat(moved).numpy() / self.scale + self.center

    def _scaled(self, positions: Float64) -> Float64:
        return (positions - self.center) * self.scale
