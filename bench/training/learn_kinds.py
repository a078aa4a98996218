"""Learn to tell kinds of parts from features, for the metric, from points of many labelled shapes."""

from collections import Counter
from collections.abc import Sequence

import numpy as np
import torch
from torch import nn

from bench.training.vertex_features import Lesson
from dfd.common.linear_algebra import Float32, Float64, Int64
from dfd.distillation.metric import Kinds

KINDS = ("ear", "horn", "trunk", "wing", "fin", "tail", "foot", "leg", "neck", "head", "torso", "hand", "arm")
SAME = {"body": "torso", "hoof": "foot"}
HIDDEN = 256
POINTS = 80  # of a part
STEPS, BATCH, LEARNING_RATE, DECAY = 400, 1024, 3e-3, 0.05
DROPPED, DROPPED_UNITS = 0.2, 0.5  # dropout: fractions of the inputs and of the hidden units
UNSURE = 0.05  # label smoothing, so that the network is less certain of unknown shapes
FAMILY_POWER = 0.5  # a family has the weight of the square root of its shapes
SCALE = 20.0  # about √384, so that the inputs are near one


def learn_kinds(taught: Sequence[Lesson]) -> Kinds:
    """Return a network that tells the kinds of parts, learned from all shapes with at least two of `KINDS`.

    A family has the weight of the square root of its number of shapes, shared by its shapes and by their parts.
    """
    generator = np.random.default_rng(0)
    rows, kinds, chances = [], [], []
    size = Counter(each.family for each in taught)
    for each in taught:
        named = [(SAME.get(name, name), points) for name, points in each.kinds if len(points)]
        known = [(name, points) for name, points in named if name in KINDS]
        for name, points in known if len(known) > 1 else ():
            some = generator.choice(len(points), min(POINTS, len(points)), replace=False)
            rows.append((points[some] - each.mean) * np.float32(SCALE))
            kinds.append(np.full(len(some), KINDS.index(name)))
            chances.append(np.full(len(some), 1 / (size[each.family] ** FAMILY_POWER * len(known) * len(some))))
    return _fitted(np.concatenate(rows), np.concatenate(kinds), np.concatenate(chances), generator)


def _fitted(rows: Float32, kinds: Int64, chances: Float64, generator: np.random.Generator) -> Kinds:
    """Fit the network to the `kinds` (N,) of `rows` (N, D), which are drawn with probabilities `chances` (N,)."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)  # one thread gives reproducible sums
    x, y, until = torch.from_numpy(rows), torch.from_numpy(kinds), np.cumsum(chances / chances.sum())
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(int(generator.integers(2**31)))
        hidden, output = nn.Linear(rows.shape[1], HIDDEN), nn.Linear(HIDDEN, len(KINDS))
        network = nn.Sequential(nn.Dropout(DROPPED), hidden, nn.ReLU(), nn.Dropout(DROPPED_UNITS), output)
        optimizer = torch.optim.AdamW(network.parameters(), lr=LEARNING_RATE, weight_decay=DECAY)
        schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, STEPS)
        for _ in range(STEPS):
            drawn = torch.from_numpy(np.searchsorted(until, generator.random(BATCH)).clip(max=len(until) - 1))
            loss = nn.functional.cross_entropy(network(x[drawn]), y[drawn], label_smoothing=UNSURE)
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            schedule.step()
    torch.set_num_threads(threads)
    weights, *others = (each.detach().numpy().T.copy() for each in network.parameters())
    return Kinds(weights * np.float32(SCALE), *others)
