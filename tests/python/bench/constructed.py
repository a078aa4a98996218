"""Make a small table, fields that are random or true on it, and the contexts of pages that use them.

Four posts stand on the table, which have the shape of its legs. The true feature depends on the height alone. So four
feet look alike, and the posts do not. A foot's weight falls from 1 at the ground to 0 at the top.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from itertools import count, product
from types import SimpleNamespace
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

import dfd
from bench.paper.subjects import BoxHandle, Context, Shape
from dfd.geometry.normalization import normalization

Function = Callable[[NDArray[np.float64]], NDArray[np.float64]]  # maps positions in the unit box (N, 3) to rows (N, D)
EDGE = 0.16  # longest edge of the table's faces; the table is 1.9 high

FEET = ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 1.0))
SHINS, POSTS = (tuple((x, height, z) for x, _, z in FEET) for height in (0.2, 1.0))
FOOT = BoxHandle((0.0, 0.0, 0.0), (0.0, -0.1, 0.0), like=FEET, unlike=((0.5, 0.53, 0.5), *POSTS))
TURN = replace(FOOT, offset=(0.0,) * 3, rotation=(0, 0, 20), pivot=(0.1, 0.45, 0.1), fixed=((0, 0.2, 0),), stays=SHINS)
LEGS = replace(FOOT, like=tuple((x, 0.05, z) for x, _, z in FEET))


@cache
def table(width: float = 1.0) -> dfd.Mesh:
    """Return a table of nine touching boxes: a top, four legs below and four posts above."""
    top = trimesh.creation.box((width, 0.1, 1.0)).apply_translation((0, 0.95, 0))
    posts = [
        trimesh.creation.box((0.12, 0.899, 0.12)).apply_translation((x * (width / 2 - 0.06), 0.95 + y, z * 0.44))
        for x, y, z in product((-1, 1), (-0.5005, 0.5005), (-1, 1))
    ]
    whole = trimesh.util.concatenate([each.subdivide_to_size(EDGE) for each in (top, *posts)])
    whole.merge_vertices()
    return dfd.Mesh(whole.vertices, whole.faces)


def true(places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return rows on a circle: the angle is 0° at the ground, 60° and 90° on both sides of the top, and 150° above."""
    angle = np.radians(np.interp(places[:, 1], [0.0, 0.47, 0.53, 1.0], [0.0, 60.0, 90.0, 150.0]))
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def smooth(seed: int, spread: float = 3.0) -> Function:
    """Return a random smooth function (Rahimi and Recht 2007): near positions have similar rows."""
    random = np.random.default_rng(seed)
    frequencies, phases = spread * random.standard_normal((3, 24)), random.uniform(0, 2 * np.pi, 24)
    return lambda places: np.cos(places @ frequencies + phases)


class MadeField(dfd.Field):
    """A field from a function of the position in the unit box of a mesh."""

    def __init__(self, function: Function, mesh: dfd.Mesh, encoder: str = "made") -> None:
        center, scale = normalization(mesh)
        self.function, self.low, self.sides = function, mesh.bounds[0], mesh.extents
        self.center, self.scale, self.settings = np.array(center), float(scale), {"encoder": encoder, "losses": [0.0]}

    @property
    def dimension(self) -> int:
        return self(np.zeros((1, 3))).shape[1]

    def __call__(self, points: Any) -> Any:
        rows = self.function((np.asarray(points, np.float64) - self.low) / self.sides)
        return (rows / np.linalg.norm(rows, axis=1, keepdims=True)).astype(np.float32)


@dataclass
class MadeContext(Context):
    """A context in which all shapes are tables. `functions` returns the function of the field with the given number."""

    functions: Callable[[int], Function] = lambda _: true
    quick: bool = True

    def __post_init__(self) -> None:
        self.numbers = count()

    @property
    def files(self) -> dict[str, Any]:  # type: ignore[override]
        return {}

    @property
    def made(self) -> dict[str, Any]:  # type: ignore[override]
        return {"stool": lambda: table(0.7), **dict.fromkeys(("table", *map(str, range(6))), table)}

    def loaded(self, *_: Any, **__: Any) -> Any:
        return SimpleNamespace(name="made", block=1, depth=1)

    def field(self, shape: Shape, *_: Any, encoder: Any = None, supervision: str = "", **__: Any) -> dfd.Field:
        function = self.functions(next(self.numbers))
        if supervision == "vertex":  # the ablation of Fig. 13 gives worse fields
            other = smooth(0)
            return MadeField(lambda places: np.hstack([function(places), 0.2 * other(places)]), shape.mesh)
        return MadeField(function, shape.mesh, getattr(encoder, "name", "made"))
