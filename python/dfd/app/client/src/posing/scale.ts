/** Scale by the distance that the pointer moved. */

import type { Vec3 } from "./affine";

/** Smallest factor of a drag: a part never flips. */
const LEAST = 0.01;
export const SCALE_STEP = 0.1;

/**
 * Return `start` with the factors of `axes` (0 to 2) multiplied by 1 + `pixels` / `arm`: a motion by the length of the
 * gizmo's arm doubles a part. If `snap`, the factor is a multiple of 0.1.
 */
export function pulledScale(start: Vec3, axes: readonly number[], pixels: number, arm: number, snap: boolean): Vec3 {
  const free = Math.max(1 + pixels / arm, LEAST);
  const factor = snap ? Math.max(stepped(free, SCALE_STEP), SCALE_STEP) : free;
  return start.map((part, i) => (axes.includes(i) ? part * factor : part)) as unknown as Vec3;
}

/** Round a value to whole steps. */
export function stepped(value: number, step: number): number {
  return Number((Math.round(value / step) * step).toPrecision(12));
}
