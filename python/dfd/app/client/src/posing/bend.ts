/** Bend the axis of a part by the equations of `dfd.posing.bend`, and find the bend that moves its tip to a place. */

import { MathUtils, Matrix4, Vector3 } from "three";

import type { BendAxis } from "../protocol/messages";
import { quaternionOf, type Frame, type Vec3 } from "./affine";

/** Number of steps along the axis. The tip is then within 0.1 % of the axis' length of where 512 steps put it. */
const STEPS = 64;
/** `EASE` and `LEAST_JOINT` of `dfd.posing.bend`. */
const EASE = 0.25;
const LEAST_JOINT = 0.06;
const MOST_DEGREES = 300;

/** Return the position of the tip after a bend, a rotation vector in degrees. */
export function bentTip(axis: BendAxis, bend: Vec3, joint: number | null): Vec3 {
  const turn = carried(axis.carry, bend);
  const nodes = axis.nodes.map((node) => new Vector3(...node));
  const last = nodes.length - 1;
  if (!axis.slender) return nodes[last].sub(nodes[0]).applyQuaternion(quaternionOf(turn)).add(nodes[0]).toArray();
  const at = (part: number): Vector3 => {
    const below = Math.min(Math.floor(part * last), last - 1);
    return nodes[below].clone().lerp(nodes[below + 1], part * last - below);
  };
  const points = Array.from({ length: STEPS + 1 }, (_, i) => at(i / STEPS));
  const length = points.slice(1).reduce((sum, point, i) => sum + point.distanceTo(points[i]), 0);
  const share = shares(axis, turn, joint, length);
  const tip = points[0].clone();
  for (let i = 0; i < STEPS; i++) {
    const middle = (share[i] + share[i + 1]) / 2;
    const own = turn.map((part) => part * middle) as unknown as Vec3;
    tip.add(points[i + 1].clone().sub(points[i]).applyQuaternion(quaternionOf(own)));
  }
  return tip.toArray();
}

/** Return the share of the bend at each step from the base to the tip. */
function shares({ radius }: BendAxis, turn: Vec3, joint: number | null, length: number): number[] {
  const fine = Array.from({ length: STEPS + 1 }, (_, i) => i / STEPS);
  let ramp;
  if (joint === null) ramp = fine.map((s) => (s < EASE ? s ** 2 / (2 * EASE) : s - EASE / 2));
  else {
    const at = joint * (radius.length - 1);
    const below = Math.min(Math.floor(at), radius.length - 2);
    const thick = MathUtils.lerp(radius[below], radius[below + 1], at - below) / Math.max(length, 1e-300);
    const angle = MathUtils.degToRad(Math.hypot(...turn));
    const half = Math.max(LEAST_JOINT, thick * Math.max(0.75, 0.9 * angle));
    ramp = fine.map((s) => MathUtils.smoothstep(s, joint - half, joint + half));
  }
  const [first, end] = [ramp[0], ramp[STEPS]];
  return ramp.map((part) => (part - first) / Math.max(end - first, 1e-12));
}

function carried(carry: Frame, bend: Vec3): Vec3 {
  return carry.map((row) => row[0] * bend[0] + row[1] * bend[1] + row[2] * bend[2]) as unknown as Vec3;
}

/**
 * Return the bend for which `misses` of the tip, the coordinates of its distance from a place, is least. The search
 * begins at the bend `from`, so that a steady pointer gives a steady bend. The tip does not twist about the axis.
 */
export function bendTowards(
  axis: BendAxis,
  from: Vec3,
  joint: number | null,
  misses: (tip: Vec3) => readonly number[],
): Vec3 {
  const nodes = axis.nodes as unknown as readonly Vec3[];
  const along = new Vector3(...nodes[nodes.length - 1]).sub(new Vector3(...nodes[0]));
  const size = Math.max(along.length(), 1e-300);
  const basis = new Matrix4().lookAt(new Vector3(), along, new Vector3(0.36, 0.48, 0.8));
  const [one, other] = [new Vector3(), new Vector3()];
  basis.extractBasis(one, other, new Vector3());
  const bendAt = (x: number, y: number): Vec3 => {
    const bend = new Vector3(...from).addScaledVector(one, x).addScaledVector(other, y);
    return bend.clampLength(0, MOST_DEGREES).toArray();
  };
  const missesAt = (x: number, y: number) => misses(bentTip(axis, bendAt(x, y), joint)).map((part) => part / size);
  const sum = (values: readonly number[]) => values.reduce((total, value) => total + value * value, 0);
  // Levenberg–Marquardt in the two angles, in degrees.
  let [x, y, damping] = [0, 0, 1e-6];
  let now = missesAt(x, y);
  for (let round = 0; round < 20; round++) {
    const [dx, dy] = [missesAt(x + 0.1, y), missesAt(x, y + 0.1)].map((all) =>
      all.map((part, i) => (part - now[i]) / 0.1),
    );
    const dot = (a: readonly number[], b: readonly number[]) => a.reduce((total, part, i) => total + part * b[i], 0);
    const [xx, xy, yy] = [dot(dx, dx) + damping, dot(dx, dy), dot(dy, dy) + damping];
    const determinant = xx * yy - xy * xy;
    const [gx, gy] = [dot(dx, now), dot(dy, now)];
    const [nx, ny] = [x - (yy * gx - xy * gy) / determinant, y - (xx * gy - xy * gx) / determinant];
    const next = missesAt(nx, ny);
    if (sum(next) < sum(now)) {
      const done = Math.hypot(nx - x, ny - y) < 0.01;
      [x, y, now, damping] = [nx, ny, next, damping / 4];
      if (done) break;
    } else damping *= 8;
  }
  return bendAt(x, y);
}
