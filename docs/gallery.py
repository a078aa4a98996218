"""One page with every control on real meshes: `make gallery`, then look at it.

Meshes come from the folder that DFD_MESHES names, where it holds them, and are made otherwise. Fields are distilled
once and kept beside the page.
"""

from __future__ import annotations

import argparse
import html
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import dfd
from dfd.pictures.picture import picture, save_png
from dfd.pictures.viewpoint import azimuth_towards

CELL = 380
Session = dfd.Deformer
Variant = tuple[str, Callable[[Session], None]]


class Shape:
    """A mesh with its field, and the pictures of edits of it."""

    def __init__(self, mesh: dfd.Mesh, field: dfd.Field) -> None:
        self.mesh, self.field = mesh, field
        self.features = dfd.Deformer(mesh, field).features

    def session(self) -> Session:
        """A session without an edit."""
        return dfd.Deformer(self.mesh, self.field, features=self.features)

    def top(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> int:
        """The vertex that lies farthest in a direction."""
        return int((self.mesh.vertices @ [x, y, z]).argmax())


def main() -> None:
    """Draw the gallery."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("output", type=Path, nargs="?", default=Path("gallery"))
    output: Path = parser.parse_args().output
    (output / "fields").mkdir(parents=True, exist_ok=True)
    made = {"chair": dfd.samples.chair, "quadruped": dfd.samples.quadruped, "robot": dfd.samples.robot}
    shapes: dict[str, Shape] = {}

    def shape(name: str, otherwise: str) -> Shape:
        path = next(Path(os.environ.get("DFD_MESHES", "nowhere")).rglob(f"{name}.*"), None)
        stem = name if path else otherwise
        if stem not in shapes:
            mesh = dfd.load(path) if path else made[stem]().mesh
            field = output / "fields" / f"{stem}.field.safetensors"
            if not field.exists():
                dfd.distill(mesh).save(field)
            shapes[stem] = Shape(mesh, dfd.Field.load(field, mesh=mesh))
        return shapes[stem]

    page = ["<!doctype html><meta charset=utf-8><title>dfd: every control</title>", STYLE, "<h1>Every control</h1>"]
    for number, (title, one, variants, azimuth) in enumerate(_stories(shape)):
        cells = [_cell(output, f"{number}_{i}", one, variant, azimuth) for i, variant in enumerate(variants)]
        page.append(f"<h2>{html.escape(title)}</h2><div>{''.join(cells)}</div>")
    (output / "index.html").write_text("\n".join(page), encoding="utf-8")
    print(output / "index.html")


STYLE = """<style>body{font:15px sans-serif;max-width:1700px;margin:2em auto;color:#222}div{display:flex;flex-wrap:wrap}
figure{margin:0 1em 1em 0;width:400px}img{width:190px}figcaption{color:#555}</style>"""


def _cell(output: Path, stem: str, shape: Shape, variant: Variant, azimuth: float | None) -> str:
    """Draw what follows and what comes of it, and say what the session reports."""
    caption, edit = variant
    session = shape.session()
    edit(session)
    moved, told = session.vertices, session.report()
    places = np.array([handle.place.position for handle in session.handles])
    fixed = np.array([one.position for one in session.fixed]).reshape(-1, 3)
    where: dict[str, Any] = {
        "azimuth": azimuth_towards(shape.mesh, places) if azimuth is None else azimuth,
        "frame": [shape.mesh.vertices, moved],
        "resolution": CELL,
        "fixed": fixed,
    }
    heat = session.following.max(axis=1, initial=0.0)
    save_png(output / f"{stem}_weights.png", picture(shape.mesh, weights=heat, handles=places, **where))
    landed = np.array([handle.landed for handle in told.handles])
    save_png(output / f"{stem}_after.png", picture(shape.mesh, vertices=moved, handles=landed, **where))
    print(f"{caption}: {told}", flush=True)
    images = f'<img src="{stem}_weights.png"><img src="{stem}_after.png">'
    return (
        f"<figure>{images}<figcaption><b>{html.escape(caption)}</b><br>{html.escape(str(told))}</figcaption></figure>"
    )


def _stories(shape: Callable[[str, str], Shape]) -> list[tuple[str, Shape, list[Variant], float | None]]:
    """A title, a shape, its edits with their captions, and from where they are seen, for each row."""
    truck, animal = shape("milk_truck_textured", "chair"), shape("spot", "quadruped")
    chair, horned, robot = shape("chair", "chair"), shape("quadruped", "quadruped"), shape("robot", "robot")
    fish = shape("anglerfish", "quadruped")
    wheel = _wheel(truck)
    jaw, opened = fish.top(y=-1.5, z=1), {"translation": (0, -0.1 * fish.mesh.extents[1], 0)}
    feet = [chair.top(x=x, y=-3, z=z) for x in (-1, 1) for z in (-1, 1)]
    horse, figure = shape("horse", "quadruped"), shape("man", "robot")
    poll, hand = horse.top(y=1, z=0.3), figure.top(x=1)
    hoof = animal.top(x=0.3, y=-1, z=0.3)
    ear, horn, arm = animal.top(x=1, y=0.6), horned.top(x=0.3, y=1), robot.top(x=1)
    turned = {"rotation": (0, 0, 60)}
    lowered = {"translation": (0, -0.25 * animal.mesh.extents[1], 0)}
    lifted = {"translation": (0, 0.25 * animal.mesh.extents[1], 0)}

    def add(at: Any, **options: Any) -> Callable[[Session], None]:
        return lambda session: void(session.add(at, **options))

    def also(*steps: Callable[[Session], object]) -> Callable[[Session], None]:
        return lambda session: void([step(session) for step in steps])

    def put(name: str, value: Any) -> Callable[[Session], None]:
        return lambda session: setattr(session, name, value)

    def without(count: int | None) -> Callable[[Session], None]:
        """Switch off the instances of handle 1 that are most alike, so many of them or all."""

        def switched(session: Session) -> None:
            others = [one.vertex for one, _ in session.instances(1)[1:]]
            session.change(1, excluded_instances=others[:count])

        return switched

    def four(overlap: str) -> Callable[[Session], None]:
        down = {"translation": (0, -0.2 * chair.mesh.extents[1], 0)}
        return also(put("overlap", overlap), *(add(foot, **down) for foot in feet))

    twist = {"rotation": (0, 150, 0)}
    return [
        (
            "Instances: a wheel is scaled",
            truck,
            [(kind, add(wheel, scale=1.5, instances=kind)) for kind in ("shared_pivot", "own_pivot", "only")],
            60.0,
        ),
        (
            "Instances: an ear is turned",
            animal,
            [(kind, add(ear, instances=kind, **turned)) for kind in ("shared_pivot", "own_pivot", "only")]
            + [("own pivot, level", add(ear, instances="own_pivot", level=True, **turned))],
            None,
        ),
        (
            "Instances: some of them are switched off",
            animal,
            [
                ("all", add(hoof, **lowered)),
                ("without the most alike", also(add(hoof, **lowered), without(1))),
                ("without all others", also(add(hoof, **lowered), without(None))),
            ],
            40.0,
        ),
        (
            "A long lever: an ear is turned, and nothing far away lifts",
            horse,
            [(kind, add(poll, instances=kind, rotation=(60, 0, 0))) for kind in ("shared_pivot", "own_pivot", "only")],
            70.0,
        ),
        (
            "Axes: twice as wide, along the axes of the mesh and along the limb",
            figure,
            [("axes of the mesh", add(hand, scale=(2, 2, 1))), ("limb", add(hand, scale=(2, 2, 1), axes="limb"))],
            10.0,
        ),
        (
            "Axes: a leg grows thicker and not longer",
            animal,
            [("every way", add(hoof, scale=1.6)), ("limb", add(hoof, scale=(1.6, 1.6, 1), axes="limb"))],
            40.0,
        ),
        (
            "Overlap: four feet are pulled down, each by a handle",
            chair,
            [(rule, four(rule)) for rule in ("add", "interpolate", "normalize", "paper")],
            35.0,
        ),
        (
            "Reach",
            animal,
            [("the paper's", add(ear, reach=1.0, falloff="linear", **lifted))]
            + [(f"reach {reach}", add(ear, reach=reach, **lifted)) for reach in (1.0, 0.7, 0.4, "auto")],
            None,
        ),
        (
            "Falloff",
            animal,
            [
                (curve, add(ear, falloff=curve, **lifted))
                for curve in ("linear", "smooth", "sharp", "root", "sphere", "constant")
            ],
            None,
        ),
        (
            "Locality and radius",
            horned,
            [(f"locality {value}", add(horn, locality=value, scale=1.8)) for value in (0.0, 2.0, 6.0)]
            + [(f"radius {value}", add(horn, radius=value, scale=1.8)) for value in ("40%", "15%")],
            None,
        ),
        (
            "Many pieces: a jaw is opened, and its teeth come along",
            fish,
            [(f"locality {value}", add(jaw, locality=value, **opened)) for value in (0.0, 2.0, 6.0)]
            + [("radius 25%", add(jaw, radius="25%", **opened))],
            35.0,
        ),
        (
            "Fixed points: the muzzle holds while a horn is bent",
            horned,
            [
                ("none", add(horn, rotation=(-50, 0, 0))),
                ("fixed", also(add(horn, rotation=(-50, 0, 0)), lambda one: one.fix("front"))),
                ("strength 0.5", also(add(horn, rotation=(-50, 0, 0)), lambda one: one.fix("front", strength=0.5))),
                (
                    "fixed, the paper's weights",
                    also(put("reach_targets", False), add(horn, rotation=(-50, 0, 0)), lambda one: one.fix("front")),
                ),
            ],
            None,
        ),
        (
            "Symmetry: an arm is pulled to the side",
            robot,
            [
                ("none", add(arm, translation=(0.2, 0.1, 0))),
                ("auto", also(add(arm, translation=(0.2, 0.1, 0)), lambda one: one.set_symmetry("auto"))),
            ],
            10.0,
        ),
        (
            "Blend: an arm is twisted by 150°",
            robot,
            [
                (rule, also(put("blend", rule), add(arm, locality=1.5, **twist)))
                for rule in ("linear", "dual_quaternion", "polar")
            ],
            30.0,
        ),
        (
            "Regions: the side x > 0 alone",
            horned,
            [
                ("everywhere", add("bottom", translation=(0, -0.3, 0))),
                ("within x>0", add("bottom", translation=(0, -0.3, 0), mask="x>0")),
                ("with a soft edge", add("bottom", translation=(0, -0.3, 0), mask="x>0", mask_feather="15%")),
            ],
            20.0,
        ),
    ]


def _wheel(truck: Shape) -> Any:
    """A vertex at the hub of a wheel, or the lowest one where there are no wheels."""
    wheels = [name for name in truck.mesh.part_names if "wheel" in name.lower()]
    if not wheels:
        return truck.top(y=-1)
    # A part may be two wheels on one axle: the one on the +x side.
    held = truck.mesh.part_vertices(wheels[0])
    places = truck.mesh.vertices[held]
    side = places[:, 0] > places[:, 0].mean()
    hub = (places[side].min(axis=0) + places[side].max(axis=0)) / 2
    hub[0] = places[:, 0].max()
    return int(held[np.linalg.norm(places - hub, axis=1).argmin()])


def void(_: object) -> None:
    """Steps of a story give nothing back."""


if __name__ == "__main__":
    main()
