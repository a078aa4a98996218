"""Damage meshes at random, with the defects of scans, exporters and unfinished models."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from dfd import Mesh

__all__ = ["DAMAGES", "damaged"]

Float64 = NDArray[np.float64]
Faces = NDArray[np.int32]
Random = np.random.Generator
Damage = Callable[[Float64, Faces, Random], tuple[Float64, Faces]]


def holes(vertices: Float64, faces: Faces, random: Random) -> tuple[Float64, Faces]:
    """Remove the faces around a few points, and some random faces."""
    size = np.ptp(vertices, axis=0).max()
    middles = vertices[faces].mean(axis=1)
    kept = random.random(len(faces)) > random.choice([0.0, 0.02, 0.3])
    for _ in range(random.integers(1, 6)):
        at = middles[random.integers(len(faces))]
        kept &= np.linalg.norm(middles - at, axis=1) > random.uniform(0.02, 0.15) * size
    return vertices, faces[kept] if kept.any() else faces[:1]


def flipped(vertices: Float64, faces: Faces, random: Random) -> tuple[Float64, Faces]:
    """Reverse the orientation of some faces."""
    chosen = random.random(len(faces)) < random.choice([0.05, 0.5])
    return vertices, np.where(chosen[:, None], faces[:, ::-1], faces)


def duplicated(vertices: Float64, faces: Faces, random: Random) -> tuple[Float64, Faces]:
    """Repeat some faces once or twice, some with reversed orientation."""
    again = faces[random.integers(0, len(faces), 1 + len(faces) // 10)]
    return vertices, np.concatenate([faces, again, again[::2, ::-1], again[::3, [1, 2, 0]]])


def merged(vertices: Float64, faces: Faces, random: Random) -> tuple[Float64, Faces]:
    """Replace vertices of faces by distant vertices: spikes, non-manifold edges, faces with two equal corners."""
    new = faces.copy()
    for _ in range(1 + len(vertices) // 200):
        one, other = random.integers(0, len(vertices), 2)
        new[new == one] = other
    return vertices, new


def placed_alike(vertices: Float64, faces: Faces, random: Random) -> tuple[Float64, Faces]:
    """Move some vertices to the positions of other vertices."""
    moved = vertices.copy()
    chosen = random.integers(0, len(vertices), 1 + len(vertices) // 20)
    moved[chosen] = vertices[random.integers(0, len(vertices), len(chosen))]
    return moved, faces


def split(vertices: Float64, faces: Faces, random: Random) -> tuple[Float64, Faces]:
    """Give all or some faces vertices of their own, which may lie slightly apart."""
    chosen = random.random(len(faces)) < random.choice([0.1, 1.0])
    corners = faces[chosen].ravel()
    apart = random.choice([0.0, 1e-9, 1e-3]) * np.ptp(vertices, axis=0).max()
    own = vertices[corners] + random.normal(size=(len(corners), 3)) * apart
    new = faces.copy()
    new[chosen] = len(vertices) + np.arange(len(corners)).reshape(-1, 3)
    return np.concatenate([vertices, own]), new


def slivers(vertices: Float64, faces: Faces, random: Random) -> tuple[Float64, Faces]:
    """Add faces with an area of almost or exactly 0 along existing edges."""
    chosen = faces[random.integers(0, len(faces), 1 + len(faces) // 20)]
    share = random.choice([0.0, 1e-12, 0.5], len(chosen))[:, None]
    aside = random.choice([0.0, 1e-15, 1e-7]) * random.normal(size=(len(chosen), 3))
    between = (1 - share) * vertices[chosen[:, 0]] + share * vertices[chosen[:, 1]] + aside
    new = np.column_stack([chosen[:, :2], len(vertices) + np.arange(len(chosen))])
    flat = chosen[::4, [0, 0, 1]]
    return np.concatenate([vertices, between]), np.concatenate([faces, new, flat]).astype(np.int32)


def strays(vertices: Float64, faces: Faces, random: Random) -> tuple[Float64, Faces]:
    """Add vertices that no face uses, near the shape or far away."""
    size = np.ptp(vertices, axis=0).max()
    count = int(random.choice([1, 7, 200]))
    far = vertices.mean(axis=0) + random.normal(size=(count, 3)) * size * random.choice([0.1, 1.0, 30.0])
    if random.random() < 0.5:
        return np.concatenate([vertices, far]), faces
    return np.concatenate([far, vertices]), (faces + count).astype(np.int32)


def small_components(vertices: Float64, faces: Faces, random: Random) -> tuple[Float64, Faces]:
    """Add many small components, single faces or tetrahedra, near the surface."""
    size = np.ptp(vertices, axis=0).max()
    count = int(random.choice([3, 40, 400]))
    at = vertices[random.integers(0, len(vertices), count)] + random.normal(size=(count, 3)) * size * 0.05
    corners = at[:, None] + random.normal(size=(count, 4, 3)) * size * random.choice([1e-4, 0.01])
    number = len(vertices) + 4 * np.arange(count)[:, None, None]
    sides = np.array([[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]])
    new = (number + sides).reshape(-1, 3) if random.random() < 0.5 else number[:, 0] + sides[0]
    return np.concatenate([vertices, corners.reshape(-1, 3)]), np.concatenate([faces, new]).astype(np.int32)


def torn_apart(vertices: Float64, faces: Faces, random: Random) -> tuple[Float64, Faces]:
    """Separate the faces on one side of a plane, and move them away."""
    normal = random.normal(size=3)
    beyond = (vertices[faces].mean(axis=1) - vertices.mean(axis=0)) @ normal > 0
    new = faces.copy()
    new[beyond] += len(vertices)
    gap = random.choice([1e-6, 0.03, 3.0]) * np.ptp(vertices, axis=0).max()
    return np.concatenate([vertices, vertices + gap * normal / np.linalg.norm(normal)]), new


def squeezed(vertices: Float64, faces: Faces, random: Random) -> tuple[Float64, Faces]:
    """Make the shape flat, nearly flat, long, tiny or huge, and sometimes move it far from the origin."""
    factors = [[1, 1, 0], [1, 1e-7, 1], [50, 1, 1], [1e-6] * 3, [1e6] * 3]
    shift = float(random.choice([0.0, 0.0, 1e3])) * np.ptp(vertices, axis=0).max()
    return vertices * factors[random.integers(len(factors))] + shift, faces


def shuffled(vertices: Float64, faces: Faces, random: Random) -> tuple[Float64, Faces]:
    """Change the order of vertices and faces."""
    order = random.permutation(len(vertices))
    new = np.argsort(order)[faces][random.permutation(len(faces))]
    return vertices[order], new.astype(np.int32)


def few(vertices: Float64, faces: Faces, random: Random) -> tuple[Float64, Faces]:
    """Keep at most nine faces."""
    return vertices, faces[random.integers(0, len(faces), int(random.choice([1, 2, 9])))]


DAMAGES: tuple[Damage, ...] = (
    *(holes, flipped, duplicated, merged, placed_alike, split, slivers, strays, small_components, torn_apart, squeezed),
    *(shuffled, few),
)
RARE = (few, squeezed)  # chosen less often, because they leave little for other damage


def damaged(mesh: Mesh, seed: int) -> tuple[Mesh, str]:
    """Return `mesh` with two to five kinds of damage, and their names; equal seeds give equal damage."""
    random = np.random.default_rng([seed, 2026])
    chosen = [each for each in DAMAGES if random.random() < (0.07 if each in RARE else 0.25)]
    if len(chosen) < 2:
        chosen = [DAMAGES[i] for i in random.choice(len(DAMAGES) - 2, 3, replace=False)]
    vertices, faces = np.array(mesh.vertices), np.array(mesh.faces)
    for damage in (chosen[i] for i in random.permutation(len(chosen))[:5]):
        vertices, faces = damage(vertices, faces, random)
    return Mesh(vertices, faces), " + ".join(damage.__name__ for damage in chosen)
