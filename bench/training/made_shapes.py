"""Generate shapes whose parts are known: people, animals, furniture, wheels, hands, …, from rounded primitives.

Each primitive belongs to a named part, and each part hangs on another one. Parts that look alike have one kind, such as
all legs of an animal. Half of the shapes are symmetric in the plane x = 0; a smooth random displacement bends the
others. The sizes, the directions, the numbers of limbs and fingers, and the smoothness of the transitions are random.
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
Point = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class MadeShape:
    """A generated mesh, and its parts."""

    mesh: dfd.Mesh
    parts: tuple[tuple[Bool, Bool], ...]  # masks (V,) of each part: alone, and with all parts that hang on it
    kinds: tuple[tuple[str, str], ...]  # for each part, the kind of each of its masks: masks of one kind look alike
    family: str  # the generator that made the shape


class Builder:
    """Collect the primitives of a shape."""

    def __init__(self, random: np.random.Generator, family: str) -> None:
        self.random, self.family = random, family
        self.primitives: list[Primitive] = []
        self.above: dict[str, str | None] = {}  # for each part, the part on which it hangs
        self.kinds: dict[
            str, tuple[str, str]
        ] = {}  # for each part, the kind of the part alone, and with what hangs on it
        self.blend = self.between(0.006, 0.05)  # width of the smooth transitions

    def between(self, low: float, high: float) -> float:
        return float(self.random.uniform(low, high))

    def chance(self, probability: float) -> bool:
        return bool(self.random.random() < probability)

    def part(self, above: str | None, kind: str = "", whole: str = "") -> str:
        """Begin a part that hangs on `above`, and return its name.

        `kind` is the kind of the part alone, and `whole` that of the part with everything that hangs on it. Without
        `whole`, both are alike. Without `kind`, only the mirror image of the part looks alike.
        """
        name = f"part {len(self.above)}"
        self.above[name] = above
        self.kinds[name] = kind or name, whole or kind or name
        return name

    def add(self, name: str, distance: Distance, *, paired: bool = False, smooth: float | None = None) -> None:
        """Add a primitive to a part. `smooth` multiplies the width of the transition; None means a random factor."""
        factor = self.between(0.6, 1.3) if smooth is None else smooth
        self.primitives.append(Primitive(name, distance, 0, paired, self.blend * factor))

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
        spread: float = 0.35,
        kind: str = "",
    ) -> tuple[str, Float64, Float64, float]:
        """Add a chain of segments, each a part. Return the last segment, its end, its direction and its radius."""
        count = segments or int(self.random.integers(1, 4))
        at, along = np.array(start, float), np.array(direction, float)
        along /= np.linalg.norm(along)
        for number in range(count):
            named = f"{kind} {number} of {count}" if kind else ""
            above = self.part(above, named, kind if number == 0 else named)
            end = at + along * (length / count * self.between(0.8, 1.2))
            thin = radius * self.between(0.6, 0.95)
            rod = capsule(_point(at), _point(end), radius, thin)
            self.add(above, rod, paired=paired, smooth=None if number else 1.2)
            if number and self.chance(0.3):
                self.add(above, ellipsoid(_point(at), (1.25 * radius,) * 3), paired=paired)
            at, radius = end, thin
            along = along + self.random.normal(size=3) * spread * 0.5
            along /= np.linalg.norm(along)
        return above, at, along, radius

    def hand(self, above: str, at: Float64, along: Float64, radius: float) -> None:
        """Add a hand with up to five fingers."""
        hand, size = self.part(above), radius * self.between(1.1, 1.9)
        x, y, z = (size * self.between(0.7, 1.1) for _ in range(3))
        self.add(hand, ellipsoid(_point(at + along * size * 0.6), (x, y, z)), paired=True, smooth=0.6)
        count, palm = int(self.random.integers(0, 6)), at + along * size
        aside = np.cross(along, [0.3, 1, 0.2])
        aside /= np.linalg.norm(aside)
        for number in range(count):
            finger, side = self.part(hand, "finger"), 2 * (number + 0.5) / count - 1
            start, towards = palm + aside * size * 0.75 * side, along + aside * 0.5 * side
            towards /= np.linalg.norm(towards)
            length = size * self.between(0.9, 1.8)
            thick = max(size * 0.8 / max(count, 3) * self.between(0.7, 1.0), 0.008)
            rod = capsule(_point(start), _point(start + towards * length), thick, thick * 0.8)
            self.add(finger, rod, paired=True, smooth=0.3)

    def foot(self, above: str, at: Float64, along: Float64, radius: float) -> None:
        """Add a shoe, a hoof or a paw."""
        foot, size, kind = self.part(above, "foot"), radius * self.between(1.0, 1.7), self.random.random()
        if kind < 0.4:
            half = size * self.between(0.7, 1), size * self.between(0.4, 0.7), size * self.between(1.2, 2)
            shoe = rounded_box(_point(at + np.array([0, 0, size * 0.6])), half, size * 0.35)
            self.add(foot, shoe, paired=True, smooth=0.6)
        elif kind < 0.7:
            hoof = capsule(_point(at), _point(at + along * size * 1.2), size * 0.8, size)
            self.add(foot, hoof, paired=True, smooth=0.4)
        else:
            paw = ellipsoid(_point(at + along * size * 0.5), (size, size * 0.7, size * 1.3))
            self.add(foot, paw, paired=True, smooth=0.6)

    def head(self, above: str, at: Point, size: float) -> None:
        """Add a head, perhaps with a muzzle, ears, horns, eyes and a hat."""
        between, head = self.between, self.part(above)
        x, y, z = size * between(0.8, 1.1), size * between(0.8, 1.1), size * between(0.9, 1.3)
        center = np.array(at) + [0, y * 0.7, z * 0.3]
        self.add(head, ellipsoid(_point(center), (x, y, z)))
        if self.chance(0.6):
            muzzle, length = self.part(head), size * between(0.6, 1.2)
            start, end = center + [0, -0.2 * size, z * 0.6], center + [0, -0.35 * size, z * 0.6 + length]
            self.add(muzzle, capsule(_point(start), _point(end), size * between(0.4, 0.6), size * between(0.25, 0.45)))
        if self.chance(0.7):
            ear, height, width = self.part(head), size * between(0.4, 1.3), size * between(0.15, 0.35)
            root = center + [x * between(0.5, 0.9), y * between(0.5, 0.8), between(-0.3, 0.2) * size]
            middle = root + [height * 0.5 * between(0, 1), height * 0.5, 0]
            radii = (width, height * 0.7, max(size * between(0.08, 0.2), 0.012))
            self.add(ear, ellipsoid(_point(middle), radii, roll=between(-0.8, 0.2)), paired=True, smooth=0.5)
        if self.chance(0.4):
            root, along = center + [x * between(0.2, 0.5), y * 0.75, 0], (between(0.1, 1), 1, between(-0.4, 0.6))
            length, thick = size * between(0.5, 1.6), max(size * between(0.1, 0.2), 0.014)
            self.limb(head, root.tolist(), along, length, thick, segments=1)
        if self.chance(0.4):
            eye, radius = self.part(head), size * between(0.12, 0.28)
            place = _point(center + [x * 0.45, y * 0.2, z * 0.8])
            self.add(eye, ellipsoid(place, (radius, radius, radius)), paired=True, smooth=0.15)
        if self.chance(0.2):
            hat, brim, top = self.part(head), _point(center + [0, y * 0.9, 0]), _point(center + [0, y * 1.6, 0])
            self.add(hat, ellipsoid(brim, (x * 1.3, size * 0.12, z * 1.2)), smooth=0.3)
            self.add(hat, capsule(brim, top, x * 0.7, x * 0.5), smooth=0.3)

    def finished(self, faces: int = FACES) -> MadeShape:
        """Return the mesh and its parts."""
        shape = Shape(self.primitives)
        vertices, triangles = polygonize(shape, LOW, HIGH, faces)
        labels, instances = shape.labels(vertices)
        if self.chance(0.5):
            vertices = self._displaced(vertices)
        mesh = dfd.Mesh(vertices, triangles)
        areas = vertex_areas(mesh.vertices, mesh.faces)
        found, kinds = [], []
        for number, name in enumerate(shape.parts):
            below = [i for i, each in enumerate(shape.parts) if self._hangs(each, name)]
            paired = bool(((labels == number) & (instances == 1)).any())
            for side in (0, 1):
                alone = (labels == number) & (instances == side)
                whole = np.isin(labels, below) & ((instances == side) | (not paired))
                if areas[alone].sum() > SMALLEST * areas.sum():
                    found.append((alone, whole))
                    kinds.append(self.kinds[name])
        return MadeShape(mesh, tuple(found), tuple(kinds), self.family)

    def _displaced(self, vertices: Float64) -> Float64:
        """Return `vertices` (V, 3), moved by three smooth waves that are not symmetric."""
        moved = np.array(vertices, np.float64)
        for _ in range(3):
            wave, push = self.random.normal(size=3), self.random.normal(size=3)
            phase = vertices @ (wave / np.linalg.norm(wave) * self.between(1.5, 3.5)) + self.between(0, 6.3)
            moved += np.sin(phase)[:, None] * push * 0.04
        return moved

    def _hangs(self, name: str | None, on: str) -> bool:
        while name is not None and name != on:
            name = self.above[name]
        return name == on


def _point(position: Float64) -> Point:
    x, y, z = np.asarray(position, float).tolist()
    return x, y, z


def person(build: Builder) -> None:
    between = build.between
    width, torso = between(0.08, 0.2), build.part(None)
    build.add(torso, capsule((0, 0.45, 0), (0, 0.7, 0), width, width * between(0.8, 1.2)))
    if build.chance(0.5):
        place = (0, between(0.45, 0.6), between(0, 0.05))
        build.add(torso, ellipsoid(place, (width * 1.1, width, width * between(0.8, 1.2))))
    neck = torso
    if build.chance(0.6):
        neck = build.part(torso)
        build.add(neck, capsule((0, 0.75, 0), (0, 0.82 + width * 0.5, 0), width * between(0.3, 0.5)))
    build.head(neck, (0, 0.78 + width * 0.6, 0), between(0.07, 0.14))
    thick, along = width * between(0.25, 0.45), (1, between(-1.2, 0.3), between(-0.2, 0.5))
    build.hand(*build.limb(torso, (width * 0.9, 0.7, 0), along, between(0.25, 0.45), max(thick, 0.02)))
    thick, along = width * between(0.3, 0.55), (between(0, 0.3), -1, between(-0.1, 0.1))
    start, length = (width * 0.55, 0.42, 0), between(0.25, 0.42)
    build.foot(*build.limb(torso, start, along, length, max(thick, 0.025), spread=0.15))
    if build.chance(0.3):
        start, along = (0, 0.45, -width * 0.8), (0, between(-0.6, 0.6), -1)
        build.limb(torso, start, along, between(0.15, 0.4), width * 0.3, paired=False)
    if build.chance(0.25):
        wing, radii = build.part(torso), (between(0.15, 0.22), between(0.05, 0.12), 0.015)
        shape = ellipsoid((width + 0.18, 0.68, -0.08), radii, roll=between(-0.3, 0.3))
        build.add(wing, shape, paired=True, smooth=0.5)


def animal(build: Builder) -> None:
    between = build.between
    width, half, torso = between(0.08, 0.17), between(0.15, 0.3), build.part(None)
    build.add(torso, capsule((0, 0.5, -half), (0, 0.52, half), width * between(0.8, 1.2), width))
    neck, rise = build.part(torso), between(0.2, 1.0)
    end = (0.0, 0.52 + width * 0.5 + between(0.1, 0.25), half + rise * 0.2)
    build.add(neck, capsule((0, 0.55, half), end, width * between(0.5, 0.7), width * between(0.4, 0.6)))
    build.head(neck, end, between(0.06, 0.11))
    segments, thick = int(build.random.integers(1, 4)), max(width * between(0.25, 0.5), 0.022)
    for place in (half * 0.9, -half * 0.9):
        start, along, length = (width * 0.6, 0.46, place), (between(0, 0.2), -1, 0), between(0.3, 0.42)
        build.foot(*build.limb(torso, start, along, length, thick, spread=0.12, segments=segments, kind="leg"))
    if build.chance(0.8):
        start, along = (0, 0.55, -half - width * 0.7), (0, between(-1, 1), -1)
        build.limb(torso, start, along, between(0.12, 0.4), width * between(0.15, 0.35), paired=False)


def insect(build: Builder) -> None:
    between, place = build.between, 0.25
    width, count = between(0.06, 0.14), int(build.random.integers(1, 4))
    above, bodies = None, []
    for _ in range(count):
        above, size = build.part(above), width * between(0.6, 1.4)
        radii = (size, size * between(0.7, 1.1), size * between(1, 1.8))
        build.add(above, ellipsoid((0, 0.4, place), radii))
        bodies.append(above)
        place -= size * 2.2
    pairs, segments = int(build.random.integers(2, 5)), int(build.random.integers(1, 3))
    long, thick = between(0.15, 0.35), between(0.012, 0.035)
    for number in range(pairs):
        start, along = (width * 0.7, 0.4, 0.3 - 0.5 * number / pairs), (1, between(-0.6, 0.4), between(-0.4, 0.4))
        length = long * between(0.8, 1.25)
        build.limb(bodies[0], start, along, length, thick, segments=segments, kind="leg")
    if build.chance(0.6):
        build.limb(bodies[0], (width * 0.4, 0.45, 0.3), (0.4, 0.7, 0.8), between(0.1, 0.25), 0.013, segments=1)
    if build.chance(0.5):
        fin, radii = build.part(bodies[0]), (0.014, width * between(0.5, 1), width * between(0.5, 1.2))
        build.add(fin, ellipsoid((0, 0.4 + width * 1.2, 0.1), radii), smooth=0.5)
    if build.chance(0.4):
        wing, radii = build.part(bodies[0]), (between(0.12, 0.2), 0.014, between(0.05, 0.12))
        build.add(wing, ellipsoid((width + 0.14, 0.45, 0.1), radii), paired=True, smooth=0.5)


def furniture(build: Builder) -> None:
    between = build.between
    width, depth, height, thick = between(0.2, 0.36), between(0.2, 0.5), between(0.3, 0.5), between(0.02, 0.05)
    seat = build.part(None)
    build.add(seat, rounded_box((0, height, 0), (width, thick, depth), thick * 0.5))
    build.blend = min(build.blend, 0.025)
    radius = between(0.018, 0.04)
    for place in (depth * 0.8, -depth * 0.8):
        start, along = (width * 0.85, height - thick * 0.5, place), (between(0, 0.2), -1, 0)
        build.limb(seat, start, along, height - thick, radius, segments=1, spread=0, kind="leg")
    back = -depth * 0.9
    if build.chance(0.6):
        tall = between(0.2, 0.4)
        if build.chance(0.5):
            panel, half = build.part(seat), (width * 0.95, tall * 0.5, between(0.018, 0.03))
            build.add(panel, rounded_box((0, height + tall * 0.55, back), half, 0.012))
        else:
            rail = build.part(seat)
            build.add(rail, rounded_box((0, height + tall, back), (width * 0.95, 0.03, 0.022), 0.015))
            for number in range(int(build.random.integers(1, 3))):
                slat, x = build.part(rail, "slat"), width * 0.85 * (number + 0.5) / 2
                rod = capsule((x, height, back), (x, height + tall, back), between(0.014, 0.025))
                build.add(slat, rod, paired=True)
    if build.chance(0.4):
        rest, side, top, front = build.part(seat), width * 0.95, height + 0.14, depth * 0.6
        build.add(rest, capsule((side, top, -depth * 0.8), (side, top, front), 0.022), paired=True)
        build.add(rest, capsule((side, height, front), (side, top, front), 0.02), paired=True)


def vessel(build: Builder) -> None:
    between, body = build.between, build.part(None)
    width = between(0.15, 0.28)
    top = (0, 0.3 + between(0.1, 0.4), 0)
    build.add(body, capsule((0, 0.3, 0), top, width, width * between(0.6, 1.2)))
    if build.chance(0.6):
        handle = build.part(body)
        points = [(0, 0.35, width * 0.8), (0, 0.4, width + 0.12), (0, 0.55, width + 0.13), (0, 0.62, width * 0.7)]
        for rod in chain(points, [0.022, 0.024, 0.024, 0.022]):
            build.add(handle, rod)
    if build.chance(0.4):
        length, thick = between(0.15, 0.3), between(0.03, 0.05)
        build.limb(body, (0, 0.4, -width * 0.8), (0, 0.7, -1), length, thick, paired=False, segments=1)
    if build.chance(0.5):
        neck = build.part(body)
        build.add(neck, capsule((0, 0.6, 0), (0, 0.85, 0), width * between(0.2, 0.5), width * between(0.25, 0.6)))
        if build.chance(0.5):
            build.add(build.part(neck), ellipsoid((0, 0.93, 0), (width * 0.3,) * 3), smooth=0.5)
    if build.chance(0.5):
        base, half = build.part(body), (width * between(0.6, 1.2), 0.025, width * between(0.6, 1.2))
        build.add(base, rounded_box((0, 0.08, 0), half, 0.02))
        build.add(base, capsule((0, 0.1, 0), (0, 0.25, 0), width * between(0.2, 0.5)))
    if build.chance(0.3):
        build.limb(body, (width * 0.6, 0.3, width * 0.5), (0.3, -1, 0.2), 0.28, 0.03, segments=1)


def octopus(build: Builder) -> None:
    between, body = build.between, build.part(None)
    size, count = between(0.12, 0.22), 2 * int(build.random.integers(2, 5))
    build.add(body, ellipsoid((0, 0.7, 0), (size, size * between(0.9, 1.6), size)))
    length, thick, drop, turn = between(0.3, 0.7), size * between(0.15, 0.4), between(0.2, 1.0), build.chance(0.5)
    for number in range(count // 2):
        angle = 2 * np.pi * (number + 0.5) / count
        across, along = float(np.sin(angle)), float(np.cos(angle))
        start = (size * 0.7 * across, 0.62, size * 0.7 * along)
        segments = 3 if turn else 1
        direction = (across, -drop, along)
        build.limb(body, start, direction, length * between(0.8, 1.2), thick, segments=segments, spread=0.5, kind="arm")
    if build.chance(0.5):
        eye, radius = build.part(body), size * between(0.15, 0.25)
        build.add(eye, ellipsoid((size * 0.5, 0.75, size * 0.8), (radius,) * 3), paired=True, smooth=0.15)


def hand_alone(build: Builder) -> None:
    between, palm = build.between, build.part(None)
    half, count = between(0.12, 0.2), int(build.random.integers(3, 6))
    build.add(palm, rounded_box((0, 0.5, 0), (half * between(0.25, 0.5), half * between(0.9, 1.3), half), half * 0.25))
    thick, long = half * between(0.7, 0.95) / count, half * between(1.3, 2.2)
    for number in range(count):
        side = 2 * (number + 0.5) / count - 1
        start, along = (0, 0.5 + half * 0.8, half * 0.8 * side), (0, 1, between(0.1, 0.5) * side)
        length = long * (1 - 0.25 * side * side) * between(0.85, 1.15)
        build.limb(palm, start, along, length, thick, segments=1, paired=False, kind="finger")
    if build.chance(0.7):
        start, along = (0, 0.45, -half * 0.8), (0, between(0.2, 1), -1)
        build.limb(palm, start, along, long * 0.7, thick * 1.2, paired=False, segments=1)
    wrist = build.part(palm)
    build.add(wrist, capsule((0, 0.42 - half, 0), (0, 0.1, 0), half * between(0.35, 0.6)))


def wheel(build: Builder) -> None:
    """Make a wheel with spokes, or a flower with petals, in the plane x = 0."""
    between, hub = build.between, build.part(None)
    count, size, radius = int(build.random.integers(3, 9)), between(0.06, 0.14), between(0.35, 0.6)
    build.add(hub, ellipsoid((0, 0.7, 0), (size, size, size)))
    rimmed, thick = build.chance(0.5), between(0.02, 0.05)
    for number in range(count):
        angle = 2 * np.pi * number / count
        along = np.array([0, np.cos(angle), np.sin(angle)])
        start, end = along * size * 0.6 + [0, 0.7, 0], along * radius + [0, 0.7, 0]
        tip = thick if rimmed else thick * between(0.8, 2.2)
        build.add(build.part(hub, "spoke"), capsule(_point(start), _point(end), thick, tip), smooth=0.6)
    if rimmed:
        rim, angles = build.part(hub), np.linspace(0, 2 * np.pi, 25)
        points = [(0.0, 0.7 + radius * float(np.cos(each)), radius * float(np.sin(each))) for each in angles]
        for rod in chain(points, [between(0.03, 0.06)] * len(points)):
            build.add(rim, rod, smooth=0.6)
    elif build.chance(0.5):
        build.limb(hub, (0, 0.65, 0), (between(-1, 1), -1, 0), between(0.3, 0.6), thick, paired=False, segments=1)


def vehicle(build: Builder) -> None:
    between, body = build.between, build.part(None)
    width, height, half = between(0.14, 0.24), between(0.06, 0.14), between(0.35, 0.65)
    build.blend = min(build.blend, 0.02)
    build.add(body, rounded_box((0, 0.4, 0), (width, height, half), 0.03))
    if build.chance(0.7):
        cabin, long = build.part(body), half * between(0.3, 0.6)
        build.add(cabin, rounded_box((0, 0.4 + height + 0.08, between(-0.1, 0.1)), (width * 0.85, 0.1, long), 0.03))
    size, pairs = between(0.07, 0.13), int(build.random.integers(2, 4))
    for number in range(pairs):
        place = half * 0.8 * (2 * number / (pairs - 1) - 1)
        tire = ellipsoid((width, 0.4 - height, place), (between(0.03, 0.05), size, size))
        build.add(build.part(body, "wheel"), tire, paired=True, smooth=0.3)
    if build.chance(0.6):
        radius = between(0.025, 0.04)
        lamp = ellipsoid((width * 0.6, 0.42, half), (radius,) * 3)
        build.add(build.part(body), lamp, paired=True, smooth=0.3)
    if build.chance(0.4):
        exhaust = capsule((width * 0.5, 0.35, -half), (width * 0.5, 0.35, -half - 0.12), 0.02)
        build.add(build.part(body), exhaust, paired=build.chance(0.5), smooth=0.3)


def rack(build: Builder) -> None:
    """Make a row of equal things on a board: a fence, a comb, a table with many legs, or a rack of knobs."""
    between, board = build.between, build.part(None)
    half, thick = between(0.4, 0.9), between(0.02, 0.05)
    build.blend = min(build.blend, 0.02)
    build.add(board, rounded_box((0, 0.7, 0), (between(0.03, 0.25), thick, half), thick * 0.5))
    count, radius, long = int(build.random.integers(3, 8)), between(0.018, 0.04), between(0.08, 0.4)
    down, knob = -1 if build.chance(0.6) else 1, build.chance(0.4)
    for number in range(count):
        place = half * 0.9 * (2 * number / (count - 1) - 1)
        rod = build.part(board, "rod", "rod with knob")
        build.add(rod, capsule((0, 0.7, place), (0, 0.7 + down * long, place), radius), smooth=0.4)
        if knob:
            end = ellipsoid((0, 0.7 + down * (long + radius), place), (radius * 2,) * 3)
            build.add(build.part(rod, "knob"), end, smooth=0.4)
    if build.chance(0.4):
        rail = (0, 0.7 + down * long * 0.6, -half), (0, 0.7 + down * long * 0.6, half)
        build.add(build.part(board), capsule(*rail, radius * 0.8), smooth=0.4)


def tool(build: Builder) -> None:
    """Make glasses, tongs or a plane: two long arms, and something between them."""
    between, middle = build.between, build.part(None)
    size = between(0.05, 0.12)
    build.add(middle, ellipsoid((0, 0.6, 0), (size * between(1, 2), size, size)))
    start, along = (size * 0.8, 0.6, 0), (between(0.3, 1), between(-0.3, 0.3), between(-1, 1))
    above, at, *_ = build.limb(middle, start, along, between(0.2, 0.45), size * between(0.3, 0.6), segments=1)
    if build.chance(0.6):
        build.add(
            build.part(above), ellipsoid(_point(at), (between(0.05, 0.12), between(0.05, 0.12), 0.03)), paired=True
        )
    if build.chance(0.6):
        start, along = (size * 0.5, 0.6, -size * 0.5), (between(0.1, 0.5), between(-0.2, 0.2), -1)
        build.limb(middle, start, along, between(0.2, 0.5), size * between(0.3, 0.6))
    if build.chance(0.5):
        build.limb(
            middle, (0, 0.6, size * 0.7), (0, between(-0.5, 0.5), 1), between(0.15, 0.5), size * 0.6, paired=False
        )


FAMILIES = (person, animal, insect, furniture, vessel, octopus, hand_alone, wheel, vehicle, rack, tool)


def made_shape(number: int) -> MadeShape:
    """Return the shape with a number. Numbers with the same remainder modulo `len(FAMILIES)` are of one family."""
    family = FAMILIES[number % len(FAMILIES)]
    build = Builder(np.random.default_rng(number), family.__name__)
    family(build)
    return build.finished()
