/** The picture: renderer, camera and orbit; it draws only when something changed. */

import { PerspectiveCamera, Scene as ThreeScene, Vector3, WebGLRenderer } from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";

import type { Vec3 } from "../posing/affine";
import type { Level } from "../store/state";
import { Clock } from "./clock";
import { COARSE, Pace, WHOLE, type Drawing } from "./pace";
import { SHAPE_LAYER, Still, type Drawable } from "./still";

const FIELD_OF_VIEW = 38;

/** What is drawn whole or coarse. */
export interface Subject {
  readonly hasLevels: boolean;
  readonly whole: boolean;
  readonly opaque: boolean;
  readonly shown: Level;
  readonly revision: number;
  readonly drawable: Drawable;
  use(level: Level): void;
  update(): void;
}

/** Milliseconds: a frame that is asked for this soon after another goes on with its movement. */
const SOON = 100;
/** Milliseconds without a new frame, after which nothing moves, and the same while somebody holds on. */
const STILL = 150;
const HELD = 400;

export class Stage {
  readonly renderer: WebGLRenderer;
  readonly scene = new ThreeScene();
  readonly camera = new PerspectiveCamera(FIELD_OF_VIEW, 1, 0.01, 100);
  readonly orbit: OrbitControls;
  /** How finely frames are drawn. */
  readonly pace: Pace;
  /** What it shows, where there is something. */
  subject: () => Subject | null = () => null;
  /** Called with the level that is seen now, or that only a coarse one has come. */
  saw: (seen: Level | "loading") => void = () => undefined;
  /** Called after every picture, for what lies over the canvas. */
  drawn: () => void = () => undefined;
  /** Whether somebody has hold of the camera or a handle. */
  held = false;
  private readonly clock: Clock;
  /** Where a processor draws, the whole comes bit by bit. */
  private readonly still: Still | null;
  private frame = 0;
  private timer = 0;
  private asked = 0;
  private ended = 0;
  private halvings = 0;
  private radius = 1;
  width = 1;
  height = 1;

  constructor(readonly canvas: HTMLCanvasElement) {
    // Where a processor draws, smooth edges cost more than all else together, and so do many pixels.
    const antialias = !drawsInSoftware();
    this.pace = new Pace(!antialias);
    const gl = opaqueContext(canvas, antialias);
    this.renderer = new WebGLRenderer({ canvas, context: gl, antialias });
    this.clock = new Clock(gl);
    // It has no smooth edges.
    this.still = antialias ? null : new Still(this.renderer, this.scene, this.camera, this.clock);
    this.camera.layers.enable(SHAPE_LAYER);
    this.orbit = new OrbitControls(this.camera, canvas);
    this.orbit.addEventListener("change", () => this.invalidate());
    this.orbit.addEventListener("start", () => this.hold(true));
    this.orbit.addEventListener("end", () => this.hold(false));
    this.orbit.zoomToCursor = true;
    canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
    canvas.addEventListener("webglcontextrestored", () => {
      this.still?.forget();
      this.invalidate();
    });
    new ResizeObserver(() => this.resize()).observe(canvas.parentElement ?? canvas);
    this.resize();
  }

  /** Draw at the screen's next frame. */
  invalidate(): void {
    if (this.frame !== 0) return;
    this.asked = performance.now();
    this.frame = requestAnimationFrame(() => this.drawNext());
  }

  /** Draw what has been asked for. */
  drawNext(): void {
    cancelAnimationFrame(this.frame);
    this.frame = 0;
    this.next(performance.now(), this.held || this.asked - this.ended < SOON);
  }

  /** Draw the whole now. */
  draw(): void {
    this.show(WHOLE);
  }

  /** Whether nothing is left to be drawn. */
  get rests(): boolean {
    const subject = this.subject();
    const direct = !this.still || !subject?.hasLevels || !subject.opaque || this.pace.quality === "full";
    return this.frame === 0 && this.timer === 0 && (direct || this.still.fits(this.key(subject)));
  }

  /** Somebody takes hold of what moves, or lets go. */
  hold(on: boolean): void {
    this.held = on;
    if (!on && this.timer !== 0) this.settleAfter(STILL);
  }

  /** Look at a shape about the origin, of that radius, from the front and a little above. */
  frameShape(radius: number): void {
    this.radius = radius;
    this.camera.near = radius / 100;
    this.camera.far = radius * 60;
    this.orbit.target.set(0, 0, 0);
    this.orbit.minDistance = radius / 20;
    this.orbit.maxDistance = radius * 20;
    this.lookFrom(0.62, 0.3);
  }

  /** From an azimuth and an elevation in radians; the distance shows all of the shape. */
  lookFrom(azimuth: number, elevation: number): void {
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

  private next(now: number, moves: boolean): void {
    const { still } = this;
    const subject = this.subject();
    const key = subject ? this.key(subject) : "";
    if (subject && still?.fits(key)) {
      this.showStill(still, subject);
      return;
    }
    if (!still?.becomes(key)) still?.forget();
    const drawing = this.pace.next(now, moves, subject?.hasLevels ?? false, this.width * this.height);
    if (drawing === WHOLE) this.settle();
    else this.show(drawing);
  }

  private show({ level, halvings }: Drawing): void {
    const begun = performance.now();
    this.sharpen(halvings);
    const subject = this.subject();
    subject?.use(level);
    subject?.update();
    this.renderer.render(this.scene, this.camera);
    this.finish(subject);
    if (level !== "full" || halvings > 0) this.settleAfter(this.held ? HELD : STILL);
    else if (subject?.shown === "full") this.clock.ask(begun, (milliseconds) => this.pace.measured(milliseconds));
  }

  /** Draw the whole unless something moves within so many milliseconds. */
  private settleAfter(milliseconds: number): void {
    clearTimeout(this.timer);
    this.timer = window.setTimeout(() => {
      this.timer = 0;
      // A frame that has been asked for comes late: the movement goes on.
      if (this.frame !== 0) return;
      this.pace.rest();
      this.settle();
    }, milliseconds);
  }

  /** Draw the whole, at once or as soon as it can be had without keeping anybody waiting. */
  private settle(): void {
    const { still, pace } = this;
    const subject = this.subject();
    if (!still || !subject?.hasLevels || !subject.opaque || pace.quality === "full") {
      this.show(WHOLE);
      return;
    }
    const key = this.key(subject);
    if (pace.short) {
      const begun = performance.now();
      this.sharpen(0);
      still.make(key, subject.drawable);
      this.showStill(still, subject);
      this.clock.ask(begun, (milliseconds) => pace.measured(milliseconds));
      return;
    }
    if (still.becomes(key)) return;
    if (this.halvings > 0 || subject.shown === "full") this.show(COARSE);
    still.compose(key, subject.drawable, (milliseconds) => {
      pace.measured(milliseconds);
      if (this.frame === 0 && this.key(subject) === key) this.showStill(still, subject);
    });
  }

  private showStill(still: Still, subject: Subject): void {
    this.sharpen(0);
    subject.use("full");
    still.show();
    this.finish(subject);
  }

  private finish(subject: Subject | null): void {
    this.drawn();
    this.ended = performance.now();
    clearTimeout(this.timer);
    this.timer = 0;
    if (subject) this.saw(subject.whole ? subject.shown : "loading");
  }

  /** What the picture of the whole depends on. */
  private key(subject: Subject): string {
    const { matrixWorld, projectionMatrix } = this.camera;
    this.camera.updateMatrixWorld();
    return [subject.revision, this.width, this.height, ...matrixWorld.elements, ...projectionMatrix.elements].join();
  }

  private sharpen(halvings: number): void {
    if (this.halvings === halvings) return;
    this.halvings = halvings;
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2) / 2 ** (halvings / 2));
  }

  private resize(): void {
    const box = (this.canvas.parentElement ?? this.canvas).getBoundingClientRect();
    this.width = Math.max(Math.round(box.width), 1);
    this.height = Math.max(Math.round(box.height), 1);
    this.sharpen(0);
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.renderer.setSize(this.width, this.height, false);
    this.camera.aspect = this.width / this.height;
    this.camera.updateProjectionMatrix();
    // At once: a resized canvas is empty until something is drawn.
    this.next(performance.now(), false);
  }
}

let software: boolean | null = null;

/** Whether a processor draws, not a graphics card: there every pixel that is painted anew counts. */
export function drawsInSoftware(): boolean {
  software ??= /swiftshader|llvmpipe|software|basic render/i.test(rendererName());
  return software;
}

function rendererName(): string {
  const context = document.createElement("canvas").getContext("webgl2");
  const names = context?.getExtension("WEBGL_debug_renderer_info");
  const name = context && names ? String(context.getParameter(names.UNMASKED_RENDERER_WEBGL)) : "";
  context?.getExtension("WEBGL_lose_context")?.loseContext();
  return name;
}

/** A canvas that lets nothing shine through: three.js would ask for a clear one, which browsers blend over the page. */
function opaqueContext(canvas: HTMLCanvasElement, antialias: boolean): WebGL2RenderingContext {
  const gl = canvas.getContext("webgl2", { alpha: false, antialias, powerPreference: "high-performance" });
  if (!gl) throw new Error("There is no WebGL 2.");
  return gl;
}
