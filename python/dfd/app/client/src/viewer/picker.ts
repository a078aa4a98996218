/** Find the point of the resting shape at a pixel. The GPU draws the posed shape, with resting positions as colors. */

import * as THREE from "three";

import type { Vec3 } from "../posing/affine";
import type { Picked } from "../store/state";
import { define, material, pixels } from "./posing/shaders";
import type { Shape } from "./shape";

export class Picker {
  private readonly target = pixels(1, 1);
  private readonly scene = new THREE.Scene();
  private readonly material: THREE.ShaderMaterial;

  constructor(
    private readonly renderer: THREE.WebGLRenderer,
    private readonly shape: Shape,
  ) {
    this.material = material("pick", shape.posed.uniforms, { side: THREE.DoubleSide });
    const mesh = new THREE.Mesh(shape.geometry, this.material);
    mesh.frustumCulled = false;
    this.scene.add(mesh);
    this.scene.matrixWorldAutoUpdate = false;
  }

  /** Return the point at pixel (x, y) of a view of `width` × `height` pixels; null if the shape is not there. */
  pick(camera: THREE.PerspectiveCamera, x: number, y: number, width: number, height: number): Picked | null {
    camera.updateMatrixWorld();
    // The target has one pixel, so the GPU discards all other fragments.
    camera.setViewOffset(width, height, Math.floor(x), Math.floor(y), 1, 1);
    const bits = this.draw(this.target, camera);
    camera.clearViewOffset();
    if (bits[3] === 0) return null;
    const [px, py, pz] = new Float32Array(bits.buffer, 0, 3);
    const point: Vec3 = [px, py, pz];
    const row = this.shape.faces.nearestRow(point, bits[3] - 1);
    return row === null ? null : { row, point, vertex: this.shape.vertexOf[row] };
  }

  /** Return the rows whose posed positions are in a box of a view; without `through`, return only visible rows. */
  within(camera: THREE.PerspectiveCamera, box: DOMRect, width: number, height: number, through: boolean): Set<number> {
    const { shape } = this;
    const [w, h] = [Math.max(Math.ceil(box.width), 1), Math.max(Math.ceil(box.height), 1)];
    const target = pixels(w, h);
    camera.updateMatrixWorld();
    camera.setViewOffset(width, height, box.x, box.y, w, h);
    const seen = new Float32Array(this.draw(target, camera).buffer);
    const view = new THREE.Matrix4().multiplyMatrices(camera.projectionMatrix, camera.matrixWorldInverse);
    camera.clearViewOffset();
    target.dispose();
    const [posed, rest] = [shape.posed.read(), shape.positions];
    // A vertex is visible if the surface at its pixel is less than 4 pixels away. `near` spans 4 pixels at depth 1.
    const near = (8 * Math.tan((camera.fov * Math.PI) / 360)) / height;
    const found = new Set<number>();
    const at = new THREE.Vector4();
    for (let row = 0; row < shape.vertexOf.length; row++) {
      if (shape.isolated && posed[4 * row + 3] < 0.05) continue;
      at.set(posed[4 * row], posed[4 * row + 1], posed[4 * row + 2], 1).applyMatrix4(view);
      const [x, y] = [Math.floor(((at.x / at.w + 1) / 2) * w), Math.floor(((at.y / at.w + 1) / 2) * h)];
      if (at.w <= 0 || x < 0 || y < 0 || x >= w || y >= h) continue;
      const pixel = 4 * (y * w + x);
      const apart = Math.hypot(...[0, 1, 2].map((i) => seen[pixel + i] - rest[3 * row + i]));
      if (through || (seen[pixel + 3] !== 0 && apart < near * at.w)) found.add(row);
    }
    return found;
  }

  dispose(): void {
    this.target.dispose();
    this.material.dispose();
  }

  private draw(target: THREE.WebGLRenderTarget, camera: THREE.PerspectiveCamera): Uint32Array {
    const { renderer, scene, shape } = this;
    shape.posed.update();
    define(this.material, { ISOLATED: shape.isolated });
    const before = renderer.getRenderTarget();
    // Clear to alpha 0 (no face), because an opaque canvas would clear to alpha 1 (the first face).
    const alpha = renderer.getClearAlpha();
    renderer.setClearAlpha(0);
    renderer.setRenderTarget(target);
    renderer.clear();
    renderer.render(scene, camera);
    renderer.setClearAlpha(alpha);
    const bits = new Uint32Array(4 * target.width * target.height);
    renderer.readRenderTargetPixels(target, 0, 0, target.width, target.height, bits);
    renderer.setRenderTarget(before);
    return bits;
  }
}
