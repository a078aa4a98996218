/** Where the tip of a part goes when it bends along its axis, and how far it has to bend for its tip to go somewhere. */

import { Vector3 } from "three";

import { quaternionOf, type Vec3 } from "./affine";

/** From where a part leaves the rest of the shape to its other end, at rest. */
export interface PartEnds {
  readonly base: Vec3;
  readonly tip: Vec3;
}

/** Of the turn of the tip, what the line from the base to it turns by, as `dfd.posing.bend` spreads a turn. */
const LINE_SHARE = 0.44;
const MOST_DEGREES = 300;

/** About where the tip is after a bend by a rotation vector in degrees. */
export function bentTip({ base, tip }: PartEnds, bend: Vec3, joint: number | null): Vec3 {
  const line = bend.map((part) => part * share(joint)) as unknown as Vec3;
  const out = new Vector3(...tip).sub(new Vector3(...base)).applyQuaternion(quaternionOf(line));
  return out.add(new Vector3(...base)).toArray();
}

/** The rotation vector in degrees that takes the line from the base to the tip towards a point. */
export function bendTowards({ base, tip }: PartEnds, point: Vec3, joint: number | null): Vec3 {
  const [from, to] = [tip, point].map((end) => new Vector3(...end).sub(new Vector3(...base)));
  const about = new Vector3().crossVectors(from, to);
  const size = about.length();
  if (size < 1e-9 * from.lengthSq()) return [0, 0, 0];
  const degrees = (Math.atan2(size, from.dot(to)) * 180) / Math.PI / share(joint);
  return about.multiplyScalar(Math.min(degrees, MOST_DEGREES) / size).toArray();
}

/** About a joint only what lies beyond it turns. */
function share(joint: number | null): number {
  return joint === null ? LINE_SHARE : Math.max(1 - joint, LINE_SHARE);
}
