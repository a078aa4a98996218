"""Slow float64 reference implementations of bind, pose, fields and distances along the surface."""

from __future__ import annotations

import heapq
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from dfd.field.field import Field
    from dfd.symmetry.plane import SymmetryPlane

__all__ = [
    "bind",
    "feature_weights",
    "field",
    "geodesic_falloff",
    "kinds_of_parts",
    "pose",
    "positive_share",
    "subtract_fixed",
    "surface_distances",
]

Array = NDArray[np.float64]

FALLOFFS: dict[str, Callable[[Array], Array]] = {
    "linear": lambda x: x,
    "smooth": lambda x: x**2 * (3.0 - 2.0 * x),
    "sharp": lambda x: x**2,
    "root": np.sqrt,
    "sphere": lambda x: np.sqrt(1.0 - (1.0 - x) ** 2),
    "constant": lambda x: np.where(x > 0.0, 1.0, 0.0),
}


def bind(
    features: ArrayLike,
    handles: Any,
    *,
    fixed: Any = (),
    strength: ArrayLike = 1.0,
    geodesic: ArrayLike | None = None,
    locality: ArrayLike = 0.0,
    reach: ArrayLike = 1.0,
    falloff: Any = "linear",
) -> Array:
    """Return the weights (V, H) of `dfd.bind`: Eq. 4 and 5 with reach and falloff, then Eq. 6, then Eq. 7.

    Each item of `handles` and `fixed` is a vertex, several vertices, or feature rows; its nearest member counts.
    """
    z = np.asarray(features, np.float64)
    weights = _nearest_weights(z, handles, reach, falloff)
    held = _nearest_weights(z, fixed, 1.0, "linear") * np.broadcast_to(strength, len(fixed))
    weights = subtract_fixed(weights, held)
    return weights if geodesic is None else geodesic_falloff(weights, geodesic, locality)


def _nearest_weights(z: Array, items: Any, reach: ArrayLike, falloff: Any) -> Array:
    """Return the weights (V, N) of features `z` (V, D) for the nearest member of each of N items."""
    weights = np.zeros((len(z), len(items)))
    reaches = np.broadcast_to(reach, len(items))
    names = [falloff] * len(items) if isinstance(falloff, str) else falloff
    for j, item in enumerate(items):
        members = np.asarray(item)
        rows = z[np.atleast_1d(members)] if members.dtype.kind in "iu" else np.atleast_2d(members).astype(np.float64)
        distances = np.min([np.linalg.norm(z - row, axis=1) for row in rows], axis=0)
        weights[:, j] = FALLOFFS[names[j]](np.maximum(1.0 - distances / reaches[j], 0.0))
    return weights


def feature_weights(features: ArrayLike, handles: ArrayLike) -> Array:
    """Return weights (V, H) of features (V, D) for handle rows (H, D): max(1 − ‖Z_i − Z_j‖₂, 0), Eq. 4 and 5."""
    return _nearest_weights(np.asarray(features, np.float64), np.asarray(handles, np.float64), 1.0, "linear")


def subtract_fixed(weights: ArrayLike, fixed_weights: ArrayLike) -> Array:
    """Return weights (V, H) minus the largest weight (V, P) of any fixed point, at least 0 (Eq. 6)."""
    w, f = np.asarray(weights, np.float64), np.asarray(fixed_weights, np.float64)
    held: Array = f.max(axis=1, keepdims=True, initial=0.0)
    return np.maximum(w - held, 0.0)


def geodesic_falloff(weights: ArrayLike, geodesic: ArrayLike, locality: ArrayLike) -> Array:
    """Return weights (V, H) multiplied by (1 − G)^λ, for distances G (H, V) in [0, 1] and λ of each handle (Eq. 7)."""
    w, g = np.asarray(weights, np.float64), np.asarray(geodesic, np.float64)
    falloff: Array = (1.0 - g.T) ** np.asarray(locality, np.float64)
    return w * falloff


def positive_share(vertices: ArrayLike, symmetry: SymmetryPlane) -> Array:
    """Return the share (V,) of each vertex on the positive side: a step at the plane, or a smoothstep over ±band."""
    heights: Array = np.asarray(vertices, np.float64) @ np.asarray(symmetry.normal) - symmetry.offset
    if symmetry.band == 0:
        return np.where(heights >= 0, 1.0, 0.0)
    t: Array = np.clip(heights / (2 * symmetry.band) + 0.5, 0.0, 1.0)
    return t * t * (3 - 2 * t)


def pose(
    vertices: ArrayLike,
    weights: ArrayLike,
    transforms: ArrayLike,
    *,
    default: ArrayLike | None = None,
    symmetry: SymmetryPlane | None = None,
    handles: Any = None,
    handle_weights: ArrayLike | None = None,
    normals: ArrayLike | None = None,
    overlap: str = "paper",
    blend: str = "linear",
    pivots: ArrayLike | None = None,
    rotations: ArrayLike | None = None,
) -> Any:
    """Return the vertices (V, 3) of `dfd.pose` (Eq. 1 and 8, all overlaps and blends), and normals if given."""
    v, w, d = (np.asarray(value, np.float64) for value in (vertices, weights, transforms))
    count = w.shape[1]
    if len(v) == 0:
        return v if normals is None else (v, v)
    stands = w.argmax(axis=0) if handles is None else np.asarray(handles)
    among = w[stands] if handle_weights is None and stands.ndim == 1 else handle_weights
    places = v[stands] if stands.ndim == 1 else stands.astype(np.float64)
    d = np.array([_square(matrix) for matrix in d]).reshape(count, 4, 4)
    centers = np.vstack([places, v[:1]]) if pivots is None else np.asarray(pivots, np.float64)
    turns = [None] * (count + 1) if rotations is None else np.radians(np.asarray(rotations, np.float64))
    screw = pivots is None
    still = np.eye(4) if default is None else _square(np.asarray(default, np.float64))
    rest = _parts(still, centers[-1], None, turns[-1], screw)
    own = [_parts(*each, screw) for each in zip(d, centers, [rest.rotation] * count, turns, strict=False)]
    if symmetry is None:
        above = below = own
        share = np.ones(len(v))
    else:
        mirror = _reflection(symmetry)
        images = centers @ mirror[:3, :3].T + mirror[:3, 3]
        mirrored = [None if turn is None else -mirror[:3, :3] @ turn for turn in turns]
        other = [
            _parts(mirror @ m @ mirror, at, rest.rotation, turn, screw)
            for m, at, turn in zip(d, images, mirrored, strict=False)
        ]
        positive = places @ np.asarray(symmetry.normal) >= symmetry.offset
        above = [a if side else b for a, b, side in zip(own, other, positive, strict=True)]
        below = [b if side else a for a, b, side in zip(own, other, positive, strict=True)]
        share = positive_share(v, symmetry)

    acting = w @ np.linalg.inv(np.asarray(among, np.float64)) if overlap == "interpolate" and count else w
    total = acting.sum(axis=1)
    remainder = np.maximum(1.0 - total, 0.0)
    excess = np.maximum(total - 1.0, 0.0) if (overlap, blend) == ("paper", "linear") else np.zeros(len(v))
    if overlap == "normalize" or (overlap == "paper" and blend != "linear"):
        acting = acting / np.maximum(total, 1.0)[:, None]

    moved, turned = np.empty_like(v), np.empty_like(v)
    for i in range(len(v)):
        sums = []
        for parts in (above, below):
            sums.append(_sum([rest, *parts], [remainder[i], *acting[i]]))
        mixed = _sum(sums, [share[i], 1.0 - share[i]])
        moved[i], linear = _apply(blend, mixed, excess[i], v[i])
        if normals is not None:
            turned[i] = _turn_normal(linear, np.asarray(normals, np.float64)[i])
    return moved if normals is None else (moved, turned)


class _Parts(NamedTuple):
    """The parts of a transform about a place, each minus the same part of the identity."""

    matrix: Array  # (4, 4)
    rotation: Array  # (4,) quaternion w, x, y, z of half of the rotation
    dual: Array  # (4,) dual part of half of the rigid motion that follows a stretch about the place
    stretch: Array  # (4, 4) the stretch about the place
    translation: Array  # (3,) added at the end


def _sum(parts: list[_Parts], weights: Any) -> _Parts:
    return _Parts(*(np.tensordot(weights, np.stack(kind), axes=1) for kind in zip(*parts, strict=True)))


IDENTITY_QUATERNION = np.array([1.0, 0.0, 0.0, 0.0])


def _parts(matrix: Array, place: Array, towards: Array | None, turn: Array | None, screw: bool) -> _Parts:
    """Return the parts of an affine (4, 4) whose rotation vector is `turn`, or goes the way nearest to `towards`.

    If not `screw`, the displacement of `place` is added as a translation.
    """
    linear = matrix[:3, :3]
    if turn is None:
        rotation, stretch = _polar(linear)
        q = _quaternion(rotation)
        ways = [way / np.linalg.norm(way) for way in (q + IDENTITY_QUATERNION, IDENTITY_QUATERNION - q) if way.any()]
        goal = IDENTITY_QUATERNION if towards is None else towards + IDENTITY_QUATERNION
        half = max(ways, key=lambda way: float(way @ goal))
    else:
        angle = float(np.linalg.norm(turn))
        axis = turn / angle if angle else turn
        half = np.array([np.cos(angle / 4), *(np.sin(angle / 4) * axis)])
        rotation = _matrix(_product(half, half))
        stretch = rotation.T @ linear
    moved = linear @ place + matrix[:3, 3]
    if screw:
        shift, translation = np.linalg.solve(np.eye(3) + _matrix(half), moved - rotation @ place), np.zeros(3)
    else:
        shift, translation = place - _matrix(half) @ place, moved - place
    about = np.eye(4)
    about[:3, :3], about[:3, 3] = stretch, place - stretch @ place
    dual = 0.5 * _product(np.array([0.0, *shift]), half)
    return _Parts(matrix - np.eye(4), half - IDENTITY_QUATERNION, dual, about - np.eye(4), translation)


def _matrix(q: Array) -> Array:
    """Return the rotation matrix (3, 3) of a unit quaternion."""
    return np.array([_product(_product(q, np.array([0.0, *axis])), _conjugate(q))[1:] for axis in np.eye(3)]).T


def _apply(blend: str, sums: _Parts, excess: float, vertex: Array) -> tuple[Array, Array]:
    """Return the position (3,) of a vertex under blended parts, and the linear part (3, 3) for its normal."""
    matrix, stretch = sums.matrix + np.eye(4), sums.stretch + np.eye(4)
    if blend == "linear":
        matrix[:3, :3] += excess * np.eye(3)
        return matrix[:3, :3] @ vertex + matrix[:3, 3], matrix[:3, :3]
    q = sums.rotation + IDENTITY_QUATERNION
    length = np.linalg.norm(q)
    q = q / length
    half = _matrix(q)
    linear: Array = half @ half @ stretch[:3, :3]
    shift = 2.0 * _product(sums.dual / length, _conjugate(q))[1:]
    once = half @ (stretch[:3, :3] @ vertex + stretch[:3, 3]) + shift
    return half @ once + shift + sums.translation, linear


def _turn_normal(linear: Array, normal: Array) -> Array:
    """Return a unit normal (3,) multiplied by the cofactors of a linear part, or unchanged if the product is 0."""
    a, b, c = linear
    turned = np.array([np.cross(b, c), np.cross(c, a), np.cross(a, b)]) @ normal
    length = np.linalg.norm(turned)
    result: Array = turned / length if length > 0 else normal
    return result


def _polar(linear: Array) -> tuple[Array, Array]:
    """Return a proper rotation R and a symmetric S (3, 3) with R S = `linear`. S contains mirroring."""
    u, sizes, vt = np.linalg.svd(linear)
    if np.linalg.det(u @ vt) < 0 and sizes[2] <= 1e-12 * sizes[0]:
        u[:, 2] *= -1  # a flat shape has no mirror image
    if np.linalg.det(u @ vt) >= 0:
        return u @ vt, vt.T @ np.diag(sizes) @ vt
    flips = [np.array(signs) for signs in ([-1.0, 1, 1], [1.0, -1, 1], [1.0, 1, -1], [-1.0, -1, -1])]
    signs = max(flips, key=lambda flip: np.trace(u @ np.diag(flip) @ vt))
    return u @ np.diag(signs) @ vt, vt.T @ np.diag(signs * sizes) @ vt


def _quaternion(rotation: Array) -> Array:
    """Return the quaternion (w, x, y, z) of a rotation: an eigenvector of its quadratic form (Bar-Itzhack, 2000)."""
    m = rotation
    form = np.array(
        [
            [m[0, 0] + m[1, 1] + m[2, 2], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]],
            [m[2, 1] - m[1, 2], m[0, 0] - m[1, 1] - m[2, 2], m[1, 0] + m[0, 1], m[2, 0] + m[0, 2]],
            [m[0, 2] - m[2, 0], m[1, 0] + m[0, 1], m[1, 1] - m[0, 0] - m[2, 2], m[2, 1] + m[1, 2]],
            [m[1, 0] - m[0, 1], m[2, 0] + m[0, 2], m[2, 1] + m[1, 2], m[2, 2] - m[0, 0] - m[1, 1]],
        ]
    )
    q: Array = np.linalg.eigh(form)[1][:, -1]
    return q if q[0] >= 0 else -q


def _product(a: Array, b: Array) -> Array:
    """Return the product of two quaternions."""
    scalar = a[0] * b[0] - a[1:] @ b[1:]
    return np.array([scalar, *(a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:]))])


def _conjugate(q: Array) -> Array:
    conjugate: Array = q * np.array([1.0, -1.0, -1.0, -1.0])
    return conjugate


def _square(matrix: Array) -> Array:
    """Return an affine (3, 4) or (4, 4) as (4, 4)."""
    return np.vstack([matrix[:3], [0.0, 0.0, 0.0, 1.0]])


def _reflection(symmetry: SymmetryPlane) -> Array:
    """Return the reflection R (4, 4) of Eq. 8."""
    normal = np.asarray(symmetry.normal, np.float64)
    reflection = np.eye(4)
    reflection[:3, :3] -= 2.0 * np.outer(normal, normal)
    reflection[:3, 3] = 2.0 * symmetry.offset * normal
    return reflection


def surface_distances(vertices: ArrayLike, faces: ArrayLike, links: ArrayLike, source: int) -> Array:
    """Return distances (V,) of vertices from `source` along faces (F, 3) and links (L, 2); infinite if not connected.

    Source: Novotni and Klein, "Computing geodesic distances on triangular meshes", 2002.
    """
    points = np.asarray(vertices, np.float64)
    triangles = np.asarray(faces, np.int64).reshape(-1, 3)
    pairs = np.asarray(links, np.int64).reshape(-1, 2)
    distance = np.full(len(points), np.inf)
    passed = np.zeros(len(points), bool)
    distance[source] = 0.0
    front = [(0.0, source)]

    def length(a: int, b: int) -> float:
        return float(np.linalg.norm(points[a] - points[b]))

    def offer(vertex: int, value: float) -> None:
        if not passed[vertex] and value < distance[vertex]:
            distance[vertex] = value
            heapq.heappush(front, (value, vertex))

    while front:
        here, vertex = heapq.heappop(front)
        if passed[vertex]:
            continue
        passed[vertex] = True
        for corners in triangles[(triangles == vertex).any(axis=1)]:
            turned = np.roll(corners, -int(np.argmax(corners == vertex)))
            for x, y in (turned[1:], turned[:0:-1]):
                offer(x, here + length(vertex, x))
                if passed[y]:
                    sides = length(vertex, y), length(vertex, x), length(y, x)
                    offer(x, _across_triangle(here, distance[y], *sides))
        for a, b in pairs[(pairs == vertex).any(axis=1)]:
            offer(b if a == vertex else a, here + length(a, b))
    return distance


def _across_triangle(a: float, b: float, side: float, to_a: float, to_b: float) -> float:
    """Return the distance of a triangle's third corner from a point at distances `a`, `b` from the ends of `side`."""
    if side == 0:
        return np.inf
    source = (a * a - b * b + side * side) / (2 * side)
    corner = (to_a * to_a - to_b * to_b + side * side) / (2 * side)
    below, above = a * a - source**2, max(to_a * to_a - corner**2, 0.0)
    if below < 0 or below + above == 0:
        return np.inf
    height = below**0.5 + above**0.5
    crossing = source + (corner - source) * below**0.5 / height
    return float(np.hypot(corner - source, height)) if 0 <= crossing <= side else np.inf


def field(network: Field, points: ArrayLike) -> Array:
    """Return unit features (N, D) of points (N, 3) in mesh units: the MLP of the paper's supplement L."""
    # Points are rounded to float32 like the input of the kernel, because the shortest waves enlarge rounding errors.
    x = ((np.asarray(points, np.float64) - network.center) * network.scale).astype(np.float32).astype(np.float64)
    angles = [np.pi / 2 * 2**octave * x for octave in range(network.architecture.octaves)]
    x = np.concatenate([x, *[wave for angle in angles for wave in (np.sin(angle), np.cos(angle))]], axis=1)
    of = {name: np.asarray(values, np.float64) for name, values in network.parameters.items()}
    last = 3 * network.architecture.layers
    for layer in range(0, last, 3):
        x = np.maximum(x @ of[f"network.{layer}.weight"].T + of[f"network.{layer}.bias"], 0.0)
        x = (x - x.mean(axis=1, keepdims=True)) / np.sqrt(x.var(axis=1, keepdims=True) + 1e-5)
        x = x * of[f"network.{layer + 2}.weight"] + of[f"network.{layer + 2}.bias"]
    x = x @ of[f"network.{last}.weight"].T + of[f"network.{last}.bias"]
    features: Array = x / np.maximum(np.linalg.norm(x, axis=1, keepdims=True), 1e-12)
    return features


def kinds_of_parts(
    features: ArrayLike, mean: Array, hidden: Array, hidden_bias: Array, output: Array, output_bias: Array
) -> Array:
    """Return square roots of probabilities of K kinds (N, K) for features (N, D): one ReLU layer and a softmax."""
    result = np.empty((len(np.asarray(features)), len(output_bias)))
    for row, feature in enumerate(np.asarray(features, np.float64)):
        units = np.maximum(hidden.T @ (feature - mean) + hidden_bias, 0.0)
        odds = np.exp(output.T @ units + output_bias)
        result[row] = np.sqrt(odds / odds.sum())
    return result
