/** What handles with the reach "part" hold: most vertices share few columns, which docs/tools/shapes.py has prepared. */

const STEPS = 255;
/** Of a column's weight at the vertex that is held: where it is less, it is not made whole. */
const LEAST_OWN = 0.01;

export class Grips {
  /** `file` is the number of each vertex's grip, and for each grip a weight per vertex. */
  constructor(
    private readonly vertices: number,
    private readonly file: Uint8Array,
  ) {}

  /** (V) how much vertices follow a handle at one of them; who takes hold of a seam holds it whole. */
  weights(vertex: number): Float32Array {
    const start = (1 + this.file[vertex]) * this.vertices;
    const row = this.file.subarray(start, start + this.vertices);
    const own = Math.max(row[vertex], LEAST_OWN * STEPS);
    return Float32Array.from(row, (weight) => Math.min(weight / own, 1));
  }
}
