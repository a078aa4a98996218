"""What a distillation has done so far, kept in a folder, so that one that was stopped can go on bit for bit.

The folder holds the recipe, the tokens of each picture, and the state of the fit. Every file appears whole
or not at all and is named by what it was made from, so that a piece which does not belong here is never taken up.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import threading
import time
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dfd.common.files import atomic_write
from dfd.runs.recipe import difference, digest, summed

# torch is not needed to look at a folder, only for the state of a fit.
if TYPE_CHECKING:
    import torch

    from dfd.common.progress import Stages
    from dfd.encoders.encode import Encoder

__all__ = ["Checkpoint", "FitState"]

SECONDS = 2.0  # between two saved states of a fit: what a killed process loses at most
_RECIPE = "recipe.json"
# With what an abrupt end left unfinished. The recipe goes last: it is what makes the folder ours.
_PIECES = ("tokens-*.npy", ".tokens-*.npy", "fit-*.pt", ".fit-*.pt", ".recipe.*.json", _RECIPE)


class Stateful(Protocol):
    """A network, an optimizer or a schedule."""

    def state_dict(self) -> dict[str, Any]:
        """Everything that its next step depends on."""

    def load_state_dict(self, state_dict: dict[str, Any]) -> Any:
        """Be what `state_dict` was taken from."""


class Checkpoint:
    """The folder of one run.

    Parameters
    ----------
    folder
        Made if it is not there; of a run with another recipe it is emptied, with a warning.
    recipe
        All that the result depends on, see `dfd.runs.recipe`.

    Raises
    ------
    ValueError
        If the folder holds something else.
    OSError
        If it cannot be made or written.
    """

    def __init__(self, folder: str | os.PathLike[str], recipe: Mapping[str, Any]) -> None:
        self.folder = Path(folder)
        self._recipe = digest(recipe)
        self._told = False
        self._telling = threading.Lock()  # pictures are written by the threads that encode them
        if self.folder.exists() and not self.folder.is_dir():
            raise NotADirectoryError(f"distill: `checkpoint` must be a folder, but {self.folder} is a file")
        if not self.folder.parent.is_dir():
            raise FileNotFoundError(f"distill: `checkpoint`: the folder {self.folder.parent} does not exist")
        before = _read_recipe(self.folder / _RECIPE)
        if before is None and any(not path.name.startswith(".") for path in _listed(self.folder)):
            raise ValueError(f"distill: `checkpoint` must be a new folder or one of an earlier run, got {self.folder}")
        if before is not None and before != dict(recipe):
            warnings.warn(
                f"distill: {self.folder} was begun with other settings ({difference(before, recipe)}): "
                "it is begun anew",
                UserWarning,
                stacklevel=3,
            )
            self._empty()
            before = None
        if before is None:
            try:
                self.folder.mkdir(exist_ok=True)
            except OSError as error:
                raise OSError(
                    error.errno, f"distill: `checkpoint`: {self.folder} cannot be made: {error.strerror}"
                ) from error
            with atomic_write(self.folder / _RECIPE, "checkpoint") as temporary:
                temporary.write_text(json.dumps(dict(recipe), indent=2, sort_keys=True), "utf-8")

    @staticmethod
    def discard(folder: str | os.PathLike[str], recipe: Mapping[str, Any]) -> None:
        """Take away what an earlier run of `recipe` left in `folder`; anything else stays."""
        if _read_recipe(Path(folder) / _RECIPE) == dict(recipe):
            Checkpoint(folder, recipe).remove()

    def encode(
        self, model: Encoder, images: NDArray[np.uint8], covered: NDArray[np.bool_], *, stages: Stages
    ) -> NDArray[np.float32]:
        """Do what `model.encode` does; pictures that were encoded before are read."""
        names = [
            f"tokens-{self._digest(np.array(number), image, shown)}.npy"
            for number, (image, shown) in enumerate(zip(images, covered, strict=True))
        ]
        known = {number: tokens for number, name in enumerate(names) if (tokens := self._read_tokens(name)) is not None}
        left = [number for number in range(len(images)) if number not in known]

        def keep(which: int, tokens: NDArray[np.float32]) -> None:
            stream = io.BytesIO()
            np.save(stream, tokens, allow_pickle=False)
            self._write(names[left[which]], stream.getbuffer())

        if left:
            made = model.encode(images[left], covered=covered[left], done=keep, stages=stages)
            known |= dict(zip(left, made, strict=True))
        return np.stack([known[number] for number in range(len(images))])

    def fit_state(self, *made_from: NDArray[Any]) -> FitState:
        """Return the place for the state of a fit to the arrays `made_from`."""
        return FitState(self, f"fit-{self._digest(*made_from)}.pt")

    def remove(self) -> None:
        """Take the folder away; what else somebody put into it stays."""
        self._empty()
        with contextlib.suppress(OSError):
            self.folder.rmdir()

    def _empty(self) -> None:
        for pattern in _PIECES:
            for path in self.folder.glob(pattern):
                with contextlib.suppress(OSError):
                    path.unlink()

    def _digest(self, *arrays: NDArray[Any]) -> str:
        return digest({"recipe": self._recipe, "made from": summed(*arrays)})[:32]

    def _read_tokens(self, name: str) -> NDArray[np.float32] | None:
        try:
            tokens = np.load(self.folder / name, allow_pickle=False)
        except (OSError, ValueError, EOFError):
            return None
        sound = tokens.dtype == np.float32 and tokens.ndim == 3 and np.isfinite(tokens).all()
        return tokens if sound else None

    def _write(self, name: str, content: memoryview | bytes) -> None:
        try:
            with atomic_write(self.folder / name, "checkpoint") as temporary:
                temporary.write_bytes(content)
        except OSError as error:  # the work itself can go on
            with self._telling:
                told, self._told = self._told, True
            if not told:
                warnings.warn(
                    f"distill: {error.strerror or error}; the run goes on, but could not be taken up again from here",
                    RuntimeWarning,
                    stacklevel=4,
                )


class FitState:
    """The state of a fit: read once before its first step, written every few seconds."""

    def __init__(self, checkpoint: Checkpoint, name: str) -> None:
        self._checkpoint, self._name = checkpoint, name
        self._saved = time.monotonic()

    def restore(self, parts: Mapping[str, Stateful], generator: torch.Generator) -> list[torch.Tensor]:
        """Bring `parts` and `generator` to where an earlier run left them; return the losses of its steps.

        Without an earlier run nothing changes and there are none.
        """
        import torch

        try:
            content = (self._checkpoint.folder / self._name).read_bytes()
            state = torch.load(io.BytesIO(content), map_location="cpu", weights_only=True)
            losses, kept, drawn = state["losses"], state["parts"], state["generator"]
        except Exception:  # absent or damaged, in whatever way a pickle can be: the steps are done again
            return []
        for name, part in parts.items():
            part.load_state_dict(kept[name])
        generator.set_state(drawn)
        return list(losses)

    def keep(self, losses: list[torch.Tensor], parts: Mapping[str, Stateful], generator: torch.Generator) -> None:
        """Write the state after a step, if the last time is a while ago."""
        if time.monotonic() - self._saved < SECONDS:
            return
        import torch

        stream = io.BytesIO()
        state = {name: part.state_dict() for name, part in parts.items()}
        so_far = torch.stack([loss.cpu() for loss in losses])  # some were read, and lie there already
        torch.save({"losses": so_far, "parts": state, "generator": generator.get_state()}, stream)
        self._checkpoint._write(self._name, stream.getbuffer())
        self._saved = time.monotonic()


def _read_recipe(path: Path) -> dict[str, Any] | None:
    try:
        content = json.loads(path.read_text("utf-8"))
    except (OSError, ValueError):
        return None
    return content if isinstance(content, dict) else None


def _listed(folder: Path) -> list[Path]:
    return list(folder.iterdir()) if folder.is_dir() else []
