"""Use every control of dfd on one mesh, and check that nothing crashes, hangs or becomes NaN."""

import itertools
import re
from collections.abc import Callable
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

import dfd
from dfd import Deformer, Field, Geodesics, Mesh
from dfd.common.preset import Preset
from dfd.editing.edit import Edit
from dfd.editing.presets import Counterparts
from dfd.editing.regions import Ball, Box, HalfSpace, VertexSet
from dfd.geometry.findings import findings
from dfd.posing.pose import Blend, Overlap, pose
from dfd.posing.transforms import Transform
from dfd.segmentation.follow import Follow
from dfd.symmetry.plane import SymmetryPlane
from dfd.symmetry.search import symmetry_planes
from dfd.weights.bind import Falloff, bind

__all__ = ["use_every_control"]


def use_every_control(mesh: Mesh, field: Field, seed: int) -> None:
    """Use every control on `mesh` once, with random handles for `seed`.

    Raises
    ------
    AssertionError
        If a result is not finite or not within its bounds, or the input has changed.
    """
    random = np.random.default_rng(seed)
    before = mesh.vertices.copy(), mesh.faces.copy()
    handles = random.choice(len(mesh.vertices), min(3, len(mesh.vertices)), replace=False).tolist()
    features = field.features(mesh)
    _bound(mesh, features, handles, random)
    planes = _symmetries(mesh, field) if seed % 4 == 0 else []  # the slowest step
    assert all(each.what and each.means for each in findings(mesh))
    _edited(mesh, field, features, handles, planes, random)
    _posed(mesh, features, handles, random)
    assert np.array_equal(mesh.vertices, before[0])
    assert np.array_equal(mesh.faces, before[1])


def _bound(mesh: Mesh, features: NDArray[np.float32], handles: list[int], random: np.random.Generator) -> None:
    geodesics = Geodesics(mesh)
    distances = geodesics.distances(handles)
    assert _within(distances, 0, 1)
    assert (distances[np.arange(len(handles)), handles] == 0).all()
    assert np.isfinite(geodesics.extent)
    assert geodesics.extent >= 0
    for falloff in get_args(Falloff):
        locality = float(random.choice([0.0, 0.5, 20.0]))
        weights = bind(
            features, handles, geodesic=distances, locality=locality, reach=random.uniform(0.01, 2), falloff=falloff
        )
        assert _within(weights, 0, 1)
    compact = dfd.compact(features)
    assert np.abs(bind(compact, handles) - bind(features, handles)).max() <= 0.05


def _symmetries(mesh: Mesh, field: Field) -> list[SymmetryPlane]:
    planes = symmetry_planes(mesh, field)
    for plane in planes:
        assert _within(np.linalg.norm(plane.normal), 1 - 1e-6, 1 + 1e-6)
        assert np.isfinite([plane.offset, plane.band, plane.score]).all()
    return planes


def _edited(
    mesh: Mesh,
    field: Field,
    features: NDArray[np.float32],
    handles: list[int],
    planes: list[SymmetryPlane],
    random: np.random.Generator,
) -> None:
    """Check a session with all kinds of counterparts, regions, distances, fixed points, planes and presets."""
    size = mesh.diagonal
    session = Deformer(mesh, field, features=features)
    turned: dict[str, Any] = {"rotation": (10, 70, 20), "scale": (1.5, 0.7, 1.0), "translation": [0.1 * size] * 3}
    near: tuple[dict[str, Any], ...] = ({}, {"locality": 2.0}, {"radius": "30%"})
    kinds = zip(get_args(Counterparts), get_args(Follow)[1:], random.permutation(near)[:2], strict=True)  # type: ignore[arg-type]
    for kind, follow, how in kinds:
        session.apply(Edit())
        held = session.add(handles[0], counterparts=kind, follow=follow, level=random.integers(-3, 4), **turned, **how)
        _check(session)
        off = [one.vertex for one, _ in session.counterparts(held)]
        session.change(held, excluded_counterparts=off[1::2])
        _check(session)
    session.apply(Edit())
    hows: Any = ({"counterparts": "own_pivot"}, {"follow": "none"}, {"counterparts": "shared_pivot"})
    for handle, how in zip(handles, hows, strict=False):
        _tried(session.add, handle, **how, reach=random.choice([0.3, 1.0]), **turned)
    for region in _regions(mesh, random):
        _tried(session.add, region, strength=0.5, translation=(0, 0.1 * size, 0))
        if region != "top":  # a point
            _tried(session.change, session.handles[0].id, mask=region)
        _tried(session.fix, region, strength=0.5)
    _tried(session.change, session.handles[0].id, mask="everywhere", reach="part")
    _tried(session.move, session.handles[0].id, axes="normal")
    for plane in (None, *planes[:1], "x"):
        _tried(setattr, session, "symmetry", plane)
        for preset in get_args(Preset):
            _tried(setattr, session, "preset", preset)
            _check(session)
    moved = session.vertices
    while session.undo():
        pass
    assert np.array_equal(session.vertices, mesh.vertices)
    while session.redo():
        pass
    assert np.array_equal(session.vertices, moved)


def _check(session: Deformer) -> None:
    assert np.isfinite(session.vertices).all()
    assert _within(session.weights, 0, 1)
    assert _within(session.following, 0, 1.001)
    told = session.report()
    assert str(told)
    assert np.isfinite([told.moved, told.farthest]).all()


def _regions(mesh: Mesh, random: np.random.Generator) -> list[Any]:
    center = mesh.vertices[random.integers(len(mesh.vertices))]
    return [
        Ball(tuple(center), 0.1 * mesh.diagonal),
        Box(tuple(center - 0.1 * mesh.diagonal), tuple(center + 0.2 * mesh.diagonal)),
        HalfSpace((0.0, 1.0, 0.0), float(center[1])),
        VertexSet.of(mesh, random.random(len(mesh.vertices)) < 0.2 if len(mesh.vertices) > 60 else [0]),
        "top",
        "part:none",
    ]


def _posed(mesh: Mesh, features: NDArray[np.float32], handles: list[int], random: np.random.Generator) -> None:
    """Check `pose` with every overlap and every blend, with and without a plane."""
    weights = bind(features, handles)
    transforms = np.stack([Transform(rotation=random.normal(size=3) * 90, scale=1.3).matrix() for _ in handles])
    across = SymmetryPlane((1.0, 0.0, 0.0), float(mesh.vertices[:, 0].mean()), band=0.03 * mesh.diagonal)
    for overlap, blend in itertools.product(get_args(Overlap), get_args(Blend)):
        for plane in (None, across):
            how: dict[str, Any] = {"symmetry": plane, "overlap": overlap, "blend": blend, "handles": handles}
            moved = _tried(pose, mesh.vertices, weights, transforms, **how)
            assert moved is None or np.isfinite(moved).all()


def _tried(step: Callable[..., Any], *arguments: Any, **options: Any) -> Any:
    """Return the result of a step; None if it raises ValueError with a message of `REFUSALS`."""
    try:
        return step(*arguments, **options)
    except ValueError as error:
        if not REFUSALS.search(str(error)):
            raise
        return None


# Messages with which dfd may refuse a shape: no area, no vertex in a region, or handles that are too similar.
REFUSALS = re.compile(
    "must have a face with an area|must hold a vertex|must be a part of the scene|look the same|"
    "cannot move|must leave handle|must lie at distinct places|must be at unused places|"
    "the surface has no normal|as wide as it is long"
)


def _within(values: Any, low: float, high: float) -> bool:
    values = np.asarray(values)
    return bool(np.isfinite(values).all() and (values >= low).all() and (values <= high).all())
