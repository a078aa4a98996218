/** From what a pick says, a point at rest and the last corner of its triangle, to the nearest corner of that triangle. */

import { Triangle, Vector3 } from "three";

import type { Vec3 } from "../../posing/affine";

export class Faces {
  /** Triangles in the order of their last corners, and where those of each corner begin; made at the first pick. */
  private order: Uint32Array | null = null;
  private starts: Uint32Array | null = null;

  constructor(
    private readonly positions: Float32Array,
    private readonly triangles: Uint32Array,
  ) {}

  get count(): number {
    return this.triangles.length / 3;
  }

  /** The corner that lies nearest to the point, of the triangle that holds it. */
  nearestRow(point: Vec3, lastCorner: number): number | null {
    const { order, starts } = this.sorted();
    let best: number | null = null;
    let least = Infinity;
    const at = new Vector3(...point);
    const [triangle, nearest] = [new Triangle(), new Vector3()];
    for (let i = starts[lastCorner]; i < starts[lastCorner + 1]; i++) {
      const corners = [0, 1, 2].map((k) => this.triangles[3 * order[i] + k]);
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

  private sorted(): { order: Uint32Array; starts: Uint32Array } {
    if (this.order && this.starts) return { order: this.order, starts: this.starts };
    const { count } = this;
    const starts = new Uint32Array(this.positions.length / 3 + 1);
    for (let face = 0; face < count; face++) starts[this.triangles[3 * face + 2] + 1]++;
    for (let row = 1; row < starts.length; row++) starts[row] += starts[row - 1];
    const next = starts.slice();
    const order = new Uint32Array(count);
    for (let face = 0; face < count; face++) order[next[this.triangles[3 * face + 2]]++] = face;
    this.order = order;
    this.starts = starts;
    return { order, starts };
  }
}
