/** How much of the surface follows a handle, by the weights that move it. */

import { weightOf, type Column } from "./columns";

/** Sample vertices of the surface, and the area of each. */
export interface Surface {
  readonly vertices: Uint32Array;
  readonly areas: Float64Array;
}

/** Weight below which a motion is not visible. */
export const LEAST_SEEN = 0.05;
/** Number of samples: enough for whole percents, and fast enough while a slider moves. */
const MOST_SAMPLES = 5_000;

/** Return samples of `count` vertices; (R, 3) `positions`, (F, 3) `triangles` of rows, `vertexOf` (R) each row. */
export function surfaceOf(
  count: number,
  positions: Float32Array,
  triangles: Uint32Array,
  vertexOf: Uint32Array,
  most: number = MOST_SAMPLES,
): Surface {
  const around = new Float64Array(count);
  // No array is allocated per triangle, because there may be millions while the page waits.
  const side = (from: number, to: number, axis: number) => positions[3 * to + axis] - positions[3 * from + axis];
  for (let corner = 0; corner < triangles.length; corner += 3) {
    const a = triangles[corner];
    const b = triangles[corner + 1];
    const c = triangles[corner + 2];
    const ux = side(a, b, 0);
    const uy = side(a, b, 1);
    const uz = side(a, b, 2);
    const vx = side(a, c, 0);
    const vy = side(a, c, 1);
    const vz = side(a, c, 2);
    const area = Math.hypot(uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx);
    around[vertexOf[a]] += area;
    around[vertexOf[b]] += area;
    around[vertexOf[c]] += area;
  }
  const used = Uint32Array.from(around.keys()).filter((vertex) => around[vertex] > 0);
  const step = Math.max(Math.ceil(used.length / most), 1);
  const vertices = used.filter((_, i) => i % step === 0);
  return { vertices, areas: Float64Array.from(vertices, (vertex) => around[vertex]) };
}

/** Return the weight of a vertex in all columns of a handle. */
export function followed(columns: readonly Column[], vertex: number): number {
  return Math.min(
    columns.reduce((sum, column) => sum + weightOf(column, vertex), 0),
    1,
  );
}

/** Return the share of the surface that visibly follows the `columns` of a handle. */
export function heldPart(columns: readonly Column[], { vertices, areas }: Surface): number {
  let [held, whole] = [0, 0];
  vertices.forEach((vertex, i) => {
    whole += areas[i];
    if (followed(columns, vertex) >= LEAST_SEEN) held += areas[i];
  });
  return whole > 0 ? held / whole : 0;
}
