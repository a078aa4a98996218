"""A cache of the results that were used last."""

from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

Result = TypeVar("Result")


class Recent(Generic[Result]):
    """Keep at most `most` results, those that were used last, by everything that they depend on."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._found: dict[Hashable, Result] = {}

    def get(self, key: Hashable, find: Callable[[], Result]) -> Result:
        """Return the result for `key`, found by `find` if it is not kept."""
        found = self._found.pop(key) if key in self._found else find()
        while len(self._found) >= self._most:
            del self._found[next(iter(self._found))]
        self._found[key] = found
        return found
