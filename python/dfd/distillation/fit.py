"""Fit the field's network to target features at surface points, by gradient descent on Eq. 3 in torch."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor
from torch.optim.adam import adam

from dfd.common.devices import one_thread
from dfd.common.linear_algebra import Float32, Float64
from dfd.common.progress import Stages
from dfd.common.threads import get_num_threads
from dfd.encoders.precision import choose_precision
from dfd.field.architecture import Architecture
from dfd.field.component_residuals import ComponentResiduals
from dfd.field.field import Field
from dfd.field.network import Network

if TYPE_CHECKING:
    from dfd.distillation.settings import DistillSettings
    from dfd.distillation.targets import PointTargets, Targets

# Smallest batch size for which matrix products use bfloat16. With the paper's preset, bfloat16 halves the time of the
# fit and increases the loss by 0.1 %.
LARGE_BATCH = 4096
# On the CPU, threads compute chunks of a batch: about _CHUNKS chunks, but each with at least _SMALLEST_CHUNK points,
# and with at most _LARGEST_CHUNK points, because a chunk needs 15 kB of memory for each point.
_CHUNKS, _SMALLEST_CHUNK, _LARGEST_CHUNK = 8, 192, 2048


def fit(
    targets: Targets,
    settings: DistillSettings,
    *,
    center: Float64,
    scale: float,
    device: str | torch.device,
    stages: Stages,
) -> Field:
    """Fit a field to `targets` with Adam, and return the field; its settings hold the loss of every step.

    The loss is the mean of ‖Φ(P) − Z‖² over a batch with points P and targets Z. One generator on the CPU draws initial
    parameters and batches. So a seed gives nearly equal fields on all devices: their features differ by about 1e-3.

    Raises ValueError if the fit diverges (NaN or infinity).

    Parameters
    ----------
    center, scale
        The normalization of the points: the field evaluates the network at `scale` · (point − `center`).
    device
        Torch device. On the CPU, the fit uses `dfd.get_num_threads()` threads. The result does not depend on the count.
    """
    architecture = Architecture(targets.dimension, settings.width, settings.layers, settings.octaves)
    generator = torch.Generator().manual_seed(settings.seed)
    network = Network(architecture).draw(generator).to(device)
    batches, steps = _batches(targets, settings, generator)
    optimizer = Adam(network)
    losses: list[Tensor] = []
    # torch has a separate thread count for each calling thread, so each worker sets its count to 1.
    workers = ThreadPoolExecutor(get_num_threads(), "dfd-fit", initializer=torch.set_num_threads, initargs=(1,))
    large = settings.batch is None or settings.batch >= LARGE_BATCH
    bfloat16 = large and choose_precision(device) == "bfloat16"
    with _exact_float32(), one_thread(), workers as pool, stages.stage("fit", steps) as advance:
        for (points, wanted), (rate, momentum) in zip(batches, schedule(settings, steps), strict=True):
            loss, gradients = _gradients(network, points.to(device), wanted.to(device), pool, bfloat16=bfloat16)
            optimizer.step(gradients, rate, momentum)
            losses.append(loss)
            advance()
    parameters = network.arrays()
    if not all(np.isfinite(values).all() for values in parameters.values()):
        rate = settings.learning_rate
        raise ValueError(f"distill: `learning_rate` {rate:g} is too high: the fit diverged to NaN or infinity")
    made = {"losses": torch.stack(losses).tolist()}
    return Field(parameters, octaves=settings.octaves, center=center, scale=scale, settings=made)


def _gradients(
    network: Network, points: Tensor, wanted: Tensor, pool: Executor, *, bfloat16: bool
) -> tuple[Tensor, list[Tensor]]:
    """Return the loss of one batch, and its gradients with respect to the parameters of `network`.

    The batch is `points` (B, 3) and their targets `wanted` (B, d). If `bfloat16` is True, matrix products use bfloat16.

    On the CPU, threads compute chunks of the batch, and the gradients of the chunks are added in order. torch's own
    threads would synchronize many times per step. On a busy machine, this is up to twenty times slower.
    """
    parameters = list(network.parameters())

    def differentiate(chunk: tuple[Tensor, Tensor]) -> tuple[Tensor, ...]:
        with torch.autocast(points.device.type, torch.bfloat16, enabled=bfloat16):
            found = network(chunk[0])
        loss = (found.float() - chunk[1]).square().sum() / len(points)
        return loss.detach(), *torch.autograd.grad(loss, parameters)

    size = min(max(_SMALLEST_CHUNK, -(-len(points) // _CHUNKS)), _LARGEST_CHUNK)
    if points.is_cuda:
        size = len(points)
    chunks = [(points[begin : begin + size], wanted[begin : begin + size]) for begin in range(0, len(points), size)]
    found = pool.map(differentiate, chunks)
    loss: Tensor
    loss, *gradients = (functools.reduce(torch.add, each) for each in zip(*found, strict=True))
    return loss, gradients


def _batches(
    targets: Targets, settings: DistillSettings, generator: torch.Generator
) -> tuple[Iterator[tuple[Tensor, Tensor]], int]:
    """Return an iterator over the batches (points and targets), one for each step, and the number of steps.

    With the setting `batch_views`, a batch has all points of a few pictures, and each epoch shuffles the pictures. With
    `batch` and `epochs`, each epoch shuffles the points. With `batch` and `steps`, each batch is drawn at random.
    """
    if settings.batch is not None and settings.steps is not None:
        return (targets.draw(settings.batch, generator) for _ in range(settings.steps)), settings.steps
    pictures = None if settings.batch_views is None else targets.pictures()
    count, size = len(targets.points if pictures is None else pictures), settings.batch or settings.batch_views or 1
    steps = settings.steps or (settings.epochs or 1) * math.ceil(count / size)

    def shuffled() -> Iterator[tuple[Tensor, Tensor]]:
        while True:
            for chosen in torch.randperm(count, generator=generator).split(size):  # type: ignore[no-untyped-call]
                yield targets.at(chosen if pictures is None else torch.cat([pictures[each] for each in chosen]))

    return itertools.islice(shuffled(), steps), steps


class Adam:
    """The optimizer Adam, by torch's fused function. torch's own class imports a compiler, which takes two seconds."""

    def __init__(self, network: Network) -> None:
        self._parameters = [parameter.detach() for parameter in network.parameters()]
        self._means = [torch.zeros_like(parameter) for parameter in self._parameters]
        self._squares = [torch.zeros_like(parameter) for parameter in self._parameters]
        self._steps = [torch.zeros((), device=parameter.device) for parameter in self._parameters]

    def step(self, gradients: list[Tensor], rate: float, momentum: float) -> None:
        """Change the parameters by one step with the learning rate `rate` and the momentum (β₁) `momentum`."""
        state = self._parameters, gradients, self._means, self._squares, list[Tensor](), self._steps
        options: dict[str, Any] = {"amsgrad": False, "weight_decay": 0.0, "maximize": False}
        adam(*state, fused=True, beta1=momentum, beta2=0.999, lr=rate, eps=1e-8, **options)


def schedule(settings: DistillSettings, steps: int) -> Iterator[tuple[float, float]]:
    """Yield the learning rate and momentum (β₁) of every step, which are constant or follow one cycle.

    The cycle follows Smith and Topin, "Super-convergence" (2019), with the defaults of
    `torch.optim.lr_scheduler.OneCycleLR`.
    """
    peak = settings.learning_rate
    if settings.schedule == "constant":
        return iter([(peak, 0.9)] * steps)
    top, last = 0.3 * max(steps, 2) - 1, max(steps, 2) - 1

    def between(start: float, end: float, phase: float) -> float:
        return end + (start - end) * (1 + math.cos(math.pi * phase)) / 2

    def at(step: int) -> tuple[float, float]:
        if step <= top:
            phase = step / top if top > 0 else 1.0
            return between(peak / 25, peak, phase), between(0.95, 0.85, phase)
        phase = (step - top) / (last - top)
        return between(peak, peak / 25e4, phase), between(0.85, 0.95, phase)

    return map(at, range(steps))


@contextmanager
def _exact_float32() -> Iterator[None]:
    """Disable TF32 and other reduced precisions in torch's matrix products in the `with` block."""
    precision = torch.get_float32_matmul_precision()
    torch.set_float32_matmul_precision("highest")
    try:
        yield
    finally:
        torch.set_float32_matmul_precision(precision)


# Residuals of a connected component with n points are multiplied by n / (n + SHRINKAGE): if n is low, they are noisy.
SHRINKAGE = 10


def fit_component_residuals(field: Field, targets: PointTargets) -> Field:
    """Return `field`, which was fitted to `targets`, with residuals for each connected component of the surface.

    If the surface has one component, `field` is returned unchanged.
    """
    component, boxes = targets.component, targets.boxes
    if component is None or boxes is None:
        return field
    missed = targets.targets - field(field.center + targets.points / field.scale)
    size = np.bincount(component, minlength=len(boxes))
    missed *= (size / (size + SHRINKAGE))[component, None].astype(np.float32)
    residuals = ComponentResiduals(boxes.astype(np.float32), targets.points, component, missed.astype(np.float16))
    return field.with_residuals(residuals)


def widen(field: Field, directions: Float32) -> Field:
    """Return a field whose features are the features of `field` (dimension d) multiplied by `directions` (d, D).

    The rows of `directions` are orthonormal, so features keep their length. Only the last layer and residuals change.
    """
    last = list(field.parameters)[-2:]  # weight and bias of the last linear map
    turned: dict[str, Any] = {name: directions.T @ field.parameters[name] for name in last}
    return Field(
        {**field.parameters, **turned},
        octaves=field.architecture.octaves,
        center=field.center,
        scale=field.scale,
        settings=field.settings,
        residuals=None if field.residuals is None else field.residuals.widened(directions),
    )
