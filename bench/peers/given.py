"""Add a method of the user to the pages that compare methods: a function of one of two kinds.

A function of three arguments, `function(mesh, handles, targets)`, returns the deformed vertices (V, 3) in mesh units. A
function of two arguments, `function(mesh, handles)`, returns weights (V, K), with which vertices follow the K handles.
`mesh` is a `dfd.Mesh`. `handles` (K,) are vertex indices. `targets` (K, 3) are positions that they shall reach, in mesh
units. Fixed points are handles whose targets are their own positions. Of vertices that move as one handle, because they
are near it, a function of two arguments gets one.
"""

import importlib
import inspect
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

import dfd
from bench.peers.peer import Bind, Body, Deform, Peer, PeerError
from dfd.common.linear_algebra import Float64, Int64


def given(name: str) -> Peer:
    """Return the method that `name`, MODULE:FUNCTION, names.

    Raises ValueError if there is no such function, or if it does not take two or three arguments.
    """
    function(name)
    return Peer(partial(prepare, name=name))


def function(name: str) -> tuple[Callable[..., Any], int]:
    """Return the function that `name`, MODULE:FUNCTION, names, and the number of its arguments."""
    module, _, attribute = name.partition(":")
    try:
        found = getattr(importlib.import_module(module), attribute)
        count = len(inspect.signature(found).parameters)
    except (ImportError, AttributeError, TypeError, ValueError) as error:
        raise ValueError(f"--method must be MODULE:FUNCTION, got {name}: {error}") from None
    if count not in (2, 3):
        raise ValueError(
            f"--method: {name} must take (mesh, handles) or (mesh, handles, targets), got {count} arguments"
        )
    return found, count


def prepare(body: Body, name: str) -> Bind:
    """Return the binding of the method that `name` names."""
    method, count = function(name)
    mesh = dfd.Mesh(body.vertices, body.faces)

    def bind(held: Int64, group: Int64) -> Deform:
        if count == 3:
            return lambda targets: _checked(method(mesh, held, targets), body.vertices.shape, name)
        moving, first = np.unique(group, return_index=True)
        kept = np.concatenate([first[moving >= 0], np.flatnonzero(group < 0)])
        weights = _checked(method(mesh, held[kept]), (len(body.vertices), len(kept)), name)
        return lambda targets: body.vertices + weights @ (targets[kept] - body.vertices[held[kept]])

    return bind


def _checked(array: Any, shape: tuple[int, ...], name: str) -> Float64:
    found = np.asarray(array, np.float64)
    if found.shape != shape:
        raise PeerError(f"{name} must return an array of the shape {shape}, got {found.shape}")
    return found
