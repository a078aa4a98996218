/** From what a pick says, a point at rest and the last corner of its triangle, to the nearest corner of that triangle. */

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
    for (let i = starts[lastCorner]; i < starts[lastCorner + 1]; i++) {
      const face = order[i];
      const corners = [0, 1, 2].map((k) => this.triangles[3 * face + k]) as [number, number, number];
      const barycentric = this.barycentric(point, corners);
      // Inside all are within [0, 1]; the face that the point is least outside of is the one.
      const outside = Math.max(...barycentric.map((share) => -share), 0) + this.distance(point, corners, barycentric);
      if (outside >= least) continue;
      least = outside;
      best = corners[barycentric.indexOf(Math.max(...barycentric))];
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

  private at(row: number): Vec3 {
    return [this.positions[3 * row], this.positions[3 * row + 1], this.positions[3 * row + 2]];
  }

  private barycentric(p: Vec3, corners: readonly [number, number, number]): Vec3 {
    const [a, b, c] = corners.map((row) => this.at(row));
    const minus = (u: Vec3, v: Vec3) => [u[0] - v[0], u[1] - v[1], u[2] - v[2]];
    const dot = (u: number[], v: number[]) => u[0] * v[0] + u[1] * v[1] + u[2] * v[2];
    const [u, v, w] = [minus(b, a), minus(c, a), minus(p, a)];
    const [uu, uv, vv, wu, wv] = [dot(u, u), dot(u, v), dot(v, v), dot(w, u), dot(w, v)];
    const area = uu * vv - uv * uv;
    if (area <= 0) return [1, 0, 0];
    const s = (vv * wu - uv * wv) / area;
    const t = (uu * wv - uv * wu) / area;
    return [1 - s - t, s, t];
  }

  private distance(p: Vec3, corners: readonly [number, number, number], barycentric: Vec3): number {
    const size = Math.max(...corners.map((row) => Math.max(...this.at(row).map(Math.abs))), 1e-30);
    const off = [0, 1, 2].map((i) => {
      const on = corners.reduce((sum, row, k) => sum + barycentric[k] * this.positions[3 * row + i], 0);
      return p[i] - on;
    });
    return Math.hypot(...off) / size;
  }
}
