"""Fill columns with weights for a motion: the only code that makes a weight of a session.

In the blend band of a component, weights fall from 1 to 0 along the surface. The largest strain in the band, which is
the displacement of the border divided by the width of the band, is at most `STRAIN` as long as there is room. So
weights are a continuous function of depth and of the motion, and a frame only evaluates it at the vertices of bands.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dfd.common.linear_algebra import Float32, Float64, Int32, Int64
from dfd.editing.edit import Edit, box_center
from dfd.editing.weights.contacts import Contacts
from dfd.geometry.coarse import Share
from dfd.mesh.mesh import Mesh
from dfd.posing.pose import IDENTITY

STRAIN = 0.5  # a twist of 30° per radius; with less, motions of a limb reach far into the body
STEEPEST = 1.5  # largest slope of `weights_at` for a band of width 1
# The width of a band at rest: REST diagonals of the bounding box, but at most REST_OF_RADIUS radii of the border. With
# twice this width, the soft IoU of weights and labelled parts falls by 0.007 (`python -m bench.quality labelled`).
REST, REST_OF_RADIUS = 0.0125, 0.2
# A contact stays closed if a motion would open it by more than VISIBLE diagonals of the bounding box, and by more than
# SLIDING times the displacement of its points. So a wheel turns, although its axle is not quite at its center: with 0,
# it bends the axle if its pivot lies 0.8 % of its radius beside it. The figures in `contacts.py` hold from 0 to 0.5.
VISIBLE, SLIDING = 1e-3, 0.25

LEAST_DEPTH = 1e-3  # depths are raised until that of the handle is at least this, in radii, also after smoothing

Factor = Callable[[NDArray[np.integer]], Float64]  # a function of vertices (N,)


@dataclass(frozen=True, eq=False)
class Counterpart:
    """The place on a component that corresponds to a handle. The first counterpart of a handle is the handle itself."""

    vertex: int  # the vertex nearest to the handle or to its mirror image, or the vertex most similar to the handle
    # position: (3,) mesh units: that of the handle, of its mirror image if `image` is given, or else of `vertex`, or on
    # a round component, the place that lies to its center as the handle lies to that of its own component
    position: tuple[float, float, float]
    frame: Float64  # (3, 3) orthogonal matrix that maps directions at the handle to directions at the counterpart
    # image: (3, 4) isometry that maps the component at the handle onto this component; None if there is none
    image: Float64 | None = None

    def transform(self, affine: Float64, position: Sequence[float]) -> Float64:
        """Return the transform (…, 3, 4) of this counterpart for `affine` (…, 3, 4) of a handle at `position` (3,)."""
        here, there = np.asarray(self.position), np.asarray(position, np.float64)
        # In these two cases, the equation below would only add rounding errors.
        if np.array_equal(affine, IDENTITY) or (np.array_equal(here, there) and (self.frame == np.eye(3)).all()):
            return affine
        linear = self.frame @ affine[..., :3] @ self.frame.T
        moved = affine[..., :3] @ there + affine[..., 3] - there  # displacement of the handle
        return np.concatenate([linear, (here + moved @ self.frame.T - linear @ here)[..., None]], axis=-1)


@dataclass(frozen=True, eq=False)
class Component:
    """A connected component of a part, such as a leg, at rest. Lengths are in mesh units.

    Letters are those of Eq. 9 to 12 in docs/how_it_works/method.md.
    """

    counterpart: Counterpart  # the handle itself, or the place on this component that corresponds to it
    border: Float64  # (B, 3) points of the component's border; none if a whole piece of the mesh is the component
    # direction: (3,) unit vector from the border to the middle; 0 without a border, or if several lie on two sides
    direction: Float64
    radius: float  # r: mean radius of the borders (`held_part.OUTSIDE`); 0 without a border
    outward: float  # O: largest distance of the band's outer end from the border
    inward: float  # N: largest distance of the band's inner end from the border
    link: float  # L: largest depth of the band's inner end for a motion that lengthens the component
    # room: ρ: `link` is this fraction of what it would be for a handle at the tip: a handle itself has weight 1
    room: float
    core: Share  # the vertices beyond the inner end of every band, and their share of the motion
    vertices: Int32  # (M,) vertices that a band can contain
    depth: Float32  # (M,) d: their depths
    share: Float32  # (M,) s: their share of the motion: below 1 near another component that touches this one
    contacts: Contacts | None = None  # contacts of its pieces with surface outside the part; None if there are none

    def limited(self, vertex: int) -> Component | None:
        """Return the component with bands that end before a vertex; None if the vertex lies outside or in no band."""
        if self.core.at(vertex) == 1:
            return self
        contacts = self.contacts
        own = self.vertices[: len(self.vertices) - (0 if contacts is None else len(contacts.drawn))]
        number = int(np.searchsorted(own, vertex))
        if number >= len(own) or own[number] != vertex or self.share[number] < 1:
            return None
        depth = float(self.depth[number])
        apart = np.inf if contacts is None else float(contacts.apart[number])
        if depth < min(self.inward, LEAST_DEPTH * self.radius) or not apart > 0:
            return None
        contacts = contacts and replace(contacts, free=min(contacts.free, apart))
        return replace(self, inward=min(self.inward, depth), link=min(self.link, depth), contacts=contacts)


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


NO_BAND = Band(0.0, 0.0)  # of columns whose weights do not depend on the motion


@dataclass(frozen=True, eq=False)
class Column:
    """One column of the weights (V, C): the weights of one component, or weights by features, and what moves it."""

    handle: int  # index of the handle in the edit
    vertex: int  # the vertex of the counterpart on the component
    counterpart: Counterpart  # that counterpart, or the handle itself if all counterparts share one pivot
    still: Share  # weights that do not depend on the motion: those beyond the inner end of every band
    component: Component | None = None  # the component with the blend band; None if no weight depends on the motion
    factor: Float32 | None = None  # (M,) factor of the weights at `Component.vertices`
    carriers: tuple[int, ...] = ()  # columns of other handles whose components contain this column's component
    depth: int = 0  # 0 without carriers; otherwise, above the depth of each carrier
    # crowd: of the first column of a group, the group, and the vertices (N,) at which its sum may be above 1
    crowd: tuple[list[int], Int64] | None = None

    def of(self, component: Component) -> Column:
        """Return the column with the weights of `component`, with no other factors than its share."""
        return replace(self, still=component.core, component=component, factor=component.share)

    def scaled(self, factor: Factor) -> Column:
        """Return the column with all weights multiplied by `factor`, a function of vertices (N,)."""
        still = Share(self.still.vertices, self.still.values * factor(self.still.vertices).astype(np.float32))
        if self.component is None or self.factor is None:
            return replace(self, still=still)
        values = self.factor * factor(self.component.vertices).astype(np.float32)
        return replace(self, still=still, factor=values)

    def matrix(self, edit: Edit, most: float = np.inf) -> Float64:
        """Return the transform (3, 4) of the column, mesh units: the handle's transform, mapped to the counterpart.

        Rotations by more than `most` degrees are reduced to this angle.
        """
        handle = edit.handles[self.handle]
        matrix, angle = handle.matrix, float(np.linalg.norm(handle.transform.rotation))
        if angle > most:
            x, y, z = (part * most / angle for part in handle.transform.rotation)
            matrix = replace(handle.transform, rotation=(x, y, z)).matrix(handle.place.position)
        return self.counterpart.transform(matrix, handle.place.position)

    def turn(self, edit: Edit) -> tuple[Float64, Float64]:
        """Return the pivot (3,) of the column, mesh units, and the rotation vector (3,) of its transform, degrees."""
        handle, frame = edit.handles[self.handle], self.counterpart.frame
        place, pivot = np.asarray(handle.place.position), handle.transform.pivot
        offset = np.zeros(3) if pivot is None else pivot - place
        turned = np.linalg.det(frame) * frame  # rotation vectors are pseudovectors
        return self.counterpart.position + frame @ offset, turned @ handle.transform.rotation

    @cached_property
    def support(self) -> Int64:
        """Return the vertices (N,) whose weight can be above 0, in any order; some are repeated."""
        banded = np.empty(0, np.int64) if self.component is None else self.component.vertices
        return np.concatenate([self.still.vertices, banded]).astype(np.int64)


def whole(handle: int, component: Component) -> Column:
    """Return the column with which a handle moves a component."""
    counterpart = component.counterpart
    return Column(handle, counterpart.vertex, counterpart, component.core, component, component.share)


def band_at_rest(component: Component, diagonal: float) -> Band:
    """Return the band of a component that does not move. `diagonal` is that of the bounding box of the mesh."""
    half = min(REST * diagonal, REST_OF_RADIUS * component.radius) / 2
    loose = VISIBLE * diagonal if component.contacts is not None and component.contacts.kept else 0.0
    return Band(min(half, component.outward), min(half, component.inward), loose)


def band_of(component: Component, affine: Float64, default: Float64, diagonal: float) -> Band:
    """Return the band of a component that `affine` (3, 4) moves, while `default` (3, 4) moves its surroundings.

    Displacements along the direction of a limb lengthen it. They widen the band inside the limb, and outside only as
    far as the handle, which has weight 1, leaves no room inside (Eq. 10 and 11).
    """
    rest = band_at_rest(component, diagonal)
    if component.contacts is not None:
        rest = _at_contacts(component.contacts, affine, default, VISIBLE * diagonal, rest)
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
    inward = min(max(rest.inward, wide - outward, min(long, component.link)), component.inward)
    return rest._replace(outward=float(outward), inward=float(inward))


def _at_contacts(contacts: Contacts, affine: Float64, default: Float64, visible: float, rest: Band) -> Band:
    """Return the band `rest` with the widths at the contacts of a component that `affine` (3, 4) moves (Eq. 12).

    `default` (3, 4) moves its surroundings. Openings below `visible` mesh units are not closed.
    """
    loose, kept, drawn, outward = rest.loose, 0.0, 0.0, 0.0
    with np.errstate(over="ignore", invalid="ignore"):
        for contact in (*contacts.kept, *contacts.drawing):
            opened, moved = contact.motion(affine, default)
            least = max(visible, SLIDING * moved)
            width = STEEPEST / STRAIN * max(opened - least / 2, 0.0)
            if contact in contacts.kept:
                loose, kept = min(loose, max(least - opened, 0.0)), max(kept, width)
            else:
                drawn = max(drawn, min(max(2 * opened / least - 1, 0.0), 1.0))
                outward = max(outward, width)
    kept, outward = np.fmin(kept, contacts.free), np.fmin(outward, contacts.reach if contacts.drawing else 0.0)
    return rest._replace(loose=float(loose), kept=float(kept), drawn=float(drawn), drawn_outward=float(outward))


def widest(bands: Sequence[Band]) -> Band:
    """Return the band that is as wide as the widest of `bands`, and keeps each contact that one of them keeps."""
    return Band(*map(max, zip(*bands, strict=True)))._replace(loose=min(band.loose for band in bands))


def band_in(column: Column, mesh: Mesh, edit: Edit) -> Band:
    """Return the band of a column, for the motion of its handle in `edit`."""
    default = IDENTITY if edit.default is None else edit.default.matrix(box_center(mesh))
    # A border that comes back after a whole turn still needs a wide band.
    return band_for(column, column.matrix(edit, most=180.0), default, mesh)


def band_for(column: Column, affine: Float64, default: Float64, mesh: Mesh) -> Band:
    """Return the band of a column, which `affine` (3, 4) moves while `default` (3, 4) moves all."""
    return NO_BAND if column.component is None else band_of(column.component, affine, default, mesh.diagonal)


def weights_in(component: Component, band: Band) -> Float32:
    """Return the weights (M,) at `Component.vertices`, without shares (Eq. 9)."""
    weights, contacts = weights_at(component.depth, band), component.contacts
    if contacts is not None:
        weights *= weights_at(contacts.apart, Band(band.loose, band.kept))
        if count := len(contacts.drawn):
            outward = Band(band.drawn_outward, 0.0)
            weights[-count:] *= np.float32(band.drawn) * weights_at(-contacts.drawn, outward)
    return weights


def weights_at(depth: Float32, band: Band) -> Float32:
    """Return the weights (N,) at `depth` (N,): 1 at the inner end of the band, 0 at the outer end, smooth between."""
    width = np.float32(max(band.outward + band.inward, 1e-30))
    with np.errstate(over="ignore"):
        part = (depth + np.float32(band.outward)) / width
    np.clip(part, 0.0, 1.0, out=part)
    return part * part * (np.float32(3.0) - 2 * part)


def fill(column: Column, band: Band, weights: Float32, *, band_only: bool = False) -> None:
    """Write the weights of a column to `weights` (V,), which is 0 elsewhere, or was filled for another band.

    With `band_only`, everything outside of the band is known to be filled already.
    """
    if column.component is not None and column.factor is not None:
        weights[column.component.vertices] = column.factor * weights_in(column.component, band)
    if not band_only:
        weights[column.still.vertices] = column.still.values


def filled(columns: Sequence[Column], bands: Sequence[Band], mesh: Mesh) -> Float32:
    """Return the weights (V, C) of `columns`."""
    made = np.zeros((len(columns), len(mesh.vertices)), np.float32)
    for column, band, row in zip(columns, bands, made, strict=True):
        fill(column, band, row)
    return made.T


def filled_at_rest(columns: Sequence[Column], mesh: Mesh) -> Float32:
    """Return the weights (V, C) of `columns` that do not move. They decide what a handle holds."""
    return filled(columns, [band_for(column, IDENTITY, IDENTITY, mesh) for column in columns], mesh)
