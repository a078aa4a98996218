"""Keep arrays read-only when an object is copied or pickled: NumPy makes the arrays of copies writable."""

from typing import Any

import numpy as np


class ReadOnlyArrays:
    """Base class of objects whose attributes are read-only arrays, or dictionaries of such arrays."""

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Set the attributes of a copy or of an unpickled object."""
        for value in state.values():
            for array in value.values() if isinstance(value, dict) else (value,):
                if isinstance(array, np.ndarray):
                    array.flags.writeable = False
        self.__dict__.update(state)
