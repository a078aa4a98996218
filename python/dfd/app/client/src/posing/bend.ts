/** Convert a bend to the position of a part's tip, and back. */

import { Vector3 } from "three";

import { quaternionOf, type Vec3 } from "./affine";

/** The ends of the part's axis at rest, from its base to its tip. */
export interface PartEnds {
  readonly base: Vec3;
  readonly tip: Vec3;
}

/** If a part bends along its whole axis, the line from base to tip rotates by this fraction of the tip's angle. */
const LINE_SHARE = 0.44;
const MOST_DEGREES = 300;

/** Return the approximate position of the tip after a bend by a rotation vector in degrees. */
export function bentTip({ base, tip }: PartEnds, bend: Vec3, joint: number | null): Vec3 {
  const line = bend.map((part) => part * lineShare(joint)) as unknown as Vec3;
  const out = new Vector3(...tip).sub(new Vector3(...base)).applyQuaternion(quaternionOf(line));
  return out.add(new Vector3(...base)).toArray();
}

/** Return the rotation vector, in degrees, of the bend that turns the line from base to tip towards a point. */
export function bendTowards({ base, tip }: PartEnds, point: Vec3, joint: number | null): Vec3 {
  const [from, to] = [tip, point].map((end) => new Vector3(...end).sub(new Vector3(...base)));
  const about = new Vector3().crossVectors(from, to);
  const size = about.length();
  if (size < 1e-9 * from.lengthSq()) return [0, 0, 0];
  const degrees = (Math.atan2(size, from.dot(to)) * 180) / Math.PI / lineShare(joint);
  return about.multiplyScalar(Math.min(degrees, MOST_DEGREES) / size).toArray();
}

/** Return `LINE_SHARE`. If a joint near the base rotates most of the part by the full angle, return a larger share. */
function lineShare(joint: number | null): number {
  return joint === null ? LINE_SHARE : Math.max(1 - joint, LINE_SHARE);
}
