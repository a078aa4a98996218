"""The state of a fit, kept while it lasts."""

from __future__ import annotations

import copy
import io
import time
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import safetensors.numpy
from numpy.typing import NDArray
from safetensors import SafetensorError

from dfd.runs.pieces import PieceFolder

# torch is not needed to look at a folder.
if TYPE_CHECKING:
    import torch

__all__ = ["FitState", "Stateful"]

_LOSSES = "losses"
SECONDS = 2.0  # between two saved states: what a killed process loses at most


class Stateful(Protocol):
    """A network, an optimizer or a schedule."""

    def state_dict(self) -> dict[str, Any]:
        """Everything that its next step depends on."""

    def load_state_dict(self, state_dict: dict[str, Any]) -> Any:
        """Be what `state_dict` was taken from."""


class FitState:
    """The state of a fit: read once before its first step, written every few seconds."""

    def __init__(self, pieces: PieceFolder, name: str) -> None:
        self._pieces, self._name = pieces, name
        self._saved = time.monotonic()

    def restore(self, parts: Mapping[str, Stateful], generator: torch.Generator, most_steps: int) -> list[torch.Tensor]:
        """Bring `parts` and `generator` to where an earlier run left them; return the losses of its steps.

        Without an earlier run nothing changes and there are none. A state that is damaged, or does not fit `parts` or
        `most_steps`, counts as none, and is said to be begun anew.
        """
        import torch

        content = self._pieces.read(self._name)
        if content is None:
            return []
        before = {name: copy.deepcopy(part.state_dict()) for name, part in parts.items()}
        drawn = generator.get_state()
        try:
            state = torch.load(io.BytesIO(content), map_location="cpu", weights_only=True)
            losses = state["losses"]
            if losses.ndim != 1 or len(losses) > most_steps:
                raise ValueError("another number of steps")
            for name, part in parts.items():
                part.load_state_dict(state["parts"][name])
            generator.set_state(state["generator"])
        except Exception:  # whatever torch makes of what it did not write
            for name, part in parts.items():
                part.load_state_dict(before[name])
            generator.set_state(drawn)
            self._pieces.reject(self._name)
            return []
        return list(losses)

    def restore_arrays(self, arrays: Mapping[str, NDArray[Any]], most_steps: int) -> list[float]:
        """Bring `arrays` to where an earlier run left them; return the losses of its steps, as `restore` does."""
        content = self._pieces.read(self._name)
        if content is None:
            return []
        try:
            state = safetensors.numpy.load(content)
            losses = state[_LOSSES]
            fits = all(
                state[name].shape == own.shape and state[name].dtype == own.dtype for name, own in arrays.items()
            )
            if losses.ndim != 1 or len(losses) > most_steps or not fits:
                raise ValueError("another number of steps, or of numbers")
        except (SafetensorError, KeyError, ValueError):
            self._pieces.reject(self._name)
            return []
        for name, own in arrays.items():
            own[:] = state[name]
        return [float(loss) for loss in losses]

    def keep_arrays(self, losses: Sequence[float], arrays: Mapping[str, NDArray[Any]]) -> None:
        """Write `arrays` after a step, if the last time is a while ago."""
        if time.monotonic() - self._saved < SECONDS:
            return
        state = {_LOSSES: np.array(losses, np.float32), **arrays}
        self._pieces.write(self._name, safetensors.numpy.save(state))
        self._saved = time.monotonic()

    def keep(self, losses: list[torch.Tensor], parts: Mapping[str, Stateful], generator: torch.Generator) -> None:
        """Write the state after a step, if the last time is a while ago."""
        if time.monotonic() - self._saved < SECONDS:
            return
        import torch

        stream = io.BytesIO()
        state = {name: part.state_dict() for name, part in parts.items()}
        so_far = torch.stack([loss.cpu() for loss in losses])  # some were read, and lie there already
        torch.save({"losses": so_far, "parts": state, "generator": generator.get_state()}, stream)
        self._pieces.write(self._name, stream.getbuffer())
        self._saved = time.monotonic()
