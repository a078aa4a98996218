/** The picture: renderer, camera and orbit; it draws only when something changed. */

import { PerspectiveCamera, Scene as ThreeScene, Vector3, WebGLRenderer } from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";

import type { Vec3 } from "./affine";
import { drawsInSoftware } from "./graphics";

const FIELD_OF_VIEW = 38;

/** Milliseconds: a frame that is asked for this soon after another goes on with its movement; frames may take so long. */
const SOON = 100;
const SLOW = 55;
/** Milliseconds without a new frame, after which nothing moves. */
const STILL = 300;
/** Steps by which a picture becomes coarser, each of half as many pixels. */
const COARSEST = 3;
const PROCESSORS_PIXELS = 160_000;

export class Stage {
  readonly renderer: WebGLRenderer;
  readonly scene = new ThreeScene();
  readonly camera = new PerspectiveCamera(FIELD_OF_VIEW, 1, 0.01, 100);
  readonly orbit: OrbitControls;
  /** Called before every picture, to have ready what it shows. */
  prepare: () => void = () => undefined;
  /** Called after every picture, for what lies over the canvas. */
  drawn: () => void = () => undefined;
  private frame = 0;
  private timer = 0;
  private asked = 0;
  private begun = 0;
  private ended = 0;
  private slowness = 0;
  private coarseness = 0;
  /** How coarse the newest movement had to be. */
  private usual: number | null = null;
  private radius = 1;
  width = 1;
  height = 1;

  constructor(readonly canvas: HTMLCanvasElement) {
    // Where a processor draws, smooth edges cost more than all else together, and so do many pixels.
    const antialias = !drawsInSoftware();
    if (antialias) this.usual = 0;
    this.renderer = new WebGLRenderer({ canvas, antialias, alpha: false, powerPreference: "high-performance" });
    this.orbit = new OrbitControls(this.camera, canvas);
    this.orbit.addEventListener("change", () => this.invalidate());
    this.orbit.zoomToCursor = true;
    canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
    canvas.addEventListener("webglcontextrestored", () => this.invalidate());
    new ResizeObserver(() => this.resize()).observe(canvas.parentElement ?? canvas);
    this.resize();
  }

  /** Draw at the screen's next frame. */
  invalidate(): void {
    if (this.frame !== 0) return;
    this.asked = performance.now();
    this.frame = requestAnimationFrame(() => {
      this.frame = 0;
      this.pace();
      this.draw();
    });
  }

  draw(): void {
    this.prepare();
    this.renderer.render(this.scene, this.camera);
    this.drawn();
    this.ended = performance.now();
  }

  /** Look at a shape about the origin, of that radius, from the front and a little above. */
  frameShape(radius: number): void {
    this.radius = radius;
    this.camera.near = radius / 100;
    this.camera.far = radius * 60;
    this.orbit.target.set(0, 0, 0);
    this.orbit.minDistance = radius / 20;
    this.orbit.maxDistance = radius * 20;
    this.look(0.62, 0.3);
  }

  /** From an azimuth and an elevation in radians; the distance shows all of the shape. */
  look(azimuth: number, elevation: number): void {
    const half = (FIELD_OF_VIEW * Math.PI) / 360;
    const narrow = Math.atan(Math.tan(half) * Math.min(this.camera.aspect, 1));
    const distance = (1.02 * this.radius) / Math.sin(narrow);
    const flat = Math.cos(elevation) * distance;
    this.camera.position
      .set(flat * Math.sin(azimuth), Math.sin(elevation) * distance, flat * Math.cos(azimuth))
      .add(this.orbit.target);
    this.camera.updateProjectionMatrix();
    this.orbit.update();
    this.invalidate();
  }

  /** Where a point of the scene appears, in pixels of the page from the view's top left; null behind the eye. */
  project(point: Vec3): readonly [number, number] | null {
    const at = new Vector3(...point).project(this.camera);
    if (at.z > 1) return null;
    return [((at.x + 1) / 2) * this.width, ((1 - at.y) / 2) * this.height];
  }

  /** Draw coarser while frames come too slowly, and in full as soon as nothing moves. */
  private pace(): void {
    const now = performance.now();
    const gone = now - this.begun;
    this.begun = now;
    const moves = this.asked - this.ended < SOON;
    if (!moves) this.slowness = 0;
    else if (this.coarseness < this.expected()) this.coarsen(this.expected());
    else {
      this.slowness += 0.3 * (gone - this.slowness);
      if (this.slowness > SLOW && this.coarseness < COARSEST) this.coarsen(this.coarseness + 1);
    }
    clearTimeout(this.timer);
    if (this.coarseness > 0) this.timer = window.setTimeout(() => this.refine(), STILL);
  }

  /** How coarse a movement begins: as the newest one was, or with as many pixels as a processor is likely to draw. */
  private expected(): number {
    if (this.usual !== null) return this.usual;
    const steps = Math.round(Math.log2((this.width * this.height) / PROCESSORS_PIXELS));
    return Math.min(Math.max(steps, 0), COARSEST);
  }

  private refine(): void {
    // One that has been asked for comes late: the movement goes on.
    if (this.frame !== 0) return;
    // A movement that was easy may be finer next time.
    this.usual = Math.max(this.coarseness - (this.slowness < SLOW / 2 ? 1 : 0), 0);
    this.coarsen(0);
    this.draw();
  }

  private coarsen(coarseness: number): void {
    this.coarseness = coarseness;
    this.slowness = 0;
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2) / 2 ** (coarseness / 2));
  }

  private resize(): void {
    const box = (this.canvas.parentElement ?? this.canvas).getBoundingClientRect();
    this.width = Math.max(Math.round(box.width), 1);
    this.height = Math.max(Math.round(box.height), 1);
    this.coarsen(0);
    this.renderer.setSize(this.width, this.height, false);
    this.camera.aspect = this.width / this.height;
    this.camera.updateProjectionMatrix();
    // At once: a resized canvas is empty until something is drawn.
    this.draw();
  }
}
