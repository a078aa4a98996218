"""Make sessions that share the mirror planes and parts of one shape, which take most of the time of a new session."""

from collections.abc import Callable
from typing import Any

import dfd


def sessions_on(mesh: dfd.Mesh, field: dfd.Field, features: Any) -> Callable[..., dfd.Deformer]:
    """Return a function that makes a session without handles, with a preset."""
    planes = dfd.symmetry_planes(mesh, field)
    parts = dfd.Deformer(mesh, field, features=features).bound.prepare(planes)

    def session(preset: Any = "default") -> dfd.Deformer:
        made = dfd.Deformer(mesh, field, preset=preset, features=features)
        made.bound.prepare(planes, parts)
        return made

    return session
