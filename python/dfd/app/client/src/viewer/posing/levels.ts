/** The rows of a shape on the GPU, and the triangles over them: of the whole, and of a coarse level over its first rows. */

import { BufferAttribute, BufferGeometry, Sphere, Vector3, type WebGLRenderer } from "three";

import type { Payload } from "../../protocol/binary_messages";
import type { Group } from "../../protocol/messages";
import type { Level, Posed } from "../../store/state";
import { Faces } from "./faces";
import { PosePass } from "./pose_pass";
import type { PoseTextures } from "./pose_textures";

/** (F, 3) rows of corners, and runs of them that share a material. */
export interface Triangles {
  readonly corners: Uint32Array;
  readonly groups: readonly Group[];
}

export interface Drawn {
  readonly geometry: BufferGeometry;
  readonly faces: Faces;
  /** How many rows it is drawn from, the first ones. */
  readonly rows: number;
}

export class Levels {
  /** (R, 3) at rest, relative to the mesh's center. */
  readonly positions: Float32Array;
  /** (R) the vertex of each row. */
  readonly vertexOf: Uint32Array;
  readonly posed: PosePass;
  private readonly drawn = new Map<Level, Drawn>();

  constructor(
    renderer: WebGLRenderer,
    pose: PoseTextures,
    payload: Payload,
    triangles: Partial<Record<Level, Triangles>>,
    radius: number,
  ) {
    this.positions = payload.get("positions", "float32");
    this.vertexOf = payload.get("vertex", "uint32");
    const rows = { positions: this.positions, normals: payload.get("normals", "int16"), vertexOf: this.vertexOf };
    this.posed = new PosePass(renderer, rows, pose);
    const { position, normal, rest } = this.posed;
    const uv = payload.has("uv") && new BufferAttribute(payload.get("uv", "float32"), 2);
    const colors = payload.has("colors") && new BufferAttribute(payload.get("colors", "uint8"), 4, true);
    for (const [level, { corners, groups }] of Object.entries(triangles) as [Level, Triangles][]) {
      const geometry = new BufferGeometry();
      // By the first, three.js counts rows.
      Object.assign(geometry.attributes, { position, posedPosition: position, posedNormal: normal, rest });
      geometry.setIndex(new BufferAttribute(corners, 1));
      if (uv) geometry.setAttribute("uv", uv);
      if (colors) geometry.setAttribute("rowColor", colors);
      // Posed shapes leave their box: nothing is culled.
      geometry.boundingSphere = new Sphere(new Vector3(), radius);
      for (const { start, count, material } of groups) geometry.addGroup(3 * start, 3 * count, material);
      const count = level === "full" ? this.vertexOf.length : corners.reduce((most, row) => Math.max(most, row + 1), 0);
      this.drawn.set(level, { geometry, faces: new Faces(this.positions, corners), rows: count });
    }
  }

  has(level: Level): boolean {
    return this.drawn.has(level);
  }

  /** A level; in place of one that there is not, the other. */
  of(level: Level): Drawn {
    const found = this.drawn.get(level) ?? [...this.drawn.values()].at(0);
    if (!found) throw new Error("The shape has no triangles.");
    return found;
  }

  /** (V, 4) colors of the features' main directions. */
  setFeatureColors(colors: Uint8Array): void {
    const rows = new BufferAttribute(this.perRow(colors, 4), 4, true);
    for (const { geometry } of this.drawn.values()) geometry.setAttribute("featureColor", rows);
  }

  setPosed(posed: Posed | null): void {
    this.posed.setGiven(
      posed && { positions: this.perRow(posed.positions, 3), normals: this.perRow(posed.normals, 4) },
    );
  }

  dispose(): void {
    for (const { geometry } of this.drawn.values()) geometry.dispose();
    this.posed.dispose();
  }

  /** From `width` numbers per vertex to as many per row. */
  private perRow<Numbers extends Float32Array | Int16Array | Uint8Array>(values: Numbers, width: number): Numbers {
    const { vertexOf } = this;
    const rows = new (values.constructor as new (length: number) => Numbers)(width * vertexOf.length);
    for (let row = 0; row < vertexOf.length; row++) {
      for (let i = 0; i < width; i++) rows[width * row + i] = values[width * vertexOf[row] + i];
    }
    return rows;
  }
}
