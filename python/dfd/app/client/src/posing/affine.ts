/** (3, 4) affine maps, row-major, as arrays of 12 numbers; lengths in mesh units, angles in degrees. */

import { Quaternion as Turn } from "three";

export type Vec3 = readonly [number, number, number];
export type Quaternion = readonly [number, number, number, number];
export type Affine = readonly number[];

/** Three orthonormal vectors, one a row. */
export type Frame = readonly [Vec3, Vec3, Vec3];

export type PivotAt = "base" | "middle" | "point" | "plane" | "hinge";

export interface Transform {
  readonly translation: Vec3;
  /** Axis times angle, right-handed. */
  readonly rotation: Vec3;
  readonly scale: Vec3;
  /** Null is the handle's own position. */
  readonly pivot: Vec3 | null;
  /** What of the held part the pivot is, or that it is still to be found; null where it is numbers and nothing else. */
  readonly pivotAt: PivotAt | "auto" | null;
  /** Along which it scales; null is the mesh's own axes. */
  readonly axes: Frame | null;
  /** What the tip of the held part turns by along the part's own axis: a rotation vector, and degrees about the axis. */
  readonly bend: Vec3;
  readonly twist: number;
  /** Where along the axis, in [0, 1], that happens; null is all along it. */
  readonly joint: number | null;
}

export const IDENTITY: Affine = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0];
export const REST: Transform = {
  translation: [0, 0, 0],
  rotation: [0, 0, 0],
  scale: [1, 1, 1],
  pivot: null,
  pivotAt: null,
  axes: null,
  bend: [0, 0, 0],
  twist: 0,
  joint: null,
};

const UNIT_AXES: Frame = [
  [1, 0, 0],
  [0, 1, 0],
  [0, 0, 1],
];
const DEGREE = Math.PI / 180;

export function quaternionOf(rotation: Vec3): Quaternion {
  const degrees = Math.hypot(...rotation);
  if (degrees === 0) return [0, 0, 0, 1];
  const half = (degrees * DEGREE) / 2;
  const sine = Math.sin(half) / degrees;
  return [rotation[0] * sine, rotation[1] * sine, rotation[2] * sine, Math.cos(half)];
}

/** The rotation vector of a unit quaternion, the shorter way round. */
export function rotationOf(q: Quaternion): Vec3 {
  const sign = q[3] < 0 ? -1 : 1;
  const sine = Math.hypot(q[0], q[1], q[2]);
  if (sine === 0) return [0, 0, 0];
  const perSine = (sign * 2 * Math.atan2(sine, sign * q[3])) / DEGREE / sine;
  return [q[0] * perSine, q[1] * perSine, q[2] * perSine];
}

/** The map p ↦ pivot + translation + R S (p − pivot); `center` is the pivot of a transform without one. */
export function matrixOf(transform: Transform, center: Vec3): Affine {
  const [x, y, z, w] = quaternionOf(transform.rotation);
  const rows = [
    [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
    [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
    [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
  ];
  const pivot = transform.pivot ?? center;
  const stretch = stretchOf(transform.scale, transform.axes);
  return rows.flatMap((row, i) => {
    const scaled = [0, 1, 2].map((j) => row[0] * stretch[0][j] + row[1] * stretch[1][j] + row[2] * stretch[2][j]);
    const carried = scaled[0] * pivot[0] + scaled[1] * pivot[1] + scaled[2] * pivot[2];
    return [...scaled, pivot[i] + transform.translation[i] - carried];
  });
}

/** A S Aᵀ: scaled along axes that are the columns of A. */
function stretchOf(scale: Vec3, axes: Frame | null): readonly (readonly number[])[] {
  const along = axes ?? UNIT_AXES;
  return [0, 1, 2].map((i) =>
    [0, 1, 2].map((j) => scale.reduce((sum, factor, k) => sum + along[k][i] * factor * along[k][j], 0)),
  );
}

export function multiply(a: Affine, b: Affine): Affine {
  const product: number[] = [];
  for (let i = 0; i < 3; i++) {
    for (let j = 0; j < 4; j++) {
      const moved = a[4 * i] * b[j] + a[4 * i + 1] * b[4 + j] + a[4 * i + 2] * b[8 + j];
      product.push(moved + (j === 3 ? a[4 * i + 3] : 0));
    }
  }
  return product;
}

export function apply(a: Affine, p: Vec3): Vec3 {
  const row = (i: number) => a[4 * i] * p[0] + a[4 * i + 1] * p[1] + a[4 * i + 2] * p[2] + a[4 * i + 3];
  return [row(0), row(1), row(2)];
}

/** R of Eq. 8: the reflection across {p : normal · p = offset}. */
export function reflection(normal: Vec3, offset: number): Affine {
  return [0, 1, 2].flatMap((i) => [
    ...[0, 1, 2].map((j) => (i === j ? 1 : 0) - 2 * normal[i] * normal[j]),
    2 * offset * normal[i],
  ]);
}

export function add(a: Vec3, b: Vec3): Vec3 {
  return [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
}

export function subtract(a: Vec3, b: Vec3): Vec3 {
  return [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
}

/** Between two transforms: lengths and factors linearly, turns along the shorter arc. */
export function interpolate(a: Transform, b: Transform, t: number): Transform {
  const mix = (u: Vec3, v: Vec3): Vec3 => [
    u[0] + (v[0] - u[0]) * t,
    u[1] + (v[1] - u[1]) * t,
    u[2] + (v[2] - u[2]) * t,
  ];
  return {
    translation: mix(a.translation, b.translation),
    rotation: rotationOf(
      new Turn(...quaternionOf(a.rotation)).slerp(new Turn(...quaternionOf(b.rotation)), t).toArray(),
    ),
    scale: mix(a.scale, b.scale),
    pivot: a.pivot !== null && b.pivot !== null ? mix(a.pivot, b.pivot) : b.pivot,
    pivotAt: b.pivotAt,
    axes: b.axes,
    bend: mix(a.bend, b.bend),
    twist: a.twist + (b.twist - a.twist) * t,
    joint: b.joint,
  };
}

/** 1, 2 or 5 times a power of ten, near `step`. */
export function niceStep(step: number): number {
  const power = 10 ** Math.floor(Math.log10(step));
  const digit = step / power;
  return power * (digit < 1.5 ? 1 : digit < 3.5 ? 2 : digit < 7.5 ? 5 : 10);
}
