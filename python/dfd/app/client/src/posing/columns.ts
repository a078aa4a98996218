/** The scene that the shader `pose.glsl` poses. `posePoint` poses single points by the same equations. */

import { MathUtils, Vector3, type Matrix4 } from "three";

import { reflection, type Vec3 } from "./affine";

/** The weights and the transform of a handle at one of its counterparts, or weights that only the heat map shows. */
export interface Column {
  /** The handle's identifier; 0 for a column that only the heat map shows. */
  readonly handle: number;
  /** Weights times 65535, (V). */
  readonly weights: Uint16Array;
  /** Whether the handle or counterpart is on the positive side of the mirror plane. */
  readonly positive: boolean;
  /** The heat map shows the sum of weight times `heat` over all columns. */
  readonly heat: number;
  readonly transform: Matrix4;
}

export interface Mirror {
  readonly normal: Vec3;
  readonly offset: number;
  /** Half the width of the band in which the motions of both sides blend, in mesh units. */
  readonly band: number;
}

export interface Scene {
  readonly columns: readonly Column[];
  readonly defaultTransform: Matrix4 | null;
  readonly mirror: Mirror | null;
}

export const EMPTY_SCENE: Scene = { columns: [], defaultTransform: null, mirror: null };

export function weightOf({ weights }: Column, vertex: number): number {
  return weights[vertex] / 65535;
}

/** Return whether two scenes, or parts of them, are equal. Weights are compared by identity. */
export function sameScene(one: unknown, other: unknown): boolean {
  if (!hasParts(one) || !hasParts(other)) return one === other;
  const keys = Object.keys(one);
  return keys.length === Object.keys(other).length && keys.every((key) => sameScene(one[key], other[key]));
}

function hasParts(value: unknown): value is Record<string, unknown> {
  return value instanceof Object && !ArrayBuffer.isView(value);
}

/** Return the signed distance of a point from a plane {p : normal · p = offset}. */
export function height({ normal, offset }: Omit<Mirror, "band">, point: Vec3): number {
  return new Vector3(...normal).dot(new Vector3(...point)) - offset;
}

/** Return the weight of the positive side's motion at a point: 0 or 1 outside the band, and a smoothstep inside it. */
function positiveShare(mirror: Mirror, point: Vec3): number {
  const above = height(mirror, point);
  if (mirror.band === 0) return above >= 0 ? 1 : 0;
  return MathUtils.smoothstep(above, -mirror.band, mirror.band);
}

/** Return the transform R D R for the other side of the mirror plane (Eq. 8). */
export function mirrored(transform: Matrix4, mirror: Mirror): Matrix4 {
  const across = reflection(mirror.normal, mirror.offset);
  return transform.clone().premultiply(across).multiply(across);
}

/** Return the posed position of one vertex (Eq. 1 and 8). */
export function posePoint(scene: Scene, point: Vec3, vertex: number): Vec3 {
  const { mirror } = scene;
  const positive = mirror ? positiveShare(mirror, point) : 1;
  const from = new Vector3(...point);
  const posed = from.clone();
  const addMove = (transform: Matrix4, weight: number) =>
    posed.addScaledVector(from.clone().applyMatrix4(transform).sub(from), weight);
  let total = 0;
  for (const column of scene.columns) {
    if (column.handle === 0) continue;
    const weight = weightOf(column, vertex);
    total += weight;
    const ownShare = column.positive ? positive : 1 - positive;
    addMove(column.transform, weight * (mirror ? ownShare : 1));
    if (mirror) addMove(mirrored(column.transform, mirror), weight * (1 - ownShare));
  }
  if (scene.defaultTransform) addMove(scene.defaultTransform, Math.max(1 - total, 0));
  return posed.toArray();
}
