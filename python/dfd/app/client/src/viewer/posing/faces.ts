/** Find the corner nearest to a picked point, among the corners of the triangle that contains the point. */

import { Triangle, Vector3 } from "three";

import type { Vec3 } from "../../posing/affine";

export class Faces {
  /** The triangles, sorted by their last corner. Triangles with row c as last corner begin at `starts[c]`. */
  private readonly order: Uint32Array;
  private readonly starts: Uint32Array;

  constructor(
    private readonly positions: Float32Array,
    private readonly triangles: Uint32Array,
  ) {
    const count = triangles.length / 3;
    this.starts = new Uint32Array(positions.length / 3 + 1);
    for (let face = 0; face < count; face++) this.starts[triangles[3 * face + 2] + 1]++;
    for (let row = 1; row < this.starts.length; row++) this.starts[row] += this.starts[row - 1];
    const next = this.starts.slice();
    this.order = new Uint32Array(count);
    for (let face = 0; face < count; face++) this.order[next[triangles[3 * face + 2]]++] = face;
  }

  /** Return the row of the corner nearest to `point`. `lastCorner` is the row of the triangle's last corner. */
  nearestRow(point: Vec3, lastCorner: number): number | null {
    let best: number | null = null;
    let least = Infinity;
    const at = new Vector3(...point);
    const [triangle, nearest] = [new Triangle(), new Vector3()];
    for (const face of this.order.subarray(this.starts[lastCorner], this.starts[lastCorner + 1])) {
      const corners = this.triangles.subarray(3 * face, 3 * face + 3);
      const points = [triangle.a, triangle.b, triangle.c];
      corners.forEach((row, k) => points[k].fromArray(this.positions, 3 * row));
      const apart = triangle.closestPointToPoint(at, nearest).distanceTo(at);
      if (apart >= least) continue;
      least = apart;
      const distances = points.map((corner) => corner.distanceTo(at));
      best = corners[distances.indexOf(Math.min(...distances))];
    }
    return best;
  }
}
