"""Compare numbers with recorded ones, and round them for a record."""

import json

import numpy as np


def same(one, other, rtol, atol):
    """Return whether two documents have equal keys and texts, and equal numbers up to the tolerances."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[key], other[key], rtol, atol) for key in one)
    if isinstance(one, list | tuple):
        return len(one) == len(other) and all(same(*pair, rtol, atol) for pair in zip(one, other, strict=True))
    if one is None or isinstance(one, str):
        return one == other
    return bool(np.isclose(one, other, rtol=rtol, atol=atol))


def rounded(document, digits):
    """Return a JSON document whose numbers have at most so many significant digits."""
    return json.loads(json.dumps(document), parse_float=lambda number: float(f"{float(number):.{digits}g}"))
