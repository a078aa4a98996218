/** What lies under a pixel, found on the GPU by the shader that poses the shape, so that what is picked is what is seen. */

import {
  DoubleSide,
  Mesh,
  Scene as ThreeScene,
  type PerspectiveCamera,
  type WebGLRenderer,
  type WebGLRenderTarget,
} from "three";

import type { Vec3 } from "./affine";
import type { FacePoint } from "./faces";
import { integerTarget } from "./pose_pass";
import { poseMaterial } from "./shaders";
import type { Shape } from "./shape";

export interface Pick extends FacePoint {
  readonly vertex: number;
  /** The point of the surface, at rest, relative to the mesh's center. */
  readonly point: Vec3;
}

export class Picker {
  private readonly target = integerTarget(1, 1);
  private readonly scene = new ThreeScene();
  private readonly mesh: Mesh;

  constructor(
    private readonly renderer: WebGLRenderer,
    private readonly shape: Shape,
  ) {
    this.mesh = new Mesh(shape.geometry, poseMaterial("pick", shape.posed.uniforms, { side: DoubleSide }));
    this.mesh.frustumCulled = false;
    this.scene.add(this.mesh);
    this.scene.matrixWorldAutoUpdate = false;
  }

  /** At (x, y) in pixels of the page within a view of `width` × `height`; null beside the shape. */
  pick(camera: PerspectiveCamera, x: number, y: number, width: number, height: number): Pick | null {
    // One pixel of the view fills the target, so the GPU throws away all else before a fragment is made.
    this.shape.posed.update(this.renderer, camera);
    camera.setViewOffset(width, height, Math.floor(x), Math.floor(y), 1, 1);
    const bits = this.draw(this.target, camera, this.scene);
    camera.clearViewOffset();
    if (bits[3] === 0) return null;
    const [px, py, pz] = new Float32Array(bits.buffer, 0, 3);
    const point: Vec3 = [px, py, pz];
    const face = this.shape.faces.find(point, bits[3] - 1);
    return face && { ...face, point, vertex: this.shape.vertexOf[face.row] };
  }

  dispose(): void {
    this.target.dispose();
    [this.mesh.material].flat().forEach((material) => material.dispose());
  }

  private draw(target: WebGLRenderTarget, camera: PerspectiveCamera, scene: ThreeScene): Uint32Array {
    const { renderer } = this;
    const before = renderer.getRenderTarget();
    renderer.setRenderTarget(target);
    renderer.clear();
    renderer.render(scene, camera);
    const bits = new Uint32Array(4 * target.width * target.height);
    renderer.readRenderTargetPixels(target, 0, 0, target.width, target.height, bits);
    renderer.setRenderTarget(before);
    return bits;
  }
}
