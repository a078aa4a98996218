"""A cache with a fixed number of results."""

from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

Result = TypeVar("Result")


class Recent(Generic[Result]):
    """A cache that keeps the `most` results that were used last. A key contains everything that a result depends on."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._found: dict[Hashable, Result] = {}

    def get(self, key: Hashable, find: Callable[[], Result]) -> Result:
        """Return the result for `key`. If the cache does not contain it, call `find` and store its result."""
        found = self._found.pop(key) if key in self._found else find()
        while len(self._found) >= self._most:
            del self._found[next(iter(self._found))]
        self._found[key] = found
        return found
