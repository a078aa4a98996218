/** How much of the surface follows a handle, by the weights that move it. */

import { weightOf, type Column } from "./columns";

/** Vertices that stand for the surface, and the area around each. */
export interface Surface {
  readonly vertices: Uint32Array;
  readonly areas: Float64Array;
}

/** What follows less is not seen to move. */
export const LEAST_SEEN = 0.05;
/** Enough for a whole number of percent, and few enough to measure while a slider moves. */
const MOST_SAMPLES = 5_000;

/** Samples of `count` vertices: rows at (R, 3) `positions`, `triangles` (F, 3) of rows, and the `vertexOf` (R) each. */
export function surfaceOf(
  count: number,
  positions: Float32Array,
  triangles: Uint32Array,
  vertexOf: Uint32Array,
  most: number = MOST_SAMPLES,
): Surface {
  const around = new Float64Array(count);
  // Millions of triangles while the page waits: no array is made for any of them.
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

/** How much a vertex follows a handle, through all of its columns. */
export function followed(columns: readonly Column[], vertex: number): number {
  return Math.min(
    columns.reduce((sum, column) => sum + weightOf(column, vertex), 0),
    1,
  );
}

/** Part of the surface that is seen to follow the `columns` of a handle. */
export function heldPart(columns: readonly Column[], { vertices, areas }: Surface): number {
  let [held, whole] = [0, 0];
  vertices.forEach((vertex, i) => {
    whole += areas[i];
    if (followed(columns, vertex) >= LEAST_SEEN) held += areas[i];
  });
  return whole > 0 ? held / whole : 0;
}
