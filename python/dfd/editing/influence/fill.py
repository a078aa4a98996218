"""Fill columns of weights for a motion: the only module that knows blend bands.

In the blend band of a component, weights fall from 1 to 0 along the surface. The largest strain in the band, which is
the displacement of the border divided by the width of the band, is at most `STRAIN` as long as there is room. So
weights are a continuous function of depth and of the motion, and a frame only evaluates it at the vertices of bands.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dfd.common.linear_algebra import Float32, Float64
from dfd.editing.edit import Edit, box_center
from dfd.editing.influence.hold import Component
from dfd.editing.influence.plan import Column, Piece
from dfd.mesh.mesh import Mesh
from dfd.posing.pose import IDENTITY

STRAIN = 0.5  # a twist of 30° per radius; with less, motions of a limb reach far into the body
STEEPEST = 1.5  # largest slope of `weights_at` for a band of width 1
# The width of a band at rest: REST diagonals of the bounding box, but at most REST_OF_RADIUS radii of the border. With
# twice this width, the soft IoU of weights and labelled parts falls by 0.007 (`python -m bench.quality labelled`).
REST, REST_OF_RADIUS = 0.0125, 0.2


# A contact stays closed if a motion would open it by more than VISIBLE diagonals of the bounding box, and by more than
# SLIDING times the displacement of its points. So a wheel turns, although its axle is not quite at its center.
VISIBLE, SLIDING = 1e-3, 0.25


class Band(NamedTuple):
    """The distances from the border to both ends of a blend band, in mesh units, and the same for contacts.

    At kept contacts, the weight is 1 if `kept` is 0, and 0 if `loose` is 0. On touched surface, the weight falls from
    `drawn` at the contacts to 0 at the distance `drawn_outward`.
    """

    outward: float
    inward: float
    loose: float = 0.0
    kept: float = 0.0
    drawn: float = 0.0
    drawn_outward: float = 0.0


def band_at_rest(component: Component, diagonal: float) -> Band:
    """Return the band of a component that does not move. `diagonal` is that of the bounding box of the mesh."""
    half = min(REST * diagonal, REST_OF_RADIUS * component.radius) / 2
    loose = VISIBLE * diagonal if component.kept else 0.0
    return Band(min(half, component.outward), min(half, component.inward), loose)


def band_of(component: Component, affine: Float64, default: Float64, diagonal: float) -> Band:
    """Return the band of a component that `affine` (3, 4) moves, while `default` (3, 4) moves its surroundings.

    Displacements along the direction of a limb lengthen it. They widen the band inside the limb, and outside only as
    far as the handle, which has weight 1, leaves no room inside.
    """
    rest = band_at_rest(component, diagonal)
    if component.kept or component.drawing:
        rest = _at_contacts(component, affine, default, VISIBLE * diagonal, rest)
    if not len(component.border):
        return rest
    with np.errstate(over="ignore", invalid="ignore"):
        relative = affine - default
        moved = component.border @ relative[:, :3].T + relative[:, 3]
        along = (moved @ component.direction).clip(0.0)
        across = np.linalg.norm(moved - along[:, None] * component.direction, axis=1)
        wide, long = STEEPEST / STRAIN * np.array([across.max(), along.max()])
    largest = 4 * (component.outward + component.inward)  # also after an overflow
    wide, long = np.fmin(wide, largest), np.fmin(long, largest)
    outward = min(max(rest.outward, wide / 2, (1 - component.room) * long), component.outward)
    inward = min(max(rest.inward, wide - outward, long), component.inward)
    return rest._replace(outward=float(outward), inward=float(inward))


def _at_contacts(component: Component, affine: Float64, default: Float64, visible: float, rest: Band) -> Band:
    """Return the band `rest` with the widths at the contacts of a component that `affine` (3, 4) moves.

    `default` (3, 4) moves its surroundings. Openings below `visible` mesh units are not closed.
    """
    loose, kept, drawn, outward = rest.loose, 0.0, 0.0, 0.0
    with np.errstate(over="ignore", invalid="ignore"):
        for contact in (*component.kept, *component.drawing):
            opened, moved = contact.motion(affine, default)
            least = max(visible, SLIDING * moved)
            width = STEEPEST / STRAIN * max(opened - least / 2, 0.0)
            if contact in component.kept:
                loose, kept = min(loose, max(least - opened, 0.0)), max(kept, width)
            else:
                drawn = max(drawn, min(max(2 * opened / least - 1, 0.0), 1.0))
                outward = max(outward, width)
    kept, outward = np.fmin(kept, component.free), np.fmin(outward, component.drawn_reach)
    return rest._replace(loose=float(loose), kept=float(kept), drawn=float(drawn), drawn_outward=float(outward))


def widest(bands: Sequence[Band]) -> Band:
    """Return the band that is as wide as the widest of `bands`, and keeps each contact that one of them keeps."""
    return Band(*map(max, zip(*bands, strict=True)))._replace(loose=min(band.loose for band in bands))


def bands_of(column: Column, mesh: Mesh, edit: Edit) -> tuple[Band, ...]:
    """Return the bands of the pieces of a column, for the motion of its handle in `edit`."""
    default = IDENTITY if edit.default is None else edit.default.matrix(box_center(mesh))
    matrix = column.matrix(edit, most=180.0)  # a border that comes back after a whole turn still needs a wide band
    return tuple(band_of(piece.component, matrix, default, mesh.diagonal) for piece in column.pieces)


def weights_in(component: Component, band: Band) -> Float32:
    """Return the weights (M,) at `Component.vertices`, without shares."""
    weights = weights_at(component.depth, band)
    if component.apart is not None:
        weights *= weights_at(component.apart, Band(band.loose, band.kept))
    if component.drawn is not None and len(component.drawn):
        outward = Band(band.drawn_outward, 0.0)
        weights[-len(component.drawn) :] = np.float32(band.drawn) * weights_at(-component.drawn, outward)
    return weights


def weights_at(depth: Float32, band: Band) -> Float32:
    """Return the weights (N,) at `depth` (N,): 1 at the inner end of the band, 0 at the outer end, smooth between."""
    width = np.float32(max(band.outward + band.inward, 1e-30))
    with np.errstate(over="ignore"):
        part = (depth + np.float32(band.outward)) / width
    np.clip(part, 0.0, 1.0, out=part)
    return part * part * (np.float32(3.0) - 2 * part)


def fill(column: Column, bands: Sequence[Band], weights: Float32, *, bands_only: bool = False) -> None:
    """Write the weights of a column to `weights` (V,), which is 0 elsewhere, or was filled for other `bands`.

    With `bands_only`, everything outside of bands is known to be filled already.
    """
    if len(column.pieces) == 1:
        _write(column.pieces[0], bands[0], weights, bands_only)
        return
    if column.pieces:
        weights[:] = 0.0
    for piece, band in zip(column.pieces, bands, strict=True):
        one = np.zeros_like(weights)
        _write(piece, band, one, False)
        np.minimum(weights + one, 1.0, out=weights)
    if column.still is not None:
        weights[column.still.vertices] = column.still.values


def _write(piece: Piece, band: Band, weights: Float32, bands_only: bool) -> None:
    weights[piece.component.vertices] = piece.factor * weights_in(piece.component, band)
    if not bands_only:
        weights[piece.core.vertices] = piece.core.values
