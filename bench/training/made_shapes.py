"""Generate shapes whose parts are known: people, animals, insects, furniture and vessels, from rounded primitives.

Each primitive belongs to a named part, and each part hangs on another one. A shape is symmetric in the plane x = 0. The
sizes, the directions, the numbers of limbs and fingers, and the smoothness of the transitions are random.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

import dfd
from dfd.common.linear_algebra import Bool, Float64
from dfd.geometry.topology import vertex_areas
from dfd.samples.implicit import Distance, Primitive, Shape, capsule, chain, ellipsoid, rounded_box
from dfd.samples.polygonize import polygonize

FACES = 8_000
LOW, HIGH = (-1.1, -0.4, -1.1), (1.1, 1.8, 1.1)  # corners of the box in which all shapes lie
SMALLEST = 0.001  # parts with less than this share of the surface are left out


@dataclass(frozen=True, eq=False)
class MadeShape:
    """A generated mesh, and its parts."""

    mesh: dfd.Mesh
    parts: tuple[tuple[Bool, Bool], ...]  # masks (V,) of each part: alone, and with all parts that hang on it


class Builder:
    """Collect the primitives of a shape."""

    def __init__(self, random: np.random.Generator) -> None:
        self.random = random
        self.primitives: list[Primitive] = []
        self.above: dict[str, str | None] = {}  # for each part, the part on which it hangs
        self.blend = self.between(0.006, 0.05)  # width of the smooth transitions

    def between(self, low: float, high: float) -> float:
        return float(self.random.uniform(low, high))

    def chance(self, probability: float) -> bool:
        return bool(self.random.random() < probability)

    def part(self, above: str | None, *distances: Distance, paired: bool = False, smooth: float = 1.0) -> str:
        """Add a part that hangs on `above`. `smooth` multiplies the width of the transitions."""
        name = f"part {len(self.above)}"
        self.above[name] = above
        self.extend(name, *distances, paired=paired, smooth=smooth)
        return name

    def extend(self, name: str, *distances: Distance, paired: bool = False, smooth: float = 1.0) -> None:
        """Add primitives to a part."""
        for distance in distances:
            width = self.blend * smooth * self.between(0.6, 1.3)
            self.primitives.append(Primitive(name, distance, 0, paired, width))

    def limb(
        self,
        above: str,
        start: Sequence[float],
        direction: Sequence[float],
        length: float,
        radius: float,
        *,
        paired: bool = True,
        segments: int | None = None,
        spread: float = 0.2,
    ) -> tuple[str, Float64, Float64, float]:
        """Add a chain of segments, each a part. Return the last segment, its end, its direction and its radius."""
        count = segments or int(self.random.integers(1, 4))
        at, along = np.array(start, float), np.array(direction, float)
        for number in range(count):
            along /= np.linalg.norm(along)
            end, thin = at + along * length / count * self.between(0.8, 1.2), radius * self.between(0.6, 0.95)
            above = self.part(above, capsule(_triple(at), _triple(end), radius, thin), paired=paired)
            if number and self.chance(0.3):
                self.extend(above, ellipsoid(_triple(at), (1.25 * radius,) * 3), paired=paired)
            at, radius, along = end, thin, along + self.random.normal(size=3) * spread
        return above, at, along / np.linalg.norm(along), radius

    def hand(self, above: str, at: Float64, along: Float64, radius: float) -> None:
        """Add a hand with up to five fingers."""
        size = radius * self.between(1.1, 1.9)
        palm = ellipsoid(_triple(at + 0.6 * size * along), tuple(size * self.random.uniform(0.7, 1.1, 3)))
        hand = self.part(above, palm, paired=True, smooth=0.6)
        aside = np.cross(along, (0.3, 1.0, 0.2))
        aside /= np.linalg.norm(aside)
        count = int(self.random.integers(0, 6))
        for number in range(count):
            side = aside * (2 * (number + 0.5) / count - 1)
            start, thick = at + size * (along + 0.75 * side), max(size * self.between(0.55, 0.8) / max(count, 3), 0.008)
            end = start + (along + 0.5 * side) * size * self.between(0.8, 1.6)
            self.part(hand, capsule(_triple(start), _triple(end), thick, 0.8 * thick), paired=True, smooth=0.3)

    def foot(self, above: str, at: Float64, along: Float64, radius: float) -> None:
        """Add a shoe, a hoof or a paw."""
        size, kind = radius * self.between(1.0, 1.7), int(self.random.integers(3))
        shoe = rounded_box(_triple(at + (0, 0, 0.6 * size)), (0.85 * size, 0.55 * size, 1.6 * size), 0.35 * size)
        hoof = capsule(_triple(at), _triple(at + 1.2 * size * along), 0.8 * size, size)
        paw = ellipsoid(_triple(at + 0.5 * size * along), (size, 0.7 * size, 1.3 * size))
        self.part(above, (shoe, hoof, paw)[kind], paired=True, smooth=0.5)

    def head(self, above: str, at: Sequence[float], size: float) -> None:
        """Add a head, perhaps with a muzzle, ears, horns, eyes and a hat."""
        x, y, z = size * self.random.uniform((0.8, 0.8, 0.9), (1.1, 1.1, 1.3))
        center = np.array(at) + (0, 0.7 * y, 0.3 * z)
        head = self.part(above, ellipsoid(_triple(center), (x, y, z)))
        if self.chance(0.6):
            start, length = center + (0, -0.2 * size, 0.6 * z), size * self.between(0.6, 1.2)
            end = start + (0, -0.15 * size, length)
            radii = size * self.between(0.4, 0.6), size * self.between(0.25, 0.45)
            self.part(head, capsule(_triple(start), _triple(end), *radii))
        if self.chance(0.7):
            height, width = size * self.between(0.4, 1.3), size * self.between(0.15, 0.35)
            root = center + (x * self.between(0.5, 0.9), y * self.between(0.5, 0.8) + 0.5 * height, 0)
            flat = max(size * self.between(0.08, 0.2), 0.012)
            ear = ellipsoid(_triple(root), (width, 0.7 * height, flat), roll=self.between(-0.8, 0.2))
            self.part(head, ear, paired=True, smooth=0.5)
        if self.chance(0.4):
            root, along = center + (0.35 * x, 0.75 * y, 0), (self.between(0.1, 1), 1, self.between(-0.4, 0.6))
            thick = max(size * self.between(0.1, 0.2), 0.014)
            self.limb(head, root, along, size * self.between(0.5, 1.6), thick, segments=1)
        if self.chance(0.4):
            eye, radius = center + (0.45 * x, 0.2 * y, 0.8 * z), size * self.between(0.12, 0.28)
            self.part(head, ellipsoid(_triple(eye), (radius,) * 3), paired=True, smooth=0.15)
        if self.chance(0.2):
            brim, top = center + (0, 0.9 * y, 0), center + (0, 1.6 * y, 0)
            hat = ellipsoid(_triple(brim), (1.3 * x, 0.12 * size, 1.2 * z))
            self.part(head, hat, capsule(_triple(brim), _triple(top), 0.7 * x, 0.5 * x), smooth=0.3)

    def finished(self, faces: int = FACES) -> MadeShape:
        """Return the mesh and its parts."""
        shape = Shape(self.primitives)
        mesh = dfd.Mesh(*polygonize(shape, LOW, HIGH, faces))
        labels, instances = shape.labels(mesh.vertices)
        areas = vertex_areas(mesh.vertices, mesh.faces)
        found = []
        for number, name in enumerate(shape.parts):
            below = [i for i, each in enumerate(shape.parts) if self._hangs(each, name)]
            paired = bool(((labels == number) & (instances == 1)).any())
            for side in (0, 1):
                alone = (labels == number) & (instances == side)
                whole = np.isin(labels, below) & ((instances == side) | (not paired))
                if areas[alone].sum() > SMALLEST * areas.sum():
                    found.append((alone, whole))
        return MadeShape(mesh, tuple(found))

    def _hangs(self, name: str | None, on: str) -> bool:
        while name is not None and name != on:
            name = self.above[name]
        return name == on


def _triple(point: Float64) -> tuple[float, float, float]:
    x, y, z = np.asarray(point, float).tolist()
    return x, y, z


def person(build: Builder) -> None:
    between, width = build.between, build.between(0.08, 0.2)
    torso = build.part(None, capsule((0, 0.45, 0), (0, 0.7, 0), width, width * between(0.8, 1.2)))
    if build.chance(0.5):
        build.extend(torso, ellipsoid((0, between(0.45, 0.6), between(0, 0.05)), (1.1 * width, width, 0.9 * width)))
    neck = torso
    if build.chance(0.6):
        neck = build.part(torso, capsule((0, 0.75, 0), (0, 0.82 + 0.5 * width, 0), width * between(0.3, 0.5)))
    build.head(neck, (0, 0.78 + 0.6 * width, 0), between(0.07, 0.14))
    thick = max(width * between(0.25, 0.45), 0.02)
    build.hand(*build.limb(torso, (0.9 * width, 0.7, 0), (1, between(-1.2, 0.3), 0.1), between(0.25, 0.45), thick))
    thick = max(width * between(0.3, 0.55), 0.025)
    start, along = (0.55 * width, 0.42, 0), (between(0, 0.3), -1, between(-0.1, 0.1))
    build.foot(*build.limb(torso, start, along, between(0.25, 0.42), thick, spread=0.08))
    if build.chance(0.3):
        start, along = (0, 0.45, -0.8 * width), (0, between(-0.6, 0.6), -1)
        build.limb(torso, start, along, between(0.15, 0.4), 0.3 * width, paired=False)
    if build.chance(0.25):
        wing = ellipsoid((width + 0.18, 0.68, -0.08), (between(0.15, 0.22), between(0.05, 0.12), 0.015))
        build.part(torso, wing, paired=True, smooth=0.5)


def animal(build: Builder) -> None:
    between, width, half = build.between, build.between(0.08, 0.17), build.between(0.15, 0.3)
    torso = build.part(None, capsule((0, 0.5, -half), (0, 0.52, half), width * between(0.8, 1.2), width))
    end = (0, 0.52 + 0.5 * width + between(0.1, 0.25), half + between(0.04, 0.2))
    neck = build.part(torso, capsule((0, 0.55, half), end, width * between(0.5, 0.7), width * between(0.4, 0.6)))
    build.head(neck, end, between(0.06, 0.11))
    for place in (0.9 * half, -0.9 * half):
        start, along = (0.6 * width, 0.46, place), (between(0, 0.2), -1, 0)
        thick = max(width * between(0.25, 0.5), 0.022)
        build.foot(*build.limb(torso, start, along, between(0.3, 0.42), thick, spread=0.06))
    if build.chance(0.8):
        start, along = (0, 0.55, -half - 0.7 * width), (0, between(-1, 1), -1)
        build.limb(torso, start, along, between(0.12, 0.4), width * between(0.15, 0.35), paired=False)


def insect(build: Builder) -> None:
    between, width, place = build.between, build.between(0.06, 0.14), 0.25
    first = above = None
    for _ in range(int(build.random.integers(1, 4))):
        size = width * between(0.6, 1.4)
        body = ellipsoid((0, 0.4, place), (size, size * between(0.7, 1.1), size * between(1, 1.8)))
        above = build.part(above, body)
        first, place = first or above, place - 2.2 * size
    assert first is not None
    pairs = int(build.random.integers(2, 5))
    for number in range(pairs):
        start, along = (0.7 * width, 0.4, 0.3 - 0.5 * number / pairs), (1, between(-0.6, 0.4), between(-0.4, 0.4))
        segments = int(build.random.integers(1, 3))
        build.limb(first, start, along, between(0.15, 0.35), between(0.012, 0.035), segments=segments)
    if build.chance(0.6):
        build.limb(first, (0.4 * width, 0.45, 0.3), (0.4, 0.7, 0.8), between(0.1, 0.25), 0.013, segments=1)
    if build.chance(0.5):
        fin = ellipsoid((0, 0.4 + 1.2 * width, 0.1), (0.014, width * between(0.5, 1), width * between(0.5, 1.2)))
        build.part(first, fin, smooth=0.5)
    if build.chance(0.4):
        wing = ellipsoid((width + 0.14, 0.45, 0.1), (between(0.12, 0.2), 0.014, between(0.05, 0.12)))
        build.part(first, wing, paired=True, smooth=0.5)


def furniture(build: Builder) -> None:
    between, build.blend = build.between, min(build.blend, 0.025)
    width, depth, height, thick = between(0.2, 0.36), between(0.2, 0.5), between(0.3, 0.5), between(0.02, 0.05)
    seat = build.part(None, rounded_box((0, height, 0), (width, thick, depth), 0.5 * thick))
    for place in (0.8 * depth, -0.8 * depth):
        start, along = (0.85 * width, height - 0.5 * thick, place), (between(0, 0.2), -1, 0)
        build.limb(seat, start, along, height - thick, between(0.018, 0.04), segments=1)
    back, tall = -0.9 * depth, between(0.2, 0.4)
    if build.chance(0.3):
        build.part(seat, rounded_box((0, height + 0.55 * tall, back), (0.95 * width, 0.5 * tall, 0.024), 0.012))
    elif build.chance(0.5):
        rail = build.part(seat, rounded_box((0, height + tall, back), (0.95 * width, 0.03, 0.022), 0.015))
        count = int(build.random.integers(1, 3))
        for number in range(count):
            x = 0.85 * width * (number + 0.5) / count
            slat = capsule((x, height, back), (x, height + tall, back), between(0.014, 0.025))
            build.part(rail, slat, paired=True)
    if build.chance(0.4):
        side, top, front = 0.95 * width, height + 0.14, 0.6 * depth
        rest = capsule((side, top, -0.8 * depth), (side, top, front), 0.022)
        build.part(seat, rest, capsule((side, height, front), (side, top, front), 0.02), paired=True)


def vessel(build: Builder) -> None:
    between, width = build.between, build.between(0.15, 0.28)
    body = build.part(None, capsule((0, 0.3, 0), (0, 0.3 + between(0.1, 0.4), 0), width, width * between(0.6, 1.2)))
    if build.chance(0.6):
        points = [(0, 0.35, 0.8 * width), (0, 0.4, width + 0.12), (0, 0.55, width + 0.13), (0, 0.62, 0.7 * width)]
        build.part(body, *chain(points, [0.022, 0.024, 0.024, 0.022]))
    if build.chance(0.4):
        thick = between(0.03, 0.05)
        build.limb(body, (0, 0.4, -0.8 * width), (0, 0.7, -1), between(0.15, 0.3), thick, paired=False, segments=1)
    if build.chance(0.5):
        radii = width * between(0.2, 0.5), width * between(0.25, 0.6)
        neck = build.part(body, capsule((0, 0.6, 0), (0, 0.85, 0), *radii))
        if build.chance(0.5):
            build.part(neck, ellipsoid((0, 0.93, 0), (0.3 * width,) * 3), smooth=0.5)
    if build.chance(0.5):
        disk = width * between(0.6, 1.2)
        stem = capsule((0, 0.1, 0), (0, 0.25, 0), width * between(0.2, 0.5))
        build.part(body, rounded_box((0, 0.08, 0), (disk, 0.025, disk), 0.02), stem)
    if build.chance(0.3):
        build.limb(body, (0.6 * width, 0.3, 0.5 * width), (0.3, -1, 0.2), 0.28, 0.03, segments=1)


KINDS = (person, animal, insect, furniture, vessel)


def made_shape(number: int) -> MadeShape:
    """Return the shape with a number. Numbers with the same remainder modulo 5 are of one kind."""
    build = Builder(np.random.default_rng(number))
    KINDS[number % len(KINDS)](build)
    return build.finished()
