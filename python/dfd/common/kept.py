"""Keep the latest results of the steps of a computation."""

from collections.abc import Callable, Hashable
from typing import Any, TypeVar

Result = TypeVar("Result")


class Kept:
    """The results of several steps: of each step, those that were used last.

    `most` is the number of results of a step that `of_step` does not name. A key contains everything on which a result
    depends.
    """

    def __init__(self, most: int, **of_step: int) -> None:
        self.most, self.of_step = most, of_step
        self._found: dict[str, dict[Hashable, Any]] = {}

    def get(self, step: str, key: Hashable, find: Callable[[], Result]) -> Result:
        """Return the result of a step for `key`. If it is not kept, call `find` and keep its result."""
        found = self._found.setdefault(step, {})
        result: Result = found.pop(key) if key in found else find()
        while len(found) >= self.of_step.get(step, self.most):
            del found[next(iter(found))]
        found[key] = result
        return result
