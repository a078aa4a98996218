"""One distillation made safe: looked up first, kept while it lasts, stored at its end."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dfd.runs import field_cache
from dfd.runs.checkpoint import Checkpoint, FitState
from dfd.runs.field_cache import CachedField, Found

# torch is not needed for what the cache has.
if TYPE_CHECKING:
    from dfd.common.progress import Stages
    from dfd.encoders.encode import Encoder
    from dfd.field.field import Field

__all__ = ["Run"]


class Run:
    """A distillation by its `recipe`, with its place in the cache and its checkpoint if wanted.

    Parameters
    ----------
    recipe
        All that the result depends on.
    cache
        Whether the user's cache is looked into and added to.
    checkpoint
        The folder that keeps what is done; None keeps nothing.
    """

    def __init__(self, recipe: Mapping[str, Any], cache: bool, checkpoint: str | os.PathLike[str] | None) -> None:
        self._recipe = recipe
        self._cache = cache
        self._folder = checkpoint
        self._kept: Checkpoint | None = None

    def found(self) -> Field | None:
        """The field, where the cache has it already; what an earlier run left undone is of no use then."""
        return self._served(field_cache.find(self._recipe) if self._cache else None)

    def found_file(self) -> CachedField | None:
        """As `found`, for the file alone."""
        return self._served(field_cache.find_file(self._recipe) if self._cache else None)

    def _served(self, found: Found | None) -> Found | None:
        if found is not None and self._folder is not None:
            Checkpoint.discard(self._folder, self._recipe)
        return found

    def begin(self) -> None:
        """Make the checkpoint, or take up the one that is there.

        Raises
        ------
        ValueError, OSError
            See `Checkpoint`.
        """
        if self._folder is not None:
            self._kept = Checkpoint(self._folder, self._recipe)

    def encode(
        self, model: Encoder, images: NDArray[np.uint8], covered: NDArray[np.bool_], *, stages: Stages
    ) -> NDArray[np.float32]:
        """Do what `model.encode` does, less what an earlier run has done."""
        if self._kept is None:
            return model.encode(images, covered=covered, stages=stages)
        return self._kept.encode(model, images, covered, stages=stages)

    def fit_state(self, *made_from: NDArray[Any]) -> FitState | None:
        """The place for the state of a fit to the arrays `made_from`; None where nothing is kept."""
        return self._kept.fit_state(*made_from) if self._kept else None

    def finish(self, field: Field) -> Field:
        """Return `field` on the CPU, stored in the cache; the checkpoint has served."""
        field = field.cpu()
        if self._cache:
            field_cache.store(self._recipe, field)
        if self._kept is not None:
            self._kept.remove()
        return field

    @contextmanager
    def step(self, needs: str, advice: str) -> Iterator[None]:
        """Watch over a part of the work that takes memory for what it `needs`.

        Raises
        ------
        MemoryError
            With `advice`, when memory runs out in whatever way.
        ValueError
            What the work itself raises: a checkpoint goes then, for it would only lead here again.
        """
        try:
            yield
        except ValueError:
            if self._kept is not None:
                self._kept.remove()
            raise
        except (MemoryError, RuntimeError) as error:
            from dfd.common.devices import out_of_memory

            if not out_of_memory(error) or str(error).startswith("encode: "):
                raise
            raise MemoryError(f"distill: too little memory for {needs}: {advice}") from error
