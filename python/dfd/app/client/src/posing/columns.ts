/**
 * What poses the shape: a column of weights per handle or counterpart, and what they do to single points, in float64. The
 * twin of `src/shaders/pose.glsl`: for marks and measures, and for tests to compare with.
 */

import type { HandleState } from "../protocol/messages";
import { Matrix4 } from "three";

import { apply, reflection, type Vec3 } from "./affine";

export type Falloff = HandleState["falloff"];
/** Their numbers in the shader. */
export const FALLOFFS: Record<Falloff, number> = { linear: 0, smooth: 1, sharp: 2, root: 3, sphere: 4, constant: 5 };

const UNIT = 1 / 65535;

/** Numbers per vertex that lie in one layer of the texture: `values` times `scale` / 65535. */
export interface Layer {
  /** (V) feature distances, weights or shares. */
  readonly values: Uint16Array;
  readonly scale: number;
  readonly kind: "distance" | "weight";
  /** (V) distances along the surface in [0, 65535]; null is 0 everywhere. */
  readonly geodesic: Uint16Array | null;
}

export function weightLayer(values: Uint16Array): Layer {
  return { values, scale: 1, kind: "weight", geodesic: null };
}

export interface Column {
  /** The handle's number; 0 is the probe under the pointer, which moves nothing. */
  readonly handle: number;
  readonly layer: Layer;
  /** Weights of the fixed places; null where there are none. */
  readonly fixed: Layer | null;
  /** Share of this counterpart in the handle's weight; null is all of it. */
  readonly share: Layer | null;
  readonly shareGain: number;
  readonly reach: number;
  readonly falloff: Falloff;
  /** λ of Eq. 7. */
  readonly exponent: number;
  readonly gain: number;
  readonly strength: number;
  /** Whether the handle stands on the side that the mirror's normal points to. */
  readonly positive: boolean;
  /** How much of it the heat map shows. */
  readonly heat: number;
  readonly transform: Matrix4;
  /** Whether it takes part in the sum of weights. */
  readonly acts: boolean;
}

export interface Mirror {
  readonly normal: Vec3;
  readonly offset: number;
  /** Half width over which the sides blend, mesh units. */
  readonly band: number;
}

export interface Scene {
  readonly columns: readonly Column[];
  readonly defaultTransform: Matrix4 | null;
  readonly mirror: Mirror | null;
}

export const EMPTY_SCENE: Scene = { columns: [], defaultTransform: null, mirror: null };

export const CURVES: Record<Falloff, (q: number) => number> = {
  linear: (q) => q,
  smooth: (q) => q * q * (3 - 2 * q),
  sharp: (q) => q * q,
  root: Math.sqrt,
  sphere: (q) => Math.sqrt(q * (2 - q)),
  constant: (q) => (q > 0 ? 1 : 0),
};

/** Weight of one vertex for a column: Eq. 4 to 7 with reach, falloff, gain and strength, and the counterpart's share. */
export function weightOf(column: Column, vertex: number): number {
  const { layer, fixed, share } = column;
  let weight = layer.values[vertex] * UNIT * layer.scale;
  if (layer.kind === "distance") {
    weight = CURVES[column.falloff](Math.max(1 - weight / column.reach, 0));
    if (fixed) weight = Math.max(weight - fixed.values[vertex] * UNIT * fixed.scale, 0);
    const along = layer.geodesic ? layer.geodesic[vertex] * UNIT : 0;
    if (column.exponent > 0) weight *= Math.max(1 - along, 0) ** column.exponent;
    weight = column.strength * Math.min(column.gain * weight, 1);
  }
  return share ? Math.min(column.shareGain * share.values[vertex] * UNIT * weight, 1) : weight;
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

/** How much of a point belongs to the side that the mirror's normal points to: a step, or smooth over the band. */
export function positiveShare(mirror: Mirror, point: Vec3): number {
  const [x, y, z] = mirror.normal;
  const height = x * point[0] + y * point[1] + z * point[2] - mirror.offset;
  if (mirror.band === 0) return height >= 0 ? 1 : 0;
  const t = Math.min(Math.max((0.5 * height) / mirror.band + 0.5, 0), 1);
  return t * t * (3 - 2 * t);
}

/** The transform as it acts on the other side of the mirror, R D R (Eq. 8). */
export function mirrored(transform: Matrix4, mirror: Mirror): Matrix4 {
  const across = reflection(mirror.normal, mirror.offset);
  return transform.clone().premultiply(across).multiply(across);
}

/** Where one vertex goes, and how warm it is in the heat map. */
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
    if (!column.acts) continue;
    total += weight;
    const own = column.positive ? positive : 1 - positive;
    addMove(column.transform, weight * (mirror ? own : 1));
    if (mirror) addMove(mirrored(column.transform, mirror), weight * (1 - own));
  }
  if (scene.defaultTransform) addMove(scene.defaultTransform, Math.max(1 - total, 0));
  return { position: [point[0] + moved[0], point[1] + moved[1], point[2] + moved[2]], heat };
}
