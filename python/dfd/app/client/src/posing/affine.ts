/** Transforms of handles, and their matrices. Lengths are in mesh units, and angles in degrees. */

import { MathUtils, Matrix4, Quaternion, Vector3 } from "three";

import type { PoseTransform } from "../protocol/messages";

export type Vec3 = readonly [number, number, number];

/** Three orthonormal vectors, one per row. */
export type Frame = readonly [Vec3, Vec3, Vec3];

/** The fields of a transform, as `dfd.posing.transforms` defines them, without the id of the handle. */
type Fields = Required<Omit<PoseTransform, "handle">>;
/** A transform of a handle. `pivot_at` may also be "auto": the server chooses the pivot. */
export type PivotAt = NonNullable<Fields["pivot_at"]>;
export type Transform = Omit<Fields, "pivot_at"> & { readonly pivot_at: Fields["pivot_at"] | "auto" };

/** Return the transform in an object with more fields. */
export function pickTransform(values: Transform): Transform {
  return Object.fromEntries(
    Object.keys(REST).map((key) => [key, values[key as keyof Transform]]),
  ) as unknown as Transform;
}

export const IDENTITY = new Matrix4();
export const REST: Transform = {
  translation: [0, 0, 0],
  rotation: [0, 0, 0],
  scale: [1, 1, 1],
  pivot: null,
  axes: null,
  pivot_at: null,
  bend: [0, 0, 0],
  twist: 0,
  joint: null,
};

/** Return the unit vector of an axis (0 to 2) of the mesh, or of the rotated handle if `local`; null without an axis. */
export function axisIn(transform: Transform, axis: number | null, local: boolean): Vector3 | null {
  if (axis === null) return null;
  const unit = new Vector3().setComponent(axis, 1);
  if (!local) return unit;
  if (transform.axes) unit.applyMatrix4(basisOf(transform.axes));
  return unit.applyQuaternion(quaternionOf(transform.rotation));
}

/** Return `start` with one more motion by a typed `value`, along or about `axis`. The usual axis is x; scale uses all. */
export function typedMotion(
  start: Transform,
  motion: "translate" | "rotate" | "scale" | "bend",
  axis: Vector3 | null,
  value: number,
): Transform {
  const along = (axis ?? new Vector3(1, 0, 0)).clone();
  const sum = (before: Vec3): Vec3 => new Vector3(...before).addScaledVector(along, value).toArray();
  if (motion === "translate") return { ...start, translation: sum(start.translation) };
  if (motion === "bend") return { ...start, bend: sum(start.bend) };
  if (motion === "rotate") {
    const turn = new Quaternion().setFromAxisAngle(along, MathUtils.degToRad(value));
    return { ...start, rotation: rotationOf(turn.multiply(quaternionOf(start.rotation)), sum(start.rotation)) };
  }
  if (value === 0) return start;
  const [x, y, z] = start.scale;
  if (!axis) return { ...start, scale: [x * value, y * value, z * value] };
  const [dx, dy, dz] = along.toArray().map((part) => 1 + (value - 1) * Math.abs(part));
  return { ...start, scale: [x * dx, y * dy, z * dz] };
}

export function quaternionOf(rotation: Vec3): Quaternion {
  const axis = new Vector3(...rotation);
  const angle = MathUtils.degToRad(axis.length());
  return new Quaternion().setFromAxisAngle(axis.normalize(), angle);
}

/**
 * Return the rotation vector of a unit quaternion, in degrees. Of those that differ by whole turns, it is the nearest to
 * `near`, so a drag can pass 180° and go on.
 */
export function rotationOf({ x, y, z, w }: Quaternion, near: Vec3 = [0, 0, 0]): Vec3 {
  const sine = Math.hypot(x, y, z);
  if (sine === 0) {
    const turns = Math.round(Math.hypot(...near) / 360);
    return turns === 0 ? [0, 0, 0] : new Vector3(...near).setLength(360 * turns).toArray();
  }
  const axis = new Vector3(x, y, z).divideScalar(sine);
  const degrees = MathUtils.radToDeg(2 * Math.atan2(sine, w));
  const turns = Math.round((axis.dot(new Vector3(...near)) - degrees) / 360);
  return axis.multiplyScalar(degrees + 360 * turns).toArray();
}

/** Return the matrix with these axes as columns. */
export function basisOf(axes: Frame): Matrix4 {
  const [x, y, z] = axes.map((axis) => new Vector3(...axis));
  return new Matrix4().makeBasis(x, y, z);
}

/** Return the map p ↦ pivot + translation + R S (p − pivot): S scales, R rotates. `center` replaces a missing pivot. */
export function matrixOf({ translation, rotation, scale, axes, pivot }: Transform, center: Vec3): Matrix4 {
  const stretch = new Matrix4().makeScale(...scale);
  if (axes) stretch.premultiply(basisOf(axes)).multiply(basisOf(axes).transpose());
  const linear = new Matrix4().makeRotationFromQuaternion(quaternionOf(rotation)).multiply(stretch);
  const [x, y, z] = pivot ?? center;
  return relative(linear, [-x, -y, -z]).premultiply(new Matrix4().makeTranslation(...translation));
}

/** Convert an affine map of points p to the same map of points p − center. */
export function relative(matrix: Matrix4, [x, y, z]: Vec3): Matrix4 {
  return new Matrix4()
    .makeTranslation(-x, -y, -z)
    .multiply(matrix)
    .multiply(new Matrix4().makeTranslation(x, y, z));
}

export function apply(matrix: Matrix4, point: Vec3): Vec3 {
  return new Vector3(...point).applyMatrix4(matrix).toArray();
}

/** Return R of Eq. 8, the reflection across the plane {p : normal · p = offset}. */
export function reflection([x, y, z]: Vec3, offset: number): Matrix4 {
  return new Matrix4().set(
    ...[1 - 2 * x * x, -2 * x * y, -2 * x * z, 2 * offset * x],
    ...[-2 * x * y, 1 - 2 * y * y, -2 * y * z, 2 * offset * y],
    ...[-2 * x * z, -2 * y * z, 1 - 2 * z * z, 2 * offset * z],
    ...[0, 0, 0, 1],
  );
}

export function add(a: Vec3, b: Vec3): Vec3 {
  return [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
}

export function subtract(a: Vec3, b: Vec3): Vec3 {
  return [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
}

/**
 * Interpolate all values linearly, also rotation vectors: on the way to a key of 270°, a part turns by 270°. A pose takes
 * a missing pivot or axes, and without a bend also the joint, from the other one. Exports use the same rule
 * (`dfd.export.key_poses.between`).
 */
export function interpolate(a: Transform, b: Transform, t: number): Transform {
  const mix = (u: Vec3, v: Vec3): Vec3 => new Vector3(...u).lerp(new Vector3(...v), t).toArray();
  const [from, to] = [a.pivot ?? b.pivot, b.pivot ?? a.pivot];
  return {
    translation: mix(a.translation, b.translation),
    rotation: mix(a.rotation, b.rotation),
    scale: mix(a.scale, b.scale),
    pivot: from && to && mix(from, to),
    pivot_at: b.pivot ? b.pivot_at : a.pivot_at,
    axes: b.axes ?? a.axes,
    bend: mix(a.bend, b.bend),
    twist: MathUtils.lerp(a.twist, b.twist, t),
    joint: b.twist !== 0 || b.bend.some((angle) => angle !== 0) ? b.joint : a.joint,
  };
}

/** Return a number near `step` that is 1, 2 or 5 times a power of ten. */
export function niceStep(step: number): number {
  const power = 10 ** Math.floor(Math.log10(step));
  const digit = step / power;
  return power * (digit < 1.5 ? 1 : digit < 3.5 ? 2 : digit < 7.5 ? 5 : 10);
}
