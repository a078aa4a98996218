/** Pose the shape on the GPU once per change, into two textures. Drawing and picking read them. */

import * as THREE from "three";
import { FullScreenQuad } from "three/addons/postprocessing/Pass.js";

import { IDENTITY } from "../../posing/affine";
import type { Posed } from "../../store/state";
import { definesOf, WIDTH, type PoseTextures } from "./pose_textures";
import { define, material, pixels } from "./shaders";

export class PosePass {
  /** The uniforms of shaders that draw the pose: the positions and the heat of all rows, and their unit normals. */
  readonly uniforms: Readonly<Record<"posedPositions" | "posedNormals", THREE.IUniform<THREE.Texture>>>;
  private readonly target: THREE.WebGLRenderTarget;
  private readonly material = material("pose", {}, { depthTest: false, blending: THREE.NoBlending });
  private readonly quad = new FullScreenQuad(this.material);
  /** The textures of the resting shape and of the server's pose. */
  private own: readonly THREE.Texture[];
  private given: readonly THREE.Texture[] = [];
  /** Whether the textures contain the present pose. */
  private fresh = false;

  /** Takes the arrays of a `MeshMessage`: resting positions (R, 3), normals (R, 4) and the vertex of each row (R). */
  constructor(
    private readonly renderer: THREE.WebGLRenderer,
    positions: Float32Array,
    normals: Int16Array,
    private readonly vertexOf: Uint32Array,
    private readonly pose: PoseTextures,
  ) {
    const [rest, restNormals] = (this.own = [table(positions, 3), table(normals, 4)]);
    const data = rest.image.data as Float32Array;
    vertexOf.forEach((vertex, row) => (data[4 * row + 3] = vertex));
    this.set({ rest, restNormals, givenPositions: null, givenNormals: null });
    this.target = pixels(WIDTH, rest.image.height, 2);
    const [posedPositions, posedNormals] = this.target.textures.map((value) => ({ value }));
    this.uniforms = { posedPositions, posedNormals };
  }

  /** Mark the pose as outdated. */
  invalidate(): void {
    this.fresh = false;
  }

  /** Use the server's positions (V, 3) and normals (V, 4). If `given` is null, the shader computes them. */
  setGiven(given: Posed | null): void {
    this.given.forEach((texture) => texture.dispose());
    this.given = given ? [table(given.positions, 3), table(given.normals, 4)] : [];
    this.set({ givenPositions: this.given[0], givenNormals: this.given[1] });
    this.fresh = false;
  }

  /** Pose all rows, unless the textures contain the present pose. */
  update(): void {
    if (this.fresh) return;
    this.fresh = true;
    const { weights, columns, scene } = this.pose;
    const { normal, offset, band } = scene.mirror ?? { normal: [0, 0, 0] as const, offset: 0, band: 0 };
    const mirror = new THREE.Vector4(...normal, offset);
    const defaultTransform = scene.defaultTransform ?? IDENTITY;
    this.set({ weights, columns, columnCount: scene.columns.length, mirror, mirrorBand: band, defaultTransform });
    define(this.material, { ...definesOf(scene), GIVEN: this.given.length > 0 });
    this.renderer.setRenderTarget(this.target);
    this.quad.render(this.renderer);
    this.renderer.setRenderTarget(null);
  }

  /** Read the posed positions and the heat (R, 4) from the GPU. */
  read(): Float32Array {
    this.update();
    const { width, height } = this.target;
    const bits = new Uint32Array(4 * width * height);
    this.renderer.readRenderTargetPixels(this.target, 0, 0, width, height, bits);
    return new Float32Array(bits.buffer, 0, 4 * this.vertexOf.length);
  }

  dispose(): void {
    [...this.own, ...this.given, this.target, this.material].forEach((each) => each.dispose());
  }

  private set(values: Readonly<Record<string, unknown>>): void {
    for (const [name, value] of Object.entries(values)) this.material.uniforms[name] = { value };
  }
}

/** Return a texture with a texel for each `size` numbers. */
function table(values: Float32Array | Int16Array, size: number): THREE.DataTexture {
  const count = values.length / size;
  const height = Math.max(Math.ceil(count / WIDTH), 1);
  const whole = values instanceof Int16Array;
  const data = new (whole ? Int16Array : Float32Array)(4 * WIDTH * height);
  for (let i = 0; i < count; i++) for (let k = 0; k < size; k++) data[4 * i + k] = values[size * i + k];
  const made = new THREE.DataTexture(data, WIDTH, height, whole ? THREE.RGBAIntegerFormat : THREE.RGBAFormat);
  made.type = whole ? THREE.ShortType : THREE.FloatType;
  made.needsUpdate = true;
  return made;
}
