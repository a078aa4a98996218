"""The fit by our own kernels: to points that are known from the start, on a processor, without torch."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dfd import _core
from dfd.common.progress import Stages
from dfd.common.threads import get_num_threads
from dfd.field.architecture import Architecture

if TYPE_CHECKING:
    from dfd.distillation.settings import DistillSettings
    from dfd.distillation.targets import PointTargets
    from dfd.runs.fit_state import FitState

__all__ = ["fit_on_kernels", "one_cycle"]

_AT_ONCE = 10  # steps between two looks at what else there is to do: progress, an interruption, what is to be kept
_TRIED_ANEW = 4, 64  # threads are timed again after so many times that, which doubles, up to so many
_FASTER = 0.75  # of one thread's time, for all of them to be worth it
_POINTS = 48  # that a thread takes together
_INPUTS, _OUTPUTS = 8, 64  # what the kernels take together: widths are filled up to multiples of it, with zeros
_GROUP = 16  # outputs that lie side by side in a matrix


def fit_on_kernels(
    targets: PointTargets, settings: DistillSettings, *, stages: Stages, state: FitState | None = None
) -> tuple[dict[str, NDArray[np.float32]], list[float]]:
    """Return a network's parameters and the loss of every step; see `dfd.distillation.fit.fit`.

    What is filled up with zeros stays 0: nothing flows into it, and no target asks for it.
    """
    architecture = Architecture(targets.dimension, octaves=settings.octaves)
    inputs = _filled(network_inputs(targets.points, settings.octaves), _INPUTS)
    wanted = _filled(targets.targets, _OUTPUTS)
    widths = [inputs.shape[1], *[architecture.width] * architecture.layers, wanted.shape[1]]
    fitted = np.zeros((3, _core.fit_size(widths)), np.float32)  # values, first and second moments
    fitted[0] = _flat(_first_parameters(architecture, settings.seed), architecture, widths)
    losses: list[float] = state.restore_arrays({"fitted": fitted}, settings.steps) if state else []
    pace = _Pace(min(get_num_threads(), -(-settings.batch // _POINTS)))
    rates, momenta = one_cycle(settings.learning_rate, settings.steps)
    with stages.stage("fit", settings.steps) as advance:
        advance(len(losses))
        while len(losses) < settings.steps:
            begin = len(losses)
            end = min(begin + _AT_ONCE, settings.steps)
            # Drawn by the step that they are for, so that a run goes on with the same ones.
            generator = np.random.default_rng([settings.seed, begin])
            chosen = generator.integers(len(inputs), size=(end - begin, settings.batch), dtype=np.int32)
            lost = np.empty((1, end - begin), np.float32)
            with pace.threads() as threads:
                _core.fit(
                    fitted, widths, inputs, wanted, chosen, rates[begin:end], momenta[begin:end], begin, lost, threads
                )
            losses += lost[0].tolist()
            if state is not None:
                state.keep_arrays(losses, {"fitted": fitted})
            advance(end - begin)
    return _parameters(fitted[0], architecture, widths), losses


class _Pace:
    """How many threads take the next steps: one, or all where they are clearly faster; the bits are the same.

    Steps are many and small: where other programs use the same cores, threads wait for each other several times as long
    as they work. So both are timed, at the beginning and now and then.
    """

    def __init__(self, most: int) -> None:
        self._most, self._best = most, 1
        self._until_timed = 1  # the first steps of all find cold memory, and count for nothing
        self._pause = _TRIED_ANEW[0]
        self._alone = 0.0  # seconds that the last timed steps on one thread took

    @contextmanager
    def threads(self) -> Iterator[int]:
        """Threads for the steps of the block, which is timed."""
        chosen = {0: 1, -1: self._most}.get(self._until_timed, self._best)
        start = time.perf_counter()
        yield chosen
        seconds = time.perf_counter() - start
        if self._until_timed == 0:
            self._alone = seconds
        elif self._until_timed == -1:
            self._best = self._most if seconds < _FASTER * self._alone else 1
            self._until_timed = self._pause + 1
            self._pause = min(2 * self._pause, _TRIED_ANEW[1])
        self._until_timed -= 1


def network_inputs(points: NDArray[np.float32], octaves: int) -> NDArray[np.float32]:
    """What the network is given of normalized points (N, 3), (N, 3 + 6 octaves); see `dfd.field.network`."""
    waves = [points]
    for octave in range(octaves):
        angle = points * np.float32(math.pi / 2 * 2**octave)
        waves += [np.sin(angle), np.cos(angle)]
    return np.concatenate(waves, axis=1)


def one_cycle(rate: float, steps: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Rate and momentum of every step: up for three tenths of them, then down, the momentum the other way.

    Source: Smith and Topin, "Super-convergence" (2019), with cosines as `torch.optim.lr_scheduler.OneCycleLR` has them.
    """
    top = 0.3 * max(steps, 2) - 1
    step = np.arange(steps)
    rising = np.clip(step / top if top > 0 else np.ones(steps), 0, 1)
    falling = np.clip((step - top) / (max(steps, 2) - 1 - top), 0, 1)
    up, down = ((1 + np.cos(np.pi * share)) / 2 for share in (rising, falling))
    before = step <= top
    rates = np.where(before, rate + (rate / 25 - rate) * up, rate / 25e4 + (rate - rate / 25e4) * down)
    momenta = np.where(before, 0.85 + (0.95 - 0.85) * up, 0.95 + (0.85 - 0.95) * down)
    return rates, momenta


def _filled(rows: NDArray[np.float32], whole: int) -> NDArray[np.float32]:
    return np.ascontiguousarray(np.pad(rows, ((0, 0), (0, -rows.shape[1] % whole))))


def _first_parameters(architecture: Architecture, seed: int) -> dict[str, NDArray[np.float32]]:
    """Evenly within ± 1 / √inputs, as torch begins; LayerNorms change nothing yet."""
    generator = np.random.default_rng(seed)
    shapes, names = architecture.shapes(), architecture.layer_names()
    first: dict[str, NDArray[np.float32]] = {}
    for name in names.linear:
        bound = 1 / math.sqrt(shapes[f"{name}.weight"][1])
        for part in (f"{name}.weight", f"{name}.bias"):
            first[part] = generator.uniform(-bound, bound, shapes[part]).astype(np.float32)
    for name in names.norms:
        first |= {f"{name}.weight": np.ones(architecture.width, np.float32)}
        first |= {f"{name}.bias": np.zeros(architecture.width, np.float32)}
    return first


def _pieces(architecture: Architecture, widths: list[int]) -> list[tuple[str, tuple[int, ...]]]:
    """The parameters in the order of the kernels, each with its shape: a matrix as (inputs, outputs)."""
    names = architecture.layer_names()
    pieces: list[tuple[str, tuple[int, ...]]] = []
    for number, name in enumerate(names.linear):
        entering, leaving = widths[number : number + 2]
        pieces += [(f"{name}.weight", (entering, leaving)), (f"{name}.bias", (leaving,))]
        if number < len(names.norms):
            pieces += [(f"{names.norms[number]}.{part}", (leaving,)) for part in ("weight", "bias")]
    return pieces


def _flat(
    parameters: dict[str, NDArray[np.float32]], architecture: Architecture, widths: list[int]
) -> NDArray[np.float32]:
    flat = []
    for name, shape in _pieces(architecture, widths):
        filled = np.zeros(shape, np.float32)
        own = parameters[name].T
        filled[tuple(slice(size) for size in own.shape)] = own
        flat.append(_grouped(filled).ravel() if filled.ndim == 2 else filled)
    return np.concatenate(flat)


def _grouped(matrix: NDArray[np.float32]) -> NDArray[np.float32]:
    """(inputs, outputs) as the kernels have it: (outputs / 16, inputs, 16)."""
    return matrix.reshape(len(matrix), -1, _GROUP).swapaxes(0, 1)


def _ungrouped(groups: NDArray[np.float32]) -> NDArray[np.float32]:
    """The way back."""
    return groups.swapaxes(0, 1).reshape(groups.shape[1], -1)


def _parameters(flat: NDArray[np.float32], architecture: Architecture, widths: list[int]) -> dict[str, Any]:
    """The parameters by name, as a field takes them."""
    found, begin = {}, 0
    for name, shape in _pieces(architecture, widths):
        filled = flat[begin : begin + math.prod(shape)]
        if len(shape) == 2:
            filled = _ungrouped(filled.reshape(-1, shape[0], _GROUP))
        found[name] = np.ascontiguousarray(filled.T[tuple(slice(size) for size in architecture.shapes()[name])])
        begin += math.prod(shape)
    return found
