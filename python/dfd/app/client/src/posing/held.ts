/** Measure how much of the surface follows a handle. */

import { Triangle } from "three";

import { weightOf, type Column } from "./columns";

/** Sampled vertices of the surface, and the total area of the triangles around each of these vertices. */
export interface Surface {
  readonly vertices: Uint32Array;
  readonly areas: Float64Array;
}

/** Motions with a weight below this number count as not visible. */
export const LEAST_SEEN = 0.05;
/** Largest number of sampled vertices. It is enough for shares in whole per cent. */
const MOST_SAMPLES = 5_000;

/** Sample at most `most` of `count` vertices. The mesh has `positions` (R, 3), `triangles` (F, 3), `vertexOf` (R). */
export function surfaceOf(
  count: number,
  positions: Float32Array,
  triangles: Uint32Array,
  vertexOf: Uint32Array,
  most: number = MOST_SAMPLES,
): Surface {
  const around = new Float64Array(count);
  // There may be millions of triangles, so the loop creates no objects.
  const triangle = new Triangle();
  for (let corner = 0; corner < triangles.length; corner += 3) {
    triangle.a.fromArray(positions, 3 * triangles[corner]);
    triangle.b.fromArray(positions, 3 * triangles[corner + 1]);
    triangle.c.fromArray(positions, 3 * triangles[corner + 2]);
    const area = triangle.getArea();
    for (let k = 0; k < 3; k++) around[vertexOf[triangles[corner + k]]] += area;
  }
  const used = Uint32Array.from(around.keys()).filter((vertex) => around[vertex] > 0);
  const step = Math.max(Math.ceil(used.length / most), 1);
  const vertices = used.filter((_, i) => i % step === 0);
  return { vertices, areas: Float64Array.from(vertices, (vertex) => around[vertex]) };
}

/** Return the sum of a vertex's weights over the columns of a handle, at most 1. */
export function followed(columns: readonly Column[], vertex: number): number {
  const total = columns.reduce((sum, column) => sum + weightOf(column, vertex), 0);
  return Math.min(total, 1);
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
