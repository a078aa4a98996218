"""Answer what programs ask about the weights of handles, from the steps of `SessionWeights`."""

import numpy as np

from dfd.common.linear_algebra import Float32, Float64
from dfd.editing.edit import Edit
from dfd.editing.weights.fill import band_for, band_in, filled, whole
from dfd.editing.weights.held_part import hold
from dfd.editing.weights.session_weights import SessionWeights
from dfd.posing.pose import IDENTITY


def weights_of(session: SessionWeights, edit: Edit) -> Float32:
    """Return the weights (V, H) of Eq. 4 to 7: each column is for a handle and all its counterparts."""
    session.make_room(len(edit.handles))
    found = np.zeros((len(edit.handles), len(session.mesh.vertices)), np.float32)
    for handle, row in zip(edit.handles, found, strict=True):
        held = session.held(edit, handle) if handle.controls.reach == "part" else None
        columns = session.all_columns(edit, handle, held, equalize=False)
        bands = [band_in(column, session.mesh, edit) for column in columns]
        np.minimum(filled(columns, bands, session.mesh).sum(axis=1), 1.0, out=row)
    return found.T


def following(session: SessionWeights, edit: Edit) -> Float32:
    """Return the weights (V, H), where the column of a handle is the sum over its counterparts that move."""
    weights, columns = session.columns(edit)
    followed = np.zeros((len(weights), len(edit.handles)), np.float32)
    for index, column in enumerate(columns):
        followed[:, column.handle] += weights[:, index]
    return followed


def probed(session: SessionWeights, vertex: int, level: int, affine: Float64) -> Float32 | None:
    """Return the weights (V,) of the part at a vertex that `affine` (3, 4) moves; None if there is no part.

    Counterparts are not searched, so this is fast enough to show the part under the pointer.
    """
    mesh, component = session.mesh, session.parts.components(vertex, level)
    if component is None:
        return None
    column = whole(0, hold(mesh, np.minimum(component, 0), vertex, mesh.vertices[vertex]).components[0])
    return filled([column], [band_for(column, affine, IDENTITY, mesh)], mesh)[:, 0]


def check_targets(session: SessionWeights, edit: Edit) -> None:
    """Raise ValueError if fixed points lower the weight at a handle so much that it cannot reach its target.

    A handle that moves a part always reaches its target, unless a fixed region contains it.
    """
    for handle in edit.handles if edit.rules.reach_targets else ():
        contained = any(session.rows.holds(fixed.place, handle.place) for fixed in edit.fixed)
        if not contained and handle.controls.reach == "part" and session.held(edit, handle) is not None:
            continue
        session.by_features.check_left(edit, handle)
