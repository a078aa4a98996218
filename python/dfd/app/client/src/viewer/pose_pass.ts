/** The shape posed on the GPU, once for each change: what is drawn and picked afterwards only looks it up. */

import {
  NearestFilter,
  Points,
  RGBAIntegerFormat,
  Scene as ThreeScene,
  UnsignedIntType,
  WebGLRenderTarget,
  type BufferGeometry,
  type Camera,
  type IUniform,
  type ShaderMaterial,
  type Texture,
  type WebGLRenderer,
} from "three";

import { poseMaterial } from "./shaders";

const WIDTH = 2048;

export interface PosedUniforms extends Record<string, IUniform> {
  posedPositions: IUniform<Texture>;
  posedNormals: IUniform<Texture>;
}

export class PosePass {
  readonly uniforms: PosedUniforms;
  private readonly target: WebGLRenderTarget;
  private readonly scene = new ThreeScene();
  private readonly geometry: BufferGeometry;
  private readonly material: ShaderMaterial;
  private stale = true;

  constructor(
    private readonly shape: BufferGeometry,
    private readonly rows: number,
    pose: Record<string, IUniform>,
  ) {
    const height = Math.max(Math.ceil(rows / WIDTH), 1);
    this.target = integerTarget(WIDTH, height, 2);
    const [positions, normals] = this.target.textures;
    this.uniforms = { posedPositions: { value: positions }, posedNormals: { value: normals } };
    const uniforms = { ...pose, targetSize: { value: [WIDTH, height] } };
    this.material = poseMaterial("pose", uniforms, { depthTest: false, depthWrite: false });
    // Points take rows in their order, without the index; attributes are the shape's own, also those that come later.
    this.geometry = shape.clone().setIndex(null);
    this.geometry.clearGroups();
    this.geometry.setDrawRange(0, rows);
    this.geometry.attributes = shape.attributes;
    const points = new Points(this.geometry, this.material);
    points.frustumCulled = false;
    this.scene.add(points);
    this.scene.matrixWorldAutoUpdate = false;
  }

  /** Something that the pose is made of has changed. */
  invalidate(): void {
    this.stale = true;
  }

  /** Pose again, if anything has changed since. */
  update(renderer: WebGLRenderer, camera: Camera): void {
    if (!this.stale) return;
    this.stale = false;
    const before = renderer.getRenderTarget();
    renderer.setRenderTarget(this.target);
    renderer.render(this.scene, camera);
    renderer.setRenderTarget(before);
  }

  /** (R, 4) posed positions and heat, read back. */
  read(renderer: WebGLRenderer, camera: Camera): Float32Array {
    this.update(renderer, camera);
    const { width, height } = this.target;
    const bits = new Uint32Array(4 * width * height);
    renderer.readRenderTargetPixels(this.target, 0, 0, width, height, bits);
    return new Float32Array(bits.buffer, 0, 4 * this.rows).slice();
  }

  dispose(): void {
    this.target.dispose();
    this.material.dispose();
    if (this.geometry !== this.shape) this.geometry.dispose();
  }
}

export function integerTarget(width: number, height: number, count = 1): WebGLRenderTarget {
  return new WebGLRenderTarget(width, height, {
    count,
    format: RGBAIntegerFormat,
    type: UnsignedIntType,
    internalFormat: "RGBA32UI",
    minFilter: NearestFilter,
    magFilter: NearestFilter,
    generateMipmaps: false,
    depthBuffer: count === 1,
  });
}
