/** What poses the shape: a column of weights per handle or instance, and how they are made of what is stored. */

import type { Affine, Vec3 } from "./affine";

export const FALLOFFS = ["linear", "smooth", "sharp", "root", "sphere", "constant"] as const;
export type Falloff = (typeof FALLOFFS)[number];

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

export interface Column {
  /** The handle's number; 0 is the probe under the pointer, which moves nothing. */
  readonly handle: number;
  readonly layer: Layer;
  /** Weights of the fixed places; null where there are none. */
  readonly fixed: Layer | null;
  /** Share of this instance in the handle's weight; null is all of it. */
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
  readonly transform: Affine;
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
  readonly defaultTransform: Affine | null;
  readonly mirror: Mirror | null;
}

export const EMPTY_SCENE: Scene = { columns: [], defaultTransform: null, mirror: null };

export function isFalloff(name: string): name is Falloff {
  return (FALLOFFS as readonly string[]).includes(name);
}

export function falloff(q: number, kind: Falloff): number {
  switch (kind) {
    case "linear":
      return q;
    case "smooth":
      return q * q * (3 - 2 * q);
    case "sharp":
      return q * q;
    case "root":
      return Math.sqrt(q);
    case "sphere":
      return Math.sqrt(q * (2 - q));
    case "constant":
      return q > 0 ? 1 : 0;
  }
}

/** Weight of one vertex for a column: Eq. 4 to 7 with reach, falloff, gain and strength, and the instance's share. */
export function weightOf(column: Column, vertex: number): number {
  const { layer, fixed, share } = column;
  let weight = layer.values[vertex] * UNIT * layer.scale;
  if (layer.kind === "distance") {
    weight = falloff(Math.max(1 - weight / column.reach, 0), column.falloff);
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
    sameNumbers(one.defaultTransform, other.defaultTransform) &&
    sameParts(one.mirror, other.mirror)
  );
}

function sameParts<Part extends object>(one: Part | null, other: Part | null): boolean {
  if (one === null || other === null) return one === other;
  return (Object.keys(one) as (keyof Part)[]).every((key) => {
    const [a, b] = [one[key], other[key]];
    return Array.isArray(a) && Array.isArray(b) ? sameNumbers(a as number[], b as number[]) : Object.is(a, b);
  });
}

function sameNumbers(one: readonly number[] | null, other: readonly number[] | null): boolean {
  if (one === null || other === null) return one === other;
  return one.length === other.length && one.every((entry, i) => entry === other[i]);
}
