/** The twin of `src/shaders/pose.glsl` in float64: for measures of single points, and for tests to compare with. */

import { apply, multiply, reflection, type Affine, type Vec3 } from "./affine";
import { weightOf, type Mirror, type Scene } from "./columns";

/** How much of a point belongs to the side that the mirror's normal points to: a step, or smooth over the band. */
export function positiveShare(mirror: Mirror, point: Vec3): number {
  const [x, y, z] = mirror.normal;
  const height = x * point[0] + y * point[1] + z * point[2] - mirror.offset;
  if (mirror.band === 0) return height >= 0 ? 1 : 0;
  const t = Math.min(Math.max((0.5 * height) / mirror.band + 0.5, 0), 1);
  return t * t * (3 - 2 * t);
}

/** The transform as it acts on the other side of the mirror, R D R (Eq. 8). */
export function mirrored(transform: Affine, mirror: Mirror): Affine {
  const across = reflection(mirror.normal, mirror.offset);
  return multiply(across, multiply(transform, across));
}

/** Where one vertex goes, and how warm it is in the heat map. */
export function posePoint(scene: Scene, point: Vec3, vertex: number): { position: Vec3; heat: number } {
  const { mirror } = scene;
  const positive = mirror ? positiveShare(mirror, point) : 1;
  const moved = [0, 0, 0];
  const addMove = (transform: Affine, weight: number) => {
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
