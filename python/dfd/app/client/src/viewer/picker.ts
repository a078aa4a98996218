/** What lies under a pixel, found on the GPU by the shader that poses the shape, so that what is picked is what is seen. */

import {
  DoubleSide,
  Mesh,
  NearestFilter,
  RGBAIntegerFormat,
  Scene as ThreeScene,
  UnsignedIntType,
  WebGLRenderTarget,
  type PerspectiveCamera,
  type WebGLRenderer,
} from "three";

import type { Vec3 } from "../posing/affine";
import { material } from "./posing/shaders";
import type { Shape } from "./shape";

export interface Pick {
  readonly vertex: number;
  /** A row of the mesh that stands for the vertex. */
  readonly row: number;
  /** The point of the surface, at rest, relative to the mesh's center. */
  readonly point: Vec3;
}

export class Picker {
  private readonly target = onePixel();
  private readonly scene = new ThreeScene();
  private readonly mesh: Mesh;
  private newest: { readonly key: string; readonly pick: Pick | null } | null = null;

  constructor(
    private readonly renderer: WebGLRenderer,
    private readonly shape: Shape,
  ) {
    this.mesh = new Mesh(shape.drawn.geometry, material("pick", {}, { side: DoubleSide }));
    this.mesh.frustumCulled = false;
    this.scene.add(this.mesh);
    this.scene.matrixWorldAutoUpdate = false;
  }

  /** At (x, y) in pixels of the page within a view of `width` × `height`; null beside the shape. */
  pick(camera: PerspectiveCamera, x: number, y: number, width: number, height: number): Pick | null {
    const about = [Math.floor(x), Math.floor(y), width, height, this.shape.poses].join();
    camera.updateMatrixWorld();
    const key = [about, camera.matrixWorld.elements, camera.projectionMatrix.elements].join();
    // A click where the pointer rested finds what was found there: of a large shape that takes a processor a second.
    if (this.newest?.key !== key) this.newest = { key, pick: this.find(camera, x, y, width, height) };
    return this.newest.pick;
  }

  private find(camera: PerspectiveCamera, x: number, y: number, width: number, height: number): Pick | null {
    // One pixel of the view fills the target, so the GPU throws away all else before a fragment is made.
    this.shape.update();
    this.mesh.geometry = this.shape.drawn.geometry;
    camera.setViewOffset(width, height, Math.floor(x), Math.floor(y), 1, 1);
    const bits = this.draw(this.target, camera, this.scene);
    camera.clearViewOffset();
    if (bits[3] === 0) return null;
    const [px, py, pz] = new Float32Array(bits.buffer, 0, 3);
    const point: Vec3 = [px, py, pz];
    const row = this.shape.drawn.faces.nearestRow(point, bits[3] - 1);
    return row === null ? null : { row, point, vertex: this.shape.vertexOf[row] };
  }

  dispose(): void {
    this.target.dispose();
    [this.mesh.material].flat().forEach((each) => each.dispose());
  }

  private draw(target: WebGLRenderTarget, camera: PerspectiveCamera, scene: ThreeScene): Uint32Array {
    const { renderer } = this;
    const before = renderer.getRenderTarget();
    // An opaque canvas is cleared to an alpha of 1, which would be the first face: beside the shape there is none.
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

/** Integers, which every WebGL 2 can draw into. */
function onePixel(): WebGLRenderTarget {
  return new WebGLRenderTarget(1, 1, {
    format: RGBAIntegerFormat,
    type: UnsignedIntType,
    internalFormat: "RGBA32UI",
    minFilter: NearestFilter,
    magFilter: NearestFilter,
    generateMipmaps: false,
  });
}
