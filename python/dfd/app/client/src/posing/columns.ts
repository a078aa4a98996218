/**
 * The columns of weights of a scene, and their effect on single points, in float64. It equals the shader
 * `src/shaders/pose.glsl`, and serves marks, measurements and tests.
 */

import { Matrix4 } from "three";

import { apply, reflection, type Vec3 } from "./affine";

const UNIT = 1 / 65535;

export interface Column {
  /** The handle's number; 0 for a column that is only shown in the heat map. */
  readonly handle: number;
  /** (V) weights times 65535. */
  readonly weights: Uint16Array;
  /** Whether the column is on the positive side of the mirror plane. */
  readonly positive: boolean;
  /** Its factor in the heat map. */
  readonly heat: number;
  readonly transform: Matrix4;
}

export interface Mirror {
  readonly normal: Vec3;
  readonly offset: number;
  /** Half width of the blend band between the sides, mesh units. */
  readonly band: number;
}

export interface Scene {
  readonly columns: readonly Column[];
  readonly defaultTransform: Matrix4 | null;
  readonly mirror: Mirror | null;
}

export const EMPTY_SCENE: Scene = { columns: [], defaultTransform: null, mirror: null };

export function weightOf({ weights }: Column, vertex: number): number {
  return weights[vertex] * UNIT;
}

/** Whether two scenes look the same. */
export function sameScene(one: Scene, other: Scene): boolean {
  return (
    one.columns.length === other.columns.length &&
    one.columns.every((column, k) => sameParts(column, other.columns[k])) &&
    same(one.defaultTransform, other.defaultTransform) &&
    sameParts(one.mirror, other.mirror)
  );
}

function sameParts<Part extends object>(one: Part | null, other: Part | null): boolean {
  if (one === null || other === null) return one === other;
  return (Object.keys(one) as (keyof Part)[]).every((key) => same(one[key], other[key]));
}

function same(one: unknown, other: unknown): boolean {
  if (one instanceof Matrix4 && other instanceof Matrix4) return one.equals(other);
  if (Array.isArray(one) && Array.isArray(other)) return one.every((entry, i) => entry === other[i]);
  return Object.is(one, other);
}

/** The share of the positive side of the mirror plane at a point: a step, or smooth within the band. */
export function positiveShare(mirror: Mirror, point: Vec3): number {
  const [x, y, z] = mirror.normal;
  const height = x * point[0] + y * point[1] + z * point[2] - mirror.offset;
  if (mirror.band === 0) return height >= 0 ? 1 : 0;
  const t = Math.min(Math.max((0.5 * height) / mirror.band + 0.5, 0), 1);
  return t * t * (3 - 2 * t);
}

/** The transform on the other side of the mirror plane, R D R (Eq. 8). */
export function mirrored(transform: Matrix4, mirror: Mirror): Matrix4 {
  const across = reflection(mirror.normal, mirror.offset);
  return transform.clone().premultiply(across).multiply(across);
}

/** The posed position of one vertex, and its heat. */
export function posePoint(scene: Scene, point: Vec3, vertex: number): { position: Vec3; heat: number } {
  const { mirror } = scene;
  const positive = mirror ? positiveShare(mirror, point) : 1;
  const moved = [0, 0, 0];
  const addMove = (transform: Matrix4, weight: number) => {
    const target = apply(transform, point);
    for (let i = 0; i < 3; i++) moved[i] += weight * (target[i] - point[i]);
  };
  let total = 0;
  let heat = 0;
  for (const column of scene.columns) {
    const weight = weightOf(column, vertex);
    heat += weight * column.heat;
    if (column.handle === 0) continue;
    total += weight;
    const own = column.positive ? positive : 1 - positive;
    addMove(column.transform, weight * (mirror ? own : 1));
    if (mirror) addMove(mirrored(column.transform, mirror), weight * (1 - own));
  }
  if (scene.defaultTransform) addMove(scene.defaultTransform, Math.max(1 - total, 0));
  return { position: [point[0] + moved[0], point[1] + moved[1], point[2] + moved[2]], heat };
}
