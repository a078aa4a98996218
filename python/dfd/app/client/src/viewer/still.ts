/**
 * The whole of a shape that takes long to draw, as a picture with depths. It is drawn bit by bit beside what is seen,
 * so that a processor that draws never keeps anybody waiting, and stands in for the shape until that looks another way.
 */

import {
  BufferAttribute,
  BufferGeometry,
  DepthTexture,
  Mesh,
  NearestFilter,
  UnsignedIntType,
  Vector2,
  WebGLRenderTarget,
  type PerspectiveCamera,
  type Scene as ThreeScene,
  type WebGLRenderer,
} from "three";

import type { Clock } from "./clock";
import { material } from "./posing/shaders";

/** What draws a shape and nothing else: a camera sees it by this layer. */
export const SHAPE_LAYER = 1;
/** Milliseconds that one bit may take, and how many there are at most: pauses between them are long on busy machines. */
const BUDGET = 50;
const MOST_BITS = 20;

/** A shape that can be posed and drawn in bits. */
export interface Drawable {
  readonly rows: number;
  readonly faces: number;
  /** Have so many rows posed, from the first on. */
  pose(rows: number): void;
  /** Call `draw` while the shape has only those of its faces. */
  among(first: number, count: number, draw: () => void): void;
}

export class Still {
  private readonly target: WebGLRenderTarget;
  private readonly quad: Mesh;

  constructor(
    private readonly renderer: WebGLRenderer,
    private readonly scene: ThreeScene,
    private readonly camera: PerspectiveCamera,
    private readonly clock: Clock,
  ) {
    const depths = new DepthTexture(1, 1, UnsignedIntType);
    const filters = { minFilter: NearestFilter, magFilter: NearestFilter, generateMipmaps: false };
    this.target = new WebGLRenderTarget(1, 1, { ...filters, depthTexture: depths });
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(new Float32Array(9), 3));
    const uniforms = { picture: { value: this.target.texture }, depths: { value: depths } };
    this.quad = new Mesh(geometry, material("still", uniforms));
    this.quad.frustumCulled = false;
    this.quad.visible = false;
    scene.add(this.quad);
  }

  /** Draw all of it now. */
  make(shape: Drawable): void {
    this.clear();
    shape.pose(shape.rows);
    this.add(shape, 0, shape.faces);
  }

  /** Draw it bit by bit, and tell at the end how many milliseconds that took, pauses left out. */
  compose(shape: Drawable, done: (milliseconds: number) => void): () => void {
    this.clear();
    const least = Math.ceil(shape.faces / MOST_BITS);
    let [rows, faces, bit, spent, stopped] = [0, 0, least, 0, false];
    const next = () => {
      if (stopped) return;
      if (rows >= shape.rows && faces >= shape.faces) {
        done(spent);
        return;
      }
      const begun = performance.now();
      if (rows < shape.rows) {
        // A row is posed in less time than its two faces are drawn in.
        rows = Math.min(rows + 2 * bit, shape.rows);
        shape.pose(rows);
      } else {
        const count = Math.min(bit, shape.faces - faces);
        this.add(shape, faces, count);
        faces += count;
      }
      // A question of an older picture may still be open: this one must be answered all the same.
      this.clock.follow(begun, (took) => {
        spent += took;
        bit = Math.max(Math.round(bit * Math.min(Math.max(BUDGET / took, 0.5), 2)), least);
        next();
      });
    };
    next();
    return () => (stopped = true);
  }

  /** Draw the scene with it in place of the shape. */
  show(): void {
    this.quad.visible = true;
    this.camera.layers.disable(SHAPE_LAYER);
    this.renderer.render(this.scene, this.camera);
    this.camera.layers.enable(SHAPE_LAYER);
    this.quad.visible = false;
  }

  private clear(): void {
    const { x, y } = this.renderer.getDrawingBufferSize(new Vector2());
    this.target.setSize(x, y);
    this.drawing(() => this.renderer.clear());
  }

  private add(shape: Drawable, first: number, count: number): void {
    const { renderer, camera } = this;
    const { mask } = camera.layers;
    camera.layers.set(SHAPE_LAYER);
    shape.among(first, count, () => this.drawing(() => renderer.render(this.scene, camera)));
    camera.layers.mask = mask;
  }

  private drawing(draw: () => void): void {
    const { renderer } = this;
    const { autoClear } = renderer;
    renderer.autoClear = false;
    renderer.setRenderTarget(this.target);
    draw();
    renderer.setRenderTarget(null);
    renderer.autoClear = autoClear;
  }
}
